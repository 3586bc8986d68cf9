"""Public recordings: files, training and test parts, and black-box models for comparison."""
