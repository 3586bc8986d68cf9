"""Nonlinear output frequency responses: estimates over levels, test signals, and the frequencies that outputs reach."""
