"""Advice: the input that distinguishes alternative explanations."""
