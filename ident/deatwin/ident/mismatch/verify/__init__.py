"""Verification of an explanation on held-out data, by placebo effects and in every part of the recordings."""
