"""The result of a diagnosis: a verdict with its evidence, as data and as the file ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from deatwin.ident.mismatch.evidence import Evidence
from deatwin.ident.mismatch.layout import draw_residuals
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.prefixes import prefixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SCHEMA = "deatwin/diagnosis/1"
NOTHING = 1e-3
"""Share of its interval below which a value is written as 0."""


class Verdict(Enum):
    """What a diagnosis concludes; the advice says what to do with it."""

    NONE = "none"
    PARAMETERS = "parameters"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    DISTURBANCE = "disturbance"
    DATA_FAULT = "data_fault"
    NOT_TESTABLE = "not_testable"

    @property
    def advice(self) -> str:
        """What the verdict means for the user."""
        return _ADVICE[self]


_ADVICE: Mapping[Verdict, str] = {
    Verdict.NONE: "no physics is missing beyond the sensor's noise and the plant's own model error",
    Verdict.PARAMETERS: "only the parameters were off: use the calibrated plant",
    Verdict.NAMED: "use the amended plant",
    Verdict.AMBIGUOUS: "something is missing, but these recordings cannot tell the rivals apart",
    Verdict.UNKNOWN: "something is missing that no effect of the catalogue explains: do not trust the plant there",
    Verdict.DISTURBANCE: "the mismatch does not repeat with input and state: look for a disturbance",
    Verdict.DATA_FAULT: "the recording is at fault: repeat it, or use the sound part",
    Verdict.NOT_TESTABLE: "the input is too poor to test anything: excite more",
}


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A parameter with its 95 % interval.

    Parameters
    ----------
    value, low, high : float
        SI.
    unit : str
        SI unit.
    """

    value: float
    low: float
    high: float
    unit: str

    @property
    def shown(self) -> dict[str, Any]:
        """The same as a person writes it: ``value``, ``low`` and ``high`` in a ``unit`` with a prefix.

        A value that is nothing beside its interval about zero, as on a bound there, is 0.
        """
        nothing = self.low <= 0.0 <= self.high and abs(self.value) < NOTHING * (self.high - self.low)
        value = 0.0 if nothing else self.value
        size, unit = prefixed(value or max(self.high, -self.low), self.unit)
        return {"value": value / size, "low": self.low / size, "high": self.high / size, "unit": unit}


@dataclass(frozen=True, kw_only=True)
class FittedParameter(Interval):
    """A parameter of the calibrated plant.

    Parameters
    ----------
    value, low, high : float
        With its 95 % interval, SI.
    unit : str
        SI unit.
    nominal : float or None
        Before the calibration, SI.
    at_bound : bool
        Whether it ended on a bound of its range.
    undetermined : bool
        Whether its interval is its whole allowed range: the recordings say nothing of it.
    """

    nominal: float | None = None
    at_bound: bool = False
    undetermined: bool = False


