"""Controllers from linear models."""
