"""The live view: a page on this machine that shows a folder's recordings, diagnoses them and compares the verdicts."""
