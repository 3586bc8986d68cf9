"""Fuzz the readers of public recordings.

``python tests/fuzz/fuzz_public.py --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

if __name__ == "__main__":
    from harness import run

    run("PUBLIC")
