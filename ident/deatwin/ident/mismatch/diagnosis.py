"""The result of a diagnosis, a verdict with its evidence, as an object and as the file ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from deatwin.ident.mismatch.datasets import places, samples
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.layout import Readings, draw_residuals
from deatwin.ident.mismatch.located import LocationSummary, Unexplained
from deatwin.ident.mismatch.result import (
    AdviceSummary,
    DetectionSummary,
    Fault,
    FitSummary,
    FormSummary,
    FreeFormSummary,
    IndistinguishablePair,
    Output,
    ReadingSummary,
    VerificationSummary,
)
from deatwin.ident.mismatch.verdict import CandidateSummary, Cause, Explanation, FittedParameter, Verdict
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.arguments import of_plain_data
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, columns, document, several
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.records import INTERNAL, OPTIONAL, key, plain, read
from deatwin.plant.words import spaced

SCHEMA = "deatwin/diagnosis/2"
NOWHERE: Mapping[str, Sequence[object]] = {"time": (), "frequency": (), "region": (), "place": (), "response": ()}
"""Text by which the file states that nothing is missing anywhere."""


def _tables(diagnosis: Diagnosis) -> Variables:
    causes = [
        {"effect": c.effect, "family": c.family, "probability": c.probability, "share_explained": c.share_explained}
        for c in diagnosis.causes
    ]
    added = [{"name": f"{c.effect}.{name}", **plain(p)} for c in diagnosis.causes for name, p in c.parameters.items()]
    fitted = [{"name": name, **plain(p)} for name, p in diagnosis.parameters.items()]
    smallest = [{"effect": name, "size": size} for name, size in diagnosis.detection.smallest_detectable.items()]
    return {
        **columns("cause", causes),
        **columns("cause_parameter", added),
        **columns("parameter", fitted),
        **columns("detectable", smallest),
        **places(diagnosis.location, diagnosis.output.unit),
    }


def _readings(diagnosis: Diagnosis) -> Variables:
    """Return recorded and simulated readings over the clock, if they are known."""
    given, amplitude = diagnosis.readings, diagnosis.output.unit
    if given is None:
        return {}
    records = [record for one in given.experiments for record in one.recordings]
    first = records[0]
    size = amplitude_unit(first.output_units[0])[1]

    def joined(readings: tuple[tuple[np.ndarray, ...], ...]) -> np.ndarray:
        return np.concatenate([values.ravel() for one in readings for values in one])

    found: dict[str, Any] = {
        "command": ("sample", np.concatenate([r.inputs[0] for r in records]), first.input_units[0]),
        "measured": ("sample", np.concatenate([r.outputs[0] for r in records]) / size, amplitude),
        "base": ("sample", joined(given.base) / size, amplitude),
        "unseen": ("sample", joined(given.unseen)),
    }
    if given.amended is not None:
        found["amended"] = ("sample", joined(given.amended) / size, amplitude)
    for one in diagnosis.further:
        found[f"{one.reading}_measured"] = (
            "sample",
            np.concatenate([record.reading(one.reading) for record in records]),
        )
        found[f"{one.reading}_base"] = ("sample", joined(one.base))
        if one.amended is not None:
            found[f"{one.reading}_amended"] = ("sample", joined(one.amended))
    return found


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Described):
    """Verdict of a diagnosis, with all results that support it.

    Amplitudes are in the unit that `output` names. In a diagnosis that was loaded from its file, the fields from
    `model` to `findings` are empty.

    Parameters
    ----------
    output : Output
        ``name`` and ``unit`` of the reading.
    verdict : Verdict
        Conclusion of the diagnosis.
    noise, model_error : float
        Sensor noise and model error of the plant, rms.
    detection : DetectionSummary
        Test for missing physics, and the smallest detectable effects.
    location : LocationSummary or None
        Location of the mismatch; None if nothing is missing.
    causes : tuple of Cause
        Effects of the best explanation, each with its parameters and its probability.
    names : tuple of str
        Effects of the best explanation and of all alternatives (``set`` in the file).
    rivals : tuple of tuple of str
        Effects of each alternative explanation that the recordings do not rule out. An empty tuple is the plant without
        effects.
    explanations : tuple of Explanation
        Best explanation and then the alternatives, each with its probability. Empty unless the verdict is `named` or
        `ambiguous`.
    indistinguishable : tuple of IndistinguishablePair
        Best explanation paired with each alternative, with the squared distance d² (`Distance`).
    advice : AdviceSummary or None
        Next experiment; None if none is advised.
    unexplained : Unexplained or None
        Mismatch that remains with the effects in `causes`, and its location; None unless the verdict is `partly`.
    free_form : FreeFormSummary or None
        Free form: a force that has no physical name and describes a mismatch that no effect explains; None if there is
        none.
    sentence : str
        Conclusion in plain words; each number in it is a field of the file.
    fit : FitSummary
        Rms residuals without and with the effects in `causes`, on fitted and on held-out data.
    verification : VerificationSummary or None
        Results of the tests that `verify` applies to the best explanation; None if there is no explanation.
    faults : tuple of Fault
        Faults of the recordings.
    taught : tuple of ReadingSummary or None
        Residuals of each reading, and the probabilities of the explanations with and without this reading (``readings``
        in the file). None if there is only one reading.
    parameters : mapping of str to FittedParameter
        Parameters of the base plant, which is the calibrated plant without effects.
    forms : tuple of FormSummary
        Interpretations of the rig file that were compared, the chosen one first.
    warnings : tuple of str
        Warnings for the user.
    model, base_model : CalibratedPlant or None
        Calibrated plant with the effects in `causes`, and without them.
    rival_models : mapping of str to CalibratedPlant
        Plant of each alternative explanation, calibrated on the fitted data. A key joins the names of the effects with
        ``+``; it is ``none`` for the plant without effects.
    candidates : tuple of CandidateSummary
        All candidates that were tried, the base plant first.
    readings : Readings or None
        Recorded and simulated values of the first reading.
    further : tuple of Readings
        Recorded and simulated values of all other readings.
    findings : Findings or None
        Results of the steps of the diagnosis, in SI units, as objects with methods such as ``plot``.
    """

    output: Output
    verdict: Verdict
    noise: float = field(metadata=attribute())
    model_error: float = field(metadata=attribute())
    detection: DetectionSummary = field(metadata=key("detect"))
    location: LocationSummary | None = field(metadata=key("locate"))
    causes: tuple[Cause, ...] = ()
    names: tuple[str, ...] = field(default=(), metadata=key("set"))
    rivals: tuple[tuple[str, ...], ...] = ()
    explanations: tuple[Explanation, ...] = ()
    indistinguishable: tuple[IndistinguishablePair, ...] = ()
    advice: AdviceSummary | None = field(default=None, metadata=key("next_experiment"))
    unexplained: Unexplained | None = None
    free_form: FreeFormSummary | None = None
    sentence: str = field(metadata=attribute())
    fit: FitSummary
    verification: VerificationSummary | None = None
    faults: tuple[Fault, ...] = ()
    taught: tuple[ReadingSummary, ...] | None = field(default=None, metadata={**key("readings"), **OPTIONAL})
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
    forms: tuple[FormSummary, ...] = ()
    warnings: tuple[str, ...] = ()
    model: CalibratedPlant | None = field(default=None, metadata=INTERNAL)
    base_model: CalibratedPlant | None = field(default=None, metadata=INTERNAL)
    rival_models: Mapping[str, CalibratedPlant] = field(default_factory=dict, metadata=INTERNAL)
    candidates: tuple[CandidateSummary, ...] = field(default=(), metadata=INTERNAL)
    readings: Readings | None = field(default=None, metadata=INTERNAL)
    further: tuple[Readings, ...] = field(default=(), metadata=INTERNAL)
    findings: Findings | None = field(default=None, metadata=INTERNAL)

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "verdict": attribute(),
        "advice_of_the_verdict": attribute(name="advice", of=attrgetter("verdict.advice")),
        "output_name": attribute(of=attrgetter("output.name")),
        "output_unit": attribute(of=attrgetter("output.unit")),
        "set": attribute(of=lambda diagnosis: list(diagnosis.names)),
        "warnings": attribute(of=lambda diagnosis: list(diagnosis.warnings)),
        "p_value": attribute(of=attrgetter("detection.p_value")),
        "excess": attribute(of=attrgetter("detection.excess")),
        "practical": attribute(of=attrgetter("detection.practical")),
        "taken_up": attribute(of=attrgetter("detection.taken_up")),
        "moved": attribute(of=attrgetter("detection.moved")),
        "tables": several(_tables),
        "readings": several(_readings),
        "samples": several(
            lambda diagnosis: {} if diagnosis.readings is None else samples(diagnosis.readings.experiments), "coords"
        ),
        "document": document(lambda diagnosis: diagnosis.to_dict()),
    }

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``."""
        data = {"schema": SCHEMA, **plain(self)}
        data["locate"] = data["locate"] or plain(NOWHERE)
        for cause, held in zip(self.causes, data["causes"], strict=True):
            for name, parameter in cause.parameters.items():
                held["parameters"][name]["shown"] = plain(parameter.shown)
        return data

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the residuals without and with the effects found over time, with the held-out part shaded.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; a new figure by default.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        ModelError
            If the diagnosis was loaded from its file, which does not contain the readings.
        """
        if self.readings is None:
            raise ModelError("this diagnosis has no evidence to draw: a file keeps the conclusions, not the recordings")
        axes = axes_or_new(ax)
        draw_residuals(self.readings, self.output.unit, axes)
        names = " and ".join(spaced(cause.effect) for cause in self.causes)
        axes.set_title(f"{spaced(self.verdict.value)}{': ' if names else ''}{names}")
        return axes

    @classmethod
    @of_plain_data()
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make the diagnosis from the data that `to_dict` returned.

        Parameters
        ----------
        data : mapping
            Content of ``diagnosis.json``.

        Returns
        -------
        Diagnosis

        Raises
        ------
        ModelError
            If a field is missing or malformed.
        """
        somewhere = data["locate"] if any(data["locate"].values()) else None
        found = read(cls, {**data, "locate": somewhere})
        found._require_consistent()
        return found

    def _require_consistent(self) -> None:
        """Raise an error if causes or unexplained part do not fit the verdict."""
        for name, there, due in (
            ("causes", bool(self.causes), self.verdict.has_causes),
            ("unexplained", self.unexplained is not None, self.verdict is Verdict.PARTLY),
        ):
            if there is not due:
                raise ModelError(
                    f'malformed diagnosis: the verdict "{self.verdict.value}" with{"" if there else "out"} {name}'
                )

    def save(self, path: Path | str) -> None:
        """Write ``diagnosis.json``.

        Parameters
        ----------
        path : path
            File to write; an existing one is replaced.
        """
        write_document(path, self.to_dict())

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a diagnosis that `save` wrote.

        Parameters
        ----------
        path : path
            A ``diagnosis.json``.

        Returns
        -------
        Diagnosis

        Raises
        ------
        ModelError
            If the file is not a diagnosis.
        """
        return read_document(path, SCHEMA, cls.from_dict)
