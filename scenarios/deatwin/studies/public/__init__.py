"""Public recordings of others: their files, what is learned from and judged on, and black boxes beside a plant."""
