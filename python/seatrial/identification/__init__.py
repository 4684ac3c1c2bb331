"""Identification of a vehicle from the trials of a campaign."""
