"""Plan an experiment: which effects an input would reveal, and which it could not distinguish."""
