"""Sampled controllers with limits."""
