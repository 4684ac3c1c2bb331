"""Recorded missions: whether the model still holds, and what is suspected where it does not."""
