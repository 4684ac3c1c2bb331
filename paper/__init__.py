"""Figures and block diagrams as in a paper about a vehicle."""
