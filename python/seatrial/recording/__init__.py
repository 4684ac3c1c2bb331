"""From a table of a recording to signals that can be used: one step, one file.

columns (names, units, frames) -> defects (what is wrong) -> alignment (signs, latency) -> resampling (one
time base) -> smoothing (states and derivatives). `seatrial.trial` puts them in a row; `report` says what was
found.
"""