@dataclass(frozen=True, kw_only=True)
class Cause:
    """An effect that the recordings ask for.

    Parameters
    ----------
    effect, family : str
        Canonical names.
    probability : float
        Of this effect being part of the truth: among the explanations compared, less a margin for what nobody compared.
    share_explained : float
        Share of the mismatch's energy that goes with it, from 0 to 1.
    parameters : mapping of str to Interval
        The effect's own parameters.
    """

    effect: str
    family: str
    probability: float
    share_explained: float
    parameters: Mapping[str, Interval]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """A verdict with its evidence. Amplitudes are in the unit that `output` names.

    Parameters
    ----------
    output : mapping
        ``name`` and ``unit`` of the reading.
    verdict : Verdict
        The conclusion.
    noise, model_error : float
        Rms of the sensor's noise and of the plant's own model error.
    detect, locate : mapping
        As in the file: p-value, excess and smallest detectable size; time, frequency, region, place and
        response (orders and bands of the frequency response).
    causes : tuple of Cause
        What is built into the amended plant.
    names : tuple of str
        Effects that could be the explanation (``set`` in the file).
    rivals : tuple of tuple of str
        Effects of each other explanation that the recordings do not rule out; empty for the plant without any.
    indistinguishable : tuple of mapping
        Pairs of explanations with their distance d².
    sentence : str
        The conclusion in plain words; each number in it is a field of the file.
    fit : mapping
        Rms residual before and after, on the fitted and on the unseen part.
    next_experiment, free_form : mapping or None
        Advice and free-form remainder, where there are any.
    verification : mapping or None
        What the best explanation had to bear, where there was one: ablation, shams, transfer, constancy.
    faults : tuple of mapping
        Faults of the recordings.
    parameters : mapping of str to FittedParameter
        Of the calibrated base plant.
    forms : tuple of mapping
        The ways to read the rig file that competed, the one chosen first: ``form``, what is read otherwise than in the
        file or where it is silent, and ``fitted`` and ``unseen``, the rms residuals without any effect.
    warnings : tuple of str
        What the user should know besides.
    model : CalibratedPlant or None
        The calibrated, amended plant; in a file of its own.
    evidence : Evidence or None
        Recordings beside simulations; not in the file.
    """

    output: Mapping[str, str]
    verdict: Verdict
    noise: float
    model_error: float
    detect: Mapping[str, Any]
    locate: Mapping[str, Any]
    sentence: str
    fit: Mapping[str, Any]
    causes: tuple[Cause, ...] = ()
    names: tuple[str, ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    indistinguishable: tuple[Mapping[str, Any], ...] = ()
    next_experiment: Mapping[str, Any] | None = None
    free_form: Mapping[str, Any] | None = None
    verification: Mapping[str, Any] | None = None
    faults: tuple[Mapping[str, Any], ...] = ()
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
    forms: tuple[Mapping[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    model: CalibratedPlant | None = None
    evidence: Evidence | None = None

    def to_dict(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        return {
            "schema": SCHEMA,
            "output": dict(self.output),
            "verdict": self.verdict.value,
            "noise": self.noise,
            "model_error": self.model_error,
            "detect": dict(self.detect),
            "locate": dict(self.locate),
            "causes": [_cause_to_dict(cause) for cause in self.causes],
            "set": list(self.names),
            "rivals": [list(effects) for effects in self.rivals],
            "indistinguishable": [dict(pair) for pair in self.indistinguishable],
            "next_experiment": self.next_experiment,
            "free_form": self.free_form,
            "sentence": self.sentence,
            "fit": dict(self.fit),
            "verification": self.verification,
            "faults": [dict(fault) for fault in self.faults],
            "parameters": {name: asdict(p) for name, p in self.parameters.items()},
            "forms": [dict(form) for form in self.forms],
            "warnings": list(self.warnings),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the residual before and after over time, the unseen part shaded, with the verdict as the title.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            A new figure without it.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        ModelError
            If there is no evidence to draw: a file holds the conclusions, not the recordings.
        """
        if self.evidence is None:
            raise ModelError("this diagnosis has no evidence to draw: a file keeps the conclusions, not the recordings")
        axes = axes_or_new(ax)
        draw_residuals(self.evidence, self.output["unit"], axes)
        names = " and ".join(cause.effect.replace("_", " ") for cause in self.causes)
        axes.set_title(f"{self.verdict.value.replace('_', ' ')}{': ' if names else ''}{names}")
        return axes

    def to_xarray(self) -> Any:
        """Return tables and readings as an `xarray.Dataset`; see `deatwin.ident.mismatch.datasets.dataset_of`."""
        from deatwin.ident.mismatch.datasets import dataset_of

        return dataset_of(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The diagnosis that `to_dict` described.

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
        try:
            causes = tuple(_cause_from_dict(cause) for cause in data["causes"])
            same = (
                "output",
                "noise",
                "model_error",
                "detect",
                "locate",
                "sentence",
                "fit",
                "next_experiment",
                "free_form",
            )
            return cls(
                verdict=Verdict(data["verdict"]),
                causes=causes,
                names=tuple(data["set"]),
                rivals=tuple(tuple(effects) for effects in data.get("rivals", ())),
                indistinguishable=tuple(data["indistinguishable"]),
                warnings=tuple(data["warnings"]),
                verification=data.get("verification"),
                faults=tuple(data.get("faults", ())),
                parameters={name: FittedParameter(**p) for name, p in data.get("parameters", {}).items()},
                forms=tuple(data.get("forms", ())),
                **{name: data[name] for name in same},
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"malformed diagnosis: {error!r}") from None

    def save(self, path: Path | str) -> None:
        """Write ``diagnosis.json``.

        Parameters
        ----------
        path : path
            File to write; replaced as a whole.
        """
        write_document(path, self.to_dict())

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read what `save` wrote.

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
            If it is no such file.
        """
        return read_document(path, SCHEMA, cls.from_dict)


def _cause_to_dict(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "family": cause.family,
        "probability": cause.probability,
        "share_explained": cause.share_explained,
        "parameters": {name: {**asdict(p), "shown": p.shown} for name, p in cause.parameters.items()},
    }


def _cause_from_dict(data: Mapping[str, Any]) -> Cause:
    parameters = {
        name: Interval(**{key: value for key, value in p.items() if key != "shown"})
        for name, p in data["parameters"].items()
    }
    return Cause(**{**data, "parameters": parameters})
