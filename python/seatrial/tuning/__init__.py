"""Tuning: gains whose set-point responses stay inside corridors.

`corridor` holds the bounds of a response, `corridor_criterion` what leaving them costs, `tuning_file` the
keys of the campaign file.
"""
