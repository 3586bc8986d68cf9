"""Verdicts in folders of results, and several of them side by side."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deatwin.app.live.desk import RESULT, inside
from deatwin.app.live.glance import DRAWING
from deatwin.plant.amplitudes import written_unit
from deatwin.plant.errors import DeatwinError
from deatwin.plant.files.recordings import ENDINGS

if TYPE_CHECKING:
    from deatwin.ident.mismatch import Diagnosis

RUN = "run.json"
MOST_BYTES = 20_000_000
TONES = {
    "none": "good",
    "parameters": "good",
    "named": "good",
    "ambiguous": "doubt",
    "partly": "doubt",
    "not_testable": "doubt",
}


@dataclass(frozen=True, kw_only=True)
class Left:
    """An effect that the plant lacked, in words."""

    effect: str  # Name of the effect
    probability: float
    parameters: tuple[tuple[str, str, str], ...]  # Name, value with unit, and 95 % interval with unit of each


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict in a folder of results."""

    name: str  # Folder, relative to that of the live view
    fault: str = ""  # Reason why it cannot be read; empty if it can
    verdict: str = ""
    tone: str = "bad"
    sentence: str = ""
    certainty: str = ""  # How sure the verdict is
    next_step: str = ""  # What to do next
    unit: str = ""
    noise: float | None = None
    causes: tuple[Left, ...] = ()  # Effects that the plant lacked
    possible: tuple[str, ...] = ()  # Explanations that the recordings cannot distinguish, in words
    fitted: tuple[float | None, float | None] = (None, None)
    unseen: tuple[float | None, float | None] = (None, None)
    inputs: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None  # Duration of the run
    report: bool = False  # True if there is a page to open

    @classmethod
    def read(cls, root: Path, name: str) -> Verdict:
        """Read a folder of results."""
        from deatwin.ident.mismatch import Diagnosis

        try:
            diagnosis = Diagnosis.load(inside(root, f"{name}/{RESULT}"))
            run = _run(inside(root, f"{name}/{RUN}"))
            report = inside(root, f"{name}/report.html").is_file()
        except DeatwinError as error:
            return cls(name=name, fault=str(error).replace(f"{root.resolve()}{os.sep}", ""))
        return cls(name=name, report=report, **_said(diagnosis), **run)

    @property
    def recordings(self) -> frozenset[str]:
        """SHA-256 hashes of the recordings."""
        return frozenset(digest for file, digest in self.inputs.items() if file.lower().endswith(ENDINGS))

    @property
    def errors(self) -> tuple[float, ...]:
        """All known errors, and the noise."""
        return tuple(value for value in (*self.fitted, *self.unseen, self.noise) if value is not None)


def _said(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis in words."""
    from deatwin.ident.mismatch import how_sure, next_step
    from deatwin.ident.mismatch.say import called, in_percent, ranked
    from deatwin.studies.report.quantities import with_interval

    unit = diagnosis.output.unit
    fitted, unseen = diagnosis.fit.fitted, diagnosis.fit.unseen
    causes = (
        Left(
            effect=cause.effect,
            probability=cause.probability,
            parameters=tuple(
                (name, *with_interval(x.value, x.low, x.high, x.unit))
                for name, x in ((name, in_percent(name, given)) for name, given in cause.parameters.items())
            ),
        )
        for cause in diagnosis.causes
    )
    return {
        "verdict": diagnosis.verdict.value,
        "tone": TONES.get(diagnosis.verdict.value, "bad"),
        "sentence": diagnosis.sentence,
        "certainty": how_sure(diagnosis),
        "next_step": next_step(diagnosis),
        "unit": written_unit(unit),
        "noise": diagnosis.noise,
        "causes": tuple(causes),
        "possible": tuple(called(one.effects, diagnosis) for one in ranked(diagnosis)),
        "fitted": (fitted.before, fitted.after),
        "unseen": (unseen.before, unseen.after),
    }


def _run(path: Path) -> dict[str, Any]:
    """Read inputs and time from the run record, if it exists and is valid."""
    try:
        if path.stat().st_size > MOST_BYTES:
            return {}
        run = json.loads(path.read_text(encoding="utf-8"))
        return {
            "inputs": {str(entry["file"]): str(entry["sha256"]) for entry in run["inputs"]},
            "seconds": float(run["seconds"]),
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return {}


SIZE = (2.7, 1.2)
MOST = 6  # Most verdicts that are compared at once


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Several verdicts, side by side."""

    verdicts: tuple[Verdict, ...]
    limits: tuple[float, ...]
    same_recordings: bool | None

    def html(self) -> str:
        """Return the table with its drawings, for a page that defines the report's colours as CSS variables."""
        from deatwin.studies.report.rendering import templates

        pictures = [
            _drawn(number, verdict, limit) if limit else ""
            for number, (verdict, limit) in enumerate(zip(self.verdicts, self.limits, strict=True))
        ]
        return (
            templates("deatwin.app.live").get_template("comparison.html.j2").render(comparison=self, pictures=pictures)
        )


def compare(verdicts: Sequence[Verdict]) -> Comparison:
    """Arrange verdicts side by side."""
    taken = tuple(verdicts[:MOST])
    largest: dict[str, float] = {}
    for verdict in taken:
        largest[verdict.unit] = max((largest.get(verdict.unit, 0.0), *verdict.errors))
    seen = [verdict.recordings for verdict in taken]
    return Comparison(
        verdicts=taken,
        limits=tuple(largest[verdict.unit] if verdict.errors else 0.0 for verdict in taken),
        same_recordings=len(set(seen)) == 1 if len(seen) > 1 and all(seen) else None,
    )


def _drawn(number: int, verdict: Verdict, limit: float) -> str:
    """Draw errors before and after, on fitted and on held-out data, with the noise."""
    from deatwin.studies.report.drawing import COLOURS, draw, inline

    with DRAWING, draw(SIZE) as figure:
        axes = figure.subplots()
        for height, (before, after) in enumerate((verdict.unseen, verdict.fitted)):
            if before is not None and after is not None:
                axes.plot([before, after], [height, height], color=COLOURS["grid"][0], linewidth=3, zorder=2)
            for value, role, marker in ((before, "before", "o"), (after, "after", "D")):
                if value is not None:
                    axes.plot(value, height, marker, color=COLOURS[role][0], markersize=7, zorder=3)
        if verdict.noise is not None:
            axes.axvline(verdict.noise, color=COLOURS["measured"][0], linestyle="--", linewidth=1.2)
        axes.set_yticks([0, 1], ["held out", "fitted"])
        axes.set_ylim(-0.6, 1.6)
        axes.set_xlim(-0.03 * limit, 1.06 * limit)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(f"error in {verdict.unit} rms")
        return inline(figure, f"compared-{number}", f"Errors before and after, {verdict.verdict}")
