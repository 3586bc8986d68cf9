"""Models, plants and frequency responses as objects of python-control, and linear systems back from there.

What is linear already has its ways: `LinearModel.system` (``control.tf``) and `LinearModel.state_space`
(``control.ss``) are about an operating point, and `LinearModel.covariance` is that of the coefficients.
"""
