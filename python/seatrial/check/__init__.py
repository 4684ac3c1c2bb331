"""Checks of files before use: vehicle, autopilot, mission, campaign."""
