"""Fuzz the readers of models, diagnoses and checks.

``python tests/fuzz/fuzz_documents.py --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

if __name__ == "__main__":
    from harness import run

    run("DOCUMENTS")
