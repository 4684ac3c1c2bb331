"""Closed-loop flights: a vehicle with its sensors and its autopilot on a mission."""
