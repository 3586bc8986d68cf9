"""A fleet of actuators of one specification: its records, what is the same for all, and models of one structure."""
