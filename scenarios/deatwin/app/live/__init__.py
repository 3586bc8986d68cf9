"""The live view: a page on this machine that shows a folder's recordings, diagnoses them and compares the verdicts.

Everything but `page` and `serve` is plain Python that is tested without a browser: `desk` (what lies in the folder
or is dropped there, and nothing outside of it), `jobs` with `worker` (diagnoses in processes of their own), `verdicts` and
`comparison`, `guard` (who may ask).
"""
