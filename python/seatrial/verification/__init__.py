"""Verification of an autopilot by many missions."""
