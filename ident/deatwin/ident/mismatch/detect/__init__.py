"""Step 2 of a diagnosis: is anything missing, could it be seen, and is it the plant's?"""
