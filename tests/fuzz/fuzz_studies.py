"""Fuzz the readers of files that studies keep: seals, cases, records of runs.

``python tests/fuzz/fuzz_studies.py --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

if __name__ == "__main__":
    from harness import run

    run("STUDIES")
