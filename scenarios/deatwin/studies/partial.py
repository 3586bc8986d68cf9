"""Save the finished steps of an interrupted diagnosis, in files that cannot be mistaken for a diagnosis."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deatwin.plant.amplitudes import amount, amplitude_unit
from deatwin.plant.prefixes import time_span
from deatwin.studies.folder import ResultFolder
from deatwin.studies.voice import Progress

if TYPE_CHECKING:  # the live view only looks for kept steps, and makes none
    from deatwin.ident.mismatch import Step
    from deatwin.plant.model import Plant
    from deatwin.studies.provenance import RunRecord


SCHEMA = "deatwin/partial/1"
FOLDER = "partial"
STEPS, BASE_MODEL = "steps.json", "base_model.json"
NOTE = (
    "This diagnosis was interrupted and has no verdict. Later steps could have changed these results. The same command "
    "repeats the diagnosis from the start."
)


STEP_WORDS = {
    "gate": "check of the recordings",
    "base": "calibration of the model",
    "detect": "test for a mismatch",
    "locate": "location of the mismatch",
    "verify": "tests of the explanation",
    "advise": "next experiment",
    "discover": "formula without physics",
}


def first_words(step: Step, unit: str) -> str:
    """Return the result of a step in a sentence, shown before the verdict; empty for quick steps."""
    found = step.to_dict()
    if step.name == "base":
        left, noise, error = (amount(f"{found[k]:.3g}", unit) for k in ("fitted", "noise", "model_error"))
        return f"calibration: the calibrated model has an error of {left} rms (sensor noise: {noise}; allowed model error: {error})"
    if step.name == "detect" and found["excess"] is not None:
        size, least = (amount(f"{found[k]:.3g}", unit) for k in ("excess", "practical"))
        return f"mismatch: the error beyond sensor noise is {size} rms (errors below {least} rms do not count as a mismatch)"
    if step.name == "locate":
        times = sorted(found["time"], key=lambda window: -window["score"])[:1]
        bands = sorted(found["frequency"], key=lambda band: -band["excess_dB"])[:1]
        when = [f"from {time_span(w['from_s'], w['to_s'], 1)}" for w in times]
        which = [f"from {b['from_Hz']:.3g} to {b['to_Hz']:.3g} Hz" for b in bands]
        return f"location: the mismatch is largest {' and '.join([*when, *which])}" if when or which else ""
    return ""


class FinishedSteps:
    """Collects the results of a diagnosis' steps, and its progress."""

    def __init__(self, progress: Progress, unit: str = "", say: Callable[[str], None] | None = None) -> None:
        self.share, self.doing = 0.0, "beginning"
        self._progress, self._unit = progress, unit
        self._say, self._said = say or (lambda text: None), set[str]()
        self._steps: dict[tuple[str, str], Step] = {}

    def tell(self, share: float, doing: str) -> None:
        """Store the progress, and pass it on."""
        self._progress(share, doing)  # raises an interrupt that was not handled before
        self.share, self.doing = share, doing

    def take(self, step: Step) -> None:
        """Store a finished step, replacing an earlier one of the same subject, and announce it."""
        self._steps[step.name, step.subject] = step
        known = first_words(step, self._unit)
        if known and known not in self._said:
            self._said.add(known)
            self._say(known)
        if step.subject:
            self._progress(self.share, f"{self.doing} ({step.subject})")

    def save(self, folder: ResultFolder, plant: Plant, record: RunRecord) -> str:
        """Write the steps, replacing those of an earlier interrupted run."""
        if not self._steps:
            return f"interrupted while {self.doing}; no step was finished, and nothing was written to {folder.path}"
        remove_partial(folder)
        models = [step.model for step in self._steps.values() if step.model is not None]
        for model in models:
            folder.save(f"{FOLDER}/{BASE_MODEL}", model.save)
        written = [*([BASE_MODEL] if models else []), STEPS]
        document = self._document(plant, record.finished([f"{FOLDER}/{name}" for name in written]))
        folder.text(f"{FOLDER}/{STEPS}", json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
        former = (
            "; the diagnosis.json there is from an earlier run" if (folder.path / "diagnosis.json").exists() else ""
        )
        return (
            f"interrupted while {self.doing}; there is no verdict, but {folder.path / FOLDER} keeps the finished steps: "
            f"{self._listed()} ({', '.join(written)}){former}"
        )

    def _document(self, plant: Plant, run: dict[str, Any]) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "finished": False,
            "note": NOTE,
            "interrupted": {"share": self.share, "doing": self.doing},
            "output": {"name": plant.rig.output_name, "unit": amplitude_unit(plant.rig.output_unit)[0]},
            "steps": [
                {
                    "step": step.name,
                    **({"subject": step.subject} if step.subject else {}),
                    **({"model": BASE_MODEL} if step.model is not None else {}),
                    "result": step.to_dict(),
                }
                for step in self._steps.values()
            ],
            "run": run,
        }

    def _listed(self) -> str:
        """List the steps in words; for fits, give their number."""
        fits = sum(step.name == "fit" for step in self._steps.values())
        counted = STEP_WORDS | {"fit": f"{fits} fits with effects" if fits > 1 else "1 fit with effects"}
        return ", ".join(dict.fromkeys(counted.get(step.name, step.name) for step in self._steps.values()))


def holds_only_partial(folder: Path) -> bool:
    """Return whether a folder contains only the steps of an interrupted run."""
    if folder.is_symlink() or (folder / FOLDER).is_symlink():
        return False
    held = {path.relative_to(folder).as_posix() for path in folder.rglob("*")}
    return {FOLDER} <= held <= {FOLDER, f"{FOLDER}/{STEPS}", f"{FOLDER}/{BASE_MODEL}"}


def remove_partial(folder: ResultFolder) -> None:
    """Remove the files of an interrupted run; other files stay."""
    place = folder.path / FOLDER
    for name in (STEPS, BASE_MODEL):
        (place / name).unlink(missing_ok=True)
    if place.is_dir() and not any(place.iterdir()):
        place.rmdir()
