"""Tuning of an autopilot by corridors of its set-point responses."""
