"""Margins of sampled loops with their uncertainty, and the limit cycles of loops with a nonlinearity."""
