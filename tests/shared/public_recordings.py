"""Where public recordings lie, and what a test does that needs absent ones."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("DEATWIN_DATA") or Path(__file__).parents[2].parent / "shared" / "data")


def recordings(name: str) -> Path:
    """The folder of some of them; where they are absent the test that asks is skipped."""
    if not (DATA / name).is_dir():
        pytest.skip(f"the recordings {name} are absent: DEATWIN_DATA names the folder that holds them")
    return DATA / name
