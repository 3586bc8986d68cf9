"""The report of a check: one self-contained HTML file, with the data of its figures next to it."""
