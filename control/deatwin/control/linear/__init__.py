"""Linear models of plants and NARX models about operating points."""
