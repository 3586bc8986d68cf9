"""The report of a check: one HTML file that needs nothing else, its figures' data beside it."""
