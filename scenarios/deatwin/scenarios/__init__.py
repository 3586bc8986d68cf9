"""The stories that `deatwin scenario NAME` runs: each a notebook page on plant, ident and control."""
