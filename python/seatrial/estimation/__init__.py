"""Estimation of coefficients: stages, global search, joint estimate, scale of the forces."""
