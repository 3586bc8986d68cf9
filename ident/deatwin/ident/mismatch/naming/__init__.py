"""Naming: search for the effects of the catalogue that explain a mismatch."""
