"""Result of a check: the verdict with all its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf, isfinite
from operator import attrgetter
from typing import Any, ClassVar

from deatwin.control.checking.amounts import three_digits
from deatwin.control.checking.rows import MarginRow, OperatingPoint
from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding, worst
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.document import controller_from_dict, controller_to_dict
from deatwin.control.linear.model import LinearStatus
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop
from deatwin.plant.amplitudes import amount, axis_label, written_amplitude
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, columns, document, several
from deatwin.plant.documents import Saved
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.records import finite
from deatwin.plant.words import as_sentence

SCHEMA = "deatwin/check/1"
_PLAIN = ("excited_band_Hz", "sine_predicted")
_RUNS = ("steps", "sine")
_ALWAYS = ("rms_error", "saturated_share", "effort")
_MEASURES = {"steps": (*_ALWAYS, "overshoot", "steady_error", "ripple"), "sine": _ALWAYS}
_MAY_BE_ABSENT = ("time",)  # Fields of a row of margins that may be null; null in any other field means infinite
_UNITS = {"time": "s", "phase_deg": "deg", "phase_low_deg": "deg", "delay": "s", "delay_low": "s", "crossover_Hz": "Hz"}


def _tables(check: Check) -> Variables:
    """Return findings and margins as tables, and each run as a table over its own time."""
    found: dict[str, Any] = {
        **columns("finding", [{**asdict(f), "verdict": f.verdict.value} for f in check.findings]),
        **columns("margin", map(asdict, check.table), {**_UNITS, "operating_input": check.operating.input_unit}),
    }
    for name, run in _runs(check).items():
        found |= run.variables(f"{name}_time", f"{name}_")
    if (predicted := check.predicted) is not None:
        for name in ("middle", "half_width"):
            found[f"predicted_{name}"] = ("predicted_time", getattr(predicted, name), predicted.output_unit)
    return found


def _times(check: Check) -> Variables:
    found = {name: run.timepts for name, run in _runs(check).items()}
    if check.predicted is not None:
        found["predicted"] = check.predicted.timepts
    return {f"{name}_time": (f"{name}_time", timepts, "s") for name, timepts in found.items()}


def _runs(check: Check) -> dict[str, ClosedLoop]:
    named = {"steps": check.steps, "sine": check.sine} | {f"other_{k}": r for k, r in enumerate(check.others.values())}
    return {name: run for name, run in named.items() if run is not None}


def to_document(check: Check) -> dict[str, Any]:
    """Return a check as plain data for JSON; an infinite margin becomes null."""
    runs = {name: run for name in _RUNS if (run := getattr(check, name)) is not None}
    predicted = check.predicted
    return {
        "schema": SCHEMA,
        "verdict": check.verdict.value,
        "worst_case": check.worst_case.subject,
        "reason": check.reason,
        "sentence": check.sentence,
        **{name: getattr(check, name) for name in _PLAIN},
        "operating": {**asdict(check.operating), "status": check.operating.status.name.lower()},
        "controller": None if check.controller is None else controller_to_dict(check.controller),
        "margins": None if check.margins is None else finite(asdict(check.margins)),
        "least_margins": finite(check.least_margins) if check.table else None,
        "table": [finite(asdict(row)) for row in check.table],
        "measures": {name: {m: getattr(run, m) for m in _MEASURES[name]} for name, run in runs.items()},
        "caveats": list(check.caveats),
        "findings": [finite({**asdict(f), "verdict": f.verdict.value}) for f in check.findings],
        **{name: runs[name].to_dict() if name in runs else None for name in _RUNS},
        "others": {name: run.to_dict() for name, run in check.others.items()},
        "predicted": None
        if predicted is None
        else {
            "middle": predicted.middle.tolist(),
            "half_width": predicted.half_width.tolist(),
            "diverged": predicted.diverged,
        },
    }


def from_document(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a check from the data that `to_document` made."""
    operating, controller, margins = (document[name] for name in ("operating", "controller", "margins"))
    status = LinearStatus[operating["status"].upper()]
    return {
        **{name: document[name] for name in _PLAIN},
        "caveats": tuple(document["caveats"]),
        "findings": tuple(Finding(**{**f, "verdict": Verdict(f["verdict"])}) for f in document["findings"]),
        "operating": OperatingPoint(**{**operating, "status": status}),
        "controller": None if controller is None else controller_from_dict(controller),
        "margins": None if margins is None else MarginRow(**_infinite(margins)),
        "table": tuple(MarginRow(**_infinite(row)) for row in document["table"]),
        **{name: None if document[name] is None else ClosedLoop.from_dict(document[name]) for name in _RUNS},
        "others": {name: ClosedLoop.from_dict(run) for name, run in document["others"].items()},
    }


