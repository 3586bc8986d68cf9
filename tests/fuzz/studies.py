"""Files that studies keep: how they are read, and sound ones to start from."""

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from readers import SEEDS, Kind

from deatwin.app.live.verdicts import Verdict
from deatwin.studies.folder import ResultFolder
from deatwin.studies.sweep.seal import SweepSeal
from deatwin.studies.sweep.store import CaseStore, read_seal

SWEEP = SweepSeal(schema="deatwin/study-case/1", parts={"code": "c" * 64, "seed": 3, "levels": [0.1, 0.2]})


def as_bytes(content: Any) -> tuple[bytes, ...]:
    """A JSON file as studies write them."""
    return ((json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode(),)


@contextmanager
def beside(path: Path, name: str, others: Mapping[str, bytes]) -> Iterator[Path]:
    """A folder with the file under a name, and others that belong to it."""
    with tempfile.TemporaryDirectory() as folder:
        for other, content in others.items():
            target = Path(folder) / other
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
        (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, Path(folder) / name)
        yield Path(folder)


def require_seal(found: SweepSeal) -> None:
    """It is read back as it was written."""
    assert SweepSeal.from_dict(found.to_dict()).hash == found.hash


def read_case(path: Path) -> dict[str, Any]:
    """A case, as the store of its sweep gives it."""
    with tempfile.TemporaryDirectory() as folder:
        store = CaseStore(folder, SWEEP)
        shutil.copy(path, store.path("case"))
        return store.get("case")


@cache
def case_seeds() -> tuple[bytes, ...]:
    """A case with numbers, lists, texts and nothing."""
    with tempfile.TemporaryDirectory() as folder:
        store = CaseStore(folder, SWEEP)
        notes = {"µ": "text", "no": None}
        store.put("case", {"status": "done", "gain": 0.25, "track": [1.0, 2.5, None], "notes": notes})
        return (store.path("case").read_bytes(),)


def case_ending() -> str:
    """Of the file of a case."""
    with tempfile.TemporaryDirectory() as folder:
        return CaseStore(folder, SWEEP).path("case").suffix


def require_case(found: dict[str, Any]) -> None:
    """Under its seal."""
    assert {name: found[name] for name in ("schema", "seal", "name")} == SWEEP.stamp("case")


def run_record() -> Any:
    """As commands write it."""
    rig = {"file": "rig.toml", "sha256": "a" * 64}
    return {"inputs": [rig], "seconds": 12.5, "outputs": ["figures/fit.csv", "figures/../../kept.csv", "report.html"]}


def shown(path: Path) -> Verdict:
    """A folder of results in the live view, which passes over a record that it cannot use."""
    diagnosis = (SEEDS / "diagnosis.json").read_bytes()
    with beside(path, "results/run.json", {"results/diagnosis.json": diagnosis}) as folder:
        return Verdict.read(folder, "results")


def require_shown(found: Verdict) -> None:
    assert not found.fault and found.sentence
    assert found.seconds is None or isinstance(found.seconds, float)
    assert all(isinstance(text, str) for pair in found.inputs.items() for text in pair)


def cleared(path: Path) -> set[str]:
    """What is left of a folder, and around it, after the files of a former run were removed."""
    others = {"kept.csv": b"", "results/own.txt": b"", "results/figures/fit.csv": b"", "results/figures/kept.txt": b""}
    with beside(path, "results/run.json", others) as folder:
        ResultFolder(folder / "results").remove_former(r"figures/\w+\.csv")
        return {entry.relative_to(folder).as_posix() for entry in folder.rglob("*") if entry.is_file()}


def require_cleared(found: set[str]) -> None:
    assert found >= {"kept.csv", "results/own.txt", "results/figures/kept.txt", "results/run.json"}


STUDIES: Mapping[str, Kind] = {
    "seal": Kind(
        stem="seal",
        ending=".json",
        read=lambda path: read_seal(path.parent),
        require_sound=require_seal,
        seeds=lambda: as_bytes(SWEEP.to_dict()),
    ),
    "case": Kind(stem="case", ending=case_ending(), read=read_case, require_sound=require_case, seeds=case_seeds),
    "shown run": Kind(
        stem="run", ending=".json", read=shown, require_sound=require_shown, seeds=lambda: as_bytes(run_record())
    ),
    "former run": Kind(
        stem="run", ending=".json", read=cleared, require_sound=require_cleared, seeds=lambda: as_bytes(run_record())
    ),
}
