"""Bench tests: thrust from load-cell records, motor dynamics from steps of revolutions."""
