"""Controllers as C source for the micro-controller on the bench."""
