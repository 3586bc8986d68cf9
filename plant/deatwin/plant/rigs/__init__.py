"""Rigs: kinematics from generalised coordinates to stretches, loads, and the files that describe them."""
