"""Frequency responses along time, and what a record shows of drift before any fit."""
