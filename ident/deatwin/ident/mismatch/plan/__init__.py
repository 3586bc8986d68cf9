"""Before anything is recorded: which effects an input would show, and which it could not tell apart."""
