"""Controllers around models and around the physics plant."""
