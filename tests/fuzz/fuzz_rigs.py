"""Fuzz the readers of rig files.

``python tests/fuzz/fuzz_rigs.py --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

if __name__ == "__main__":
    from harness import run

    run("RIGS")
