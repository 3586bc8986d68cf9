"""The command line, the reports that it writes, and the live view."""
