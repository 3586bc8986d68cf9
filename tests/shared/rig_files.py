"""A sound rig file: as text, and as the sections that it holds."""

import tomllib
from pathlib import Path

RIG = Path(__file__).with_name("rig.toml").read_text(encoding="utf-8")
SOUND = tomllib.loads(RIG)
