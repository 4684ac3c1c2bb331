"""Trials: recordings read, corrected, scored and compared."""
