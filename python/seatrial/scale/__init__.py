"""The absolute scale: what drives the vehicle, what no trial tells, and the anchor that fixes it."""
