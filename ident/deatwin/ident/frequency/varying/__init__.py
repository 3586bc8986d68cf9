"""Frequency responses that change with time, and tests for drift before any model is fitted."""
