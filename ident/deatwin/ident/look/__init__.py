"""Describe recordings before any model is fitted."""

from deatwin.ident.look.approximation import BestLinearApproximation
from deatwin.ident.look.best_linear import best_linear_approximation
from deatwin.ident.look.look import Look, look_at

__all__ = ["BestLinearApproximation", "Look", "best_linear_approximation", "look_at"]
