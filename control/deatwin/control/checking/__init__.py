"""Check whether a controller would work on the actuator."""
