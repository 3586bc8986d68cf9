"""The report of a diagnosis: one HTML file that needs nothing else, its figures' data beside it."""
