"""Are the recordings sound, and how loud is their sensor?"""
