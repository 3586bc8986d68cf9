"""One module a command of the command line; what is heavy is imported inside the commands."""
