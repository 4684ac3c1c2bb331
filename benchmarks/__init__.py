"""Benchmarks that print ratios, and the textbook model that serves the tests as an independent reference."""
