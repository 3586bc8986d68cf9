"""One module per command of the command line; heavy packages are imported inside the commands."""
