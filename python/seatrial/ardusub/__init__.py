"""ArduSub: its controllers replayed from a log, and its parameter files."""
