"""The report of a diagnosis: one self-contained HTML file, with the data of its figures next to it."""
