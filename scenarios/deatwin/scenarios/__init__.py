"""The stories that use plant, ident and control; the command line; the report."""
