"""Figures for paper and screen in one style."""
