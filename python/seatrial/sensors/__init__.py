"""Sensor models: what a vehicle's instruments log of a motion."""
