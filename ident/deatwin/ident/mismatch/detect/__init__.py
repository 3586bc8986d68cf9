"""Step 2 of a diagnosis: test whether anything is missing, could be detected, and belongs to the plant."""
