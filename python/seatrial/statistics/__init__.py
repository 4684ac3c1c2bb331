"""Statistics of dependent errors: blocks, information, score tests, exact intervals, multiple testing."""
