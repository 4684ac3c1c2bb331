"""Diagnosis of an estimate: uncertainty, identifiability, residual analysis, missing terms, advice."""