def _infinite(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: inf if v is None and k not in _MAY_BE_ABSENT else v for k, v in values.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Check(Described, Saved, schema=SCHEMA, document=to_document, fields=from_document):
    """Result of `check`: the verdict on a controller before it is used on the actuator, and the reasons.

    The model is the identified NARX model. The plant is the physics model that stands for the actuator.

    Parameters
    ----------
    findings : tuple of Finding
        Judgements of single quantities, such as the phase margin; the most severe one decides the verdict.
    operating : OperatingPoint
        Operating point at which the model was linearised.
    controller : Controller or None
        Controller that was judged; None if no controller could be designed. In that case margins, runs and predictions
        are missing, too.
    margins : MarginRow or None
        Margins on the model at the controller's operating point.
    table : tuple of MarginRow
        Margins with one row for each system (the model, the plant and each other plant) and operating point. For a
        time-varying model there is also one row for each time.
    excited_band_Hz : float or None
        Upper end of the frequency band that the model's recording excited, Hz; None if unknown.
    steps, sine : ClosedLoop or None
        Simulated closed-loop runs on the plant, with a step reference and with a sine reference.
    others : mapping of str to ClosedLoop
        Runs of the step reference on the other plants, by the plants' names.
    predicted : PredictedLoop or None
        The model's prediction of the run `steps`. A saved file contains only the band of the prediction.
    sine_predicted : float or None
        Rms control error that the model predicts for the sine reference, in the output's unit.
    caveats : tuple of str
        Remarks that do not affect the verdict, for example that the model failed a residual test, or that the
        controller has no proportional part.
    """

    findings: tuple[Finding, ...]
    operating: OperatingPoint
    controller: Controller | None = None
    margins: MarginRow | None = None
    table: tuple[MarginRow, ...] = ()
    excited_band_Hz: float | None = field(default=None, metadata=attribute())
    steps: ClosedLoop | None = None
    sine: ClosedLoop | None = None
    others: Mapping[str, ClosedLoop] = field(default_factory=dict)
    predicted: PredictedLoop | None = None
    sine_predicted: float | None = None
    caveats: tuple[str, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "tables": several(_tables),
        "times": several(_times, "coords"),
        "verdict": attribute(),
        "reason": attribute(),
        "sentence": attribute(),
        "operating_input": attribute(of=attrgetter("operating.input")),
        "input_unit": attribute(of=attrgetter("operating.input_unit")),
        "output_unit": attribute(of=attrgetter("operating.output_unit")),
        "sample_time": attribute(of=attrgetter("operating.sample_time")),
        "others": attribute(of=lambda check: list(check.others)),
        "document": document(to_document),
    }

    @property
    def verdict(self) -> Verdict:
        """The verdict of the worst finding."""
        return self.worst_case.verdict

    @property
    def worst_case(self) -> Finding:
        """The finding that decides the verdict; if all pass, the one nearest its limit."""
        return worst(self.findings)

    @property
    def reason(self) -> str:
        """Texts of the findings that are as severe as the verdict; for `pass`, a text that all requirements are met."""
        if self.verdict is Verdict.PASS:
            tuned = "controller" if self.controller is None else f"{self.controller.name} controller"
            return f"the {tuned} meets all requirements{self._where}"
        return "; ".join(f.text for f in self.findings if f.verdict is self.verdict)

    @property
    def _where(self) -> str:
        """Return the operating inputs at which margins were judged, in words."""
        points = [row.operating_input for row in self.table]
        if not points:
            return ""
        low, high = map(three_digits, (min(points), max(points)))
        return " at constant inputs of " + amount(low if low == high else f"{low} to {high}", self.operating.input_unit)

    @property
    def least_margins(self) -> dict[str, float]:
        """Least `gain_low` (factor) and `phase_low_deg` (degrees) of all rows of the table."""
        rows = self.table
        return {
            "gain": min((row.gain_low for row in rows), default=inf),
            "phase_deg": min((row.phase_low_deg for row in rows), default=inf),
        }

    @property
    def sentence(self) -> str:
        """The check in plain sentences; every number in them is a field of the file."""
        if self.controller is None or self.margins is None:
            return f"{self.verdict.value}: {self.reason}.{self._warned}"
        tuned, at, least = self.controller, self.operating, self.least_margins
        margins = ", and the lowest ".join(
            f"{name} is {value:.2g}{unit}" if isfinite(value) else f"{name} is infinite"
            for name, value, unit in (("gain margin", least["gain"], ""), ("phase margin", least["phase_deg"], "°"))
        )
        return (
            f"{self.verdict.value}: {self.reason}. The {tuned.name} controller has a closed-loop time of "
            f"{tuned.closed_loop_time:.2g} s, and a crossover frequency of {self.margins.crossover_Hz:.2g} Hz at a constant "
            f"input of {amount(three_digits(at.input), at.input_unit)}. The lowest {margins}.{self._warned}"
        )

    @property
    def _warned(self) -> str:
        """Return the caveats as sentences."""
        return "".join(f" {as_sentence(text)}" for text in self.caveats)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot step reference, predicted output and output of the plant model over time, on `ax` or new axes."""
        axes = axes_or_new(ax)
        if self.predicted is not None:
            self.predicted.plot(axes)
        if self.steps is not None:
            steps = self.steps
            unit, size = written_amplitude(steps.output_unit)
            axes.plot(steps.timepts, steps.output / size, color="C3", linewidth=1.2, label="plant model")
            if self.predicted is None:
                axes.plot(steps.timepts, steps.reference / size, "--", color="0.4", linewidth=0.9, label="reference")
            axes.set_xlabel("time (s)")
            axes.set_ylabel(axis_label("output", unit))
            axes.legend()
        axes.set_title(f"{self.verdict.value}: {self.worst_case.text}", fontsize="small", wrap=True)
        return axes
