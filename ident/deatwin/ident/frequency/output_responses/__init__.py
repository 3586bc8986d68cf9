"""Nonlinear output frequency responses: estimation from several levels, test signals, frequencies of the output."""
