"""A fleet of actuators of one specification: its recordings, common settings, and models of one structure."""
