"""A check as plain data, "deatwin/check/1", and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from deatwin.control.checking.operating import OperatingPoint
from deatwin.control.checking.rows import MarginRow
from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.document import controller_from_dict, controller_to_dict
from deatwin.control.linear.model import LinearStatus
from deatwin.control.loop.closed_loop import ClosedLoop

if TYPE_CHECKING:
    from deatwin.control.checking.result import Check


SCHEMA = "deatwin/check/1"
_PLAIN = ("excited_band_Hz", "sine_predicted")
_RUNS = ("steps", "sine")
_ALWAYS = ("rms_error", "saturated_share", "effort")
_MEASURES = {"steps": (*_ALWAYS, "overshoot", "steady_error", "ripple"), "sine": _ALWAYS}
_MAY_BE_ABSENT = ("time",)  # of a row of margins; where another is null it is infinite


def to_document(check: Check) -> dict[str, Any]:
    """A check as JSON can hold it; an infinite margin is null."""
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
        "margins": None if check.margins is None else _finite(asdict(check.margins)),
        "least_margins": _finite(check.least_margins) if check.table else None,
        "table": [_finite(asdict(row)) for row in check.table],
        "measures": {name: {m: getattr(run, m) for m in _MEASURES[name]} for name, run in runs.items()},
        "caveats": list(check.caveats),
        "findings": [_finite({**asdict(f), "verdict": f.verdict.value}) for f in check.findings],
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
    """The fields of the check that `to_document` described."""
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


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in values.items()}


def _infinite(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: inf if v is None and k not in _MAY_BE_ABSENT else v for k, v in values.items()}
