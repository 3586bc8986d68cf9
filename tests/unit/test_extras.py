"""The table of extras in the documents is that of pyproject.toml."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROW = re.compile(r'^\| `pip install (-e )?"\.\[([a-z]+)\]"` \| (.+) \|$', re.MULTILINE)
FROM_A_CHECKOUT = {"test", "browser", "fuzz", "docs"}
"""What tests or builds the checkout itself."""


def test_the_table_of_extras_lists_each_once_and_no_other() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = ROW.findall((ROOT / "docs/index.md").read_text(encoding="utf-8"))
    assert sorted(name for _, name, _ in rows) == sorted(project["optional-dependencies"])
    assert {name for editable, name, _ in rows if editable} == FROM_A_CHECKOUT
    assert all(re.search(r"\w", brings) for _, _, brings in rows)
