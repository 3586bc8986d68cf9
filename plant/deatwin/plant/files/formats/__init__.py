"""File formats of recordings: each is read into a `Table`, and written from a `Recording`."""
