"""Uncertainty of frequency responses from the covariance of parameters, by derivatives and by draws."""
