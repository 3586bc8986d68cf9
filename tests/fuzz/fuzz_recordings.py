"""Fuzz the readers of recordings: CSV, MATLAB, TDMS, NetCDF.

``python tests/fuzz/fuzz_recordings.py --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

if __name__ == "__main__":
    from harness import run

    run("RECORDINGS")
