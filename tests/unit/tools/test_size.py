"""The measure of the project: it counts what it says it counts, in a project of which everything is known."""

from pathlib import Path

import pytest
import size

PYPROJECT = '[tool.hatch.build.targets.wheel]\nsources = ["plant", "scenarios"]\n'
FILES = {
    "plant/deatwin/plant/__init__.py": 'from deatwin.plant.law import Law, gain\n__all__ = ["Law", "gain"]\n',
    "plant/deatwin/plant/again/__init__.py": 'from deatwin.plant import Law\n__all__ = ["Law"]\n',
    "plant/deatwin/plant/law.py": '''"""A law."""
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Mapping
if TYPE_CHECKING:
    from deatwin.plant.other import Other
__all__ = ["Law", "gain"]

@dataclass
class Law:
    """A law of nature.

    Parameters
    ----------
    found : mapping
        Of what was found.
    """

    found: Mapping[str, Any]
    name: str = ""

def gain(law: Law) -> float:
    """Whether it is large."""
    from deatwin.plant.free import FREE
    return FREE
''',
    "plant/deatwin/plant/other.py": "def other():\n    from deatwin.plant import law\n    return law\nclass Other: ...\n",
    "plant/deatwin/plant/free.py": "FREE = 1.0\n",
    "scenarios/deatwin/scenarios/silverbox/__init__.py": "1\n2\n3\n",
    "scenarios/deatwin/scenarios/silverbox/run.py": "1\n",
    "scenarios/deatwin/scenarios/emps.py": "1\n",
}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "pyproject.toml").write_text(PYPROJECT)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_names_circles_fields_stories_and_fragments(project):
    modules = size.product(project)
    assert size.public(modules) == {("deatwin.plant.law", "Law"), ("deatwin.plant.law", "gain")}
    # A circle that is closed inside a function and for types only; `free` is reached and reaches nobody.
    assert size.circles(modules) == [["deatwin.plant.law", "deatwin.plant.other"]]
    assert size.untyped_fields(modules.values()) == ["deatwin.plant.law.Law.found"]
    assert size.stories(modules) == {"silverbox": 4, "emps": 1}
    assert modules["deatwin.plant.law"].docstring_lines == 1 + 7 + 1
    lost, read = size.fragments(modules, size.public(modules))
    assert read == 3
    assert lost == ["deatwin.plant.law.Law: Of what was found.", "deatwin.plant.law.gain: Whether it is large."]


def test_the_table_counts_lines_and_patches(project):
    (project / "tests").mkdir()
    (project / "tests" / "test_a.py").write_text(
        'monkeypatch.setattr(\n    "deatwin.plant.free.FREE", 2.0\n)\npatch(here)\n'
    )
    now = {what.strip(): now for what, _, now, _ in size.rows(project)}
    assert now["product, lines"] == str(sum(len(text.splitlines()) for text in FILES.values()))
    assert now["under scenarios/"] == "5" and now["tests, lines"] == "4"
    assert now['patches of "deatwin..." in tests'] == "1" and now["public names (packages re-export them)"] == "2"
    assert now["names in __all__ of other modules"] == "2"
