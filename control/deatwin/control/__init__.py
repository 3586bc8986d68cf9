"""Identified models to controllers, and controllers to a verdict on the physics plant."""
