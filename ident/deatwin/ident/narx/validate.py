"""Validation of a NARX model on recordings: fit one step ahead and in free run, correlation tests, whiteness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from deatwin.ident.arguments import probability, whole_number
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.notes import late_inputs
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.residual_tests import CorrelationTest, Whiteness, correlation_tests, whiteness_of
from deatwin.ident.narx.response import Fit, gain_error
from deatwin.ident.narx.unstable import Unstable, recorded_once, stable_model_of_unstable, unstable_model
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, Variables, attribute, coordinate, several, status_of, variable
from deatwin.plant.documents import Saved
from deatwin.plant.drawing import Axes, panels_or_new
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.records import plain, read

SCHEMA = "deatwin/validation/1"

_WITH_INPUT = ("ue", "(u2)'e", "(u2)'e2")
_LEAST_SAMPLES = 4  # samples for each lag that is tested
_ROUNDING = 1e-13  # share of the largest output below which residuals are rounding errors of the arithmetic
_DIGITS = 1e-8  # share of the output's deviation that a file's nine digits may round: no sensor has 160 dB


class ValidationStatus(Enum):
    """Outcome of a validation. The value of each member is a message for the user."""

    PASSED = "nothing is left to explain: the residual is white and independent of the input"
    NOISE = (
        "the residual is predictable from its own past but not from the input alone: the terms without noise are adequate, "
        "but a noise model (terms in e) is missing"
    )
    STRUCTURE = "the residual depends on the input: terms are missing, or the lags or the degree are too small"
    UNSTABLE = (
        "the model is unstable and the recorded output is not: if the plant is unstable too, the recording was made in "
        "a closed loop, and a free run diverges whatever the model; use predictions several steps ahead instead"
    )
    DIVERGED = "the free run diverges: choose another structure, or stay within the operating range"
    EXACT = "the residual is rounding error: there is nothing to test"

    @property
    def ok(self) -> bool:
        """True if the model may be used as it is."""
        return self in (ValidationStatus.PASSED, ValidationStatus.EXACT)


def _fits(found: Validation) -> Variables:
    return {
        f"{run}_{name}": ("output", getattr(getattr(found, run), name))
        for run in ("one_step", "free_run")
        for name in ("mean_square", "nrmse", "percent")
    }


def _lags(found: Validation) -> Array:
    return np.unique(np.concatenate([test.lags for test in found.tests] or [np.zeros(0, dtype=np.int64)]))


def _correlations(found: Validation) -> Variables:
    """Return the tests over all lags; NaN at lags that a test does not have."""
    lags = _lags(found)
    values = np.full((len(found.tests), lags.size), np.nan)
    for row, test in zip(values, found.tests, strict=True):
        row[np.searchsorted(lags, test.lags)] = test.values
    return {
        "correlation": (("test", "lag"), values),
        "band": ("test", [test.band for test in found.tests]),
        "p_value": ("test", [test.p_value for test in found.tests]),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation(
    Described,
    Saved,
    schema=SCHEMA,
    document=lambda found: found.to_json(),
    fields=lambda document: _fields_of(document),
):
    """Result of `validate`: errors of a model on recordings, and tests of its residuals.

    Parameters
    ----------
    one_step : Fit
        Fit of the prediction one step ahead from the measured past; its ``mean_square`` is the mean squared prediction
        error (MSPE).
    free_run : Fit
        Fit of the simulation from the first measured samples and the inputs; its ``mean_square`` is the mean squared
        simulation error (MSSE).
    diverged : tuple of (int, float)
        Index of each recording whose free run diverged, and the time of divergence on the recording's clock, in s.
    tests : tuple of CorrelationTest
        Correlation tests of the residual of each output: with its own past, with each input that is not constant, and
        with the residual of each other output.
    whiteness : tuple of Whiteness
        Whiteness test (Ljung and Box) of the residual of each output.
    n_samples : int
        Number of residuals of each output.
    level : float
        Significance level: probability that a single test fails although the model is adequate.
    exact : bool
        True if the residual is only rounding error; there are then no tests.
    input_names, output_names, output_units : tuple of str
        Names and units of the signals.
    unstable : Unstable or None
        Unstable pole, and the fit of predictions over the time in which its mode grows by a factor of e; None unless
        the model is certainly unstable.
    gain_error : float or None
        Slope of the recorded output over the free run, minus 1; positive if the recorded output varies more. None if
        the free run is constant or diverges, or if there are several outputs.
    gain_error_half_width : float or None
        Half width of the 95 % interval of ``gain_error``; None if ``gain_error`` is None.
    notes : tuple of str
        Further remarks on the model; usually empty. They state that the plant reacts to an input later than the model's
        largest lag of that input, or that the plant has an unstable pole that the model lacks.
    """

    one_step: Fit
    free_run: Fit
    diverged: tuple[tuple[int, float], ...]
    tests: tuple[CorrelationTest, ...]
    whiteness: tuple[Whiteness, ...]
    n_samples: int
    level: float = 0.05
    exact: bool = False
    input_names: tuple[str, ...] = ("input",)
    output_names: tuple[str, ...] = ("output",)
    output_units: tuple[str, ...] = ("",)
    unstable: Unstable | None = None
    gain_error: float | None = None
    gain_error_half_width: float | None = None
    notes: tuple[str, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "fits": several(_fits),
        "tests": several(_correlations),
        "whiteness_p_value": variable("whiteness", of=lambda found: [each.p_value for each in found.whiteness]),
        "output": coordinate("output", of=lambda found: list(found.output_names)),
        "unit": coordinate("output", of=lambda found: list(found.output_units)),
        "test": coordinate("test", of=lambda found: np.array([found._label(each) for each in found.tests], dtype=str)),
        "lag": coordinate("lag", of=lambda found: _lags(found)),
        "n_samples": attribute(),
        "level": attribute(),
        "exact": attribute(),
        "status": status_of(),
        "diverged_at_s": attribute(of=lambda found: [time for _, time in found.diverged]),
    }

    @property
    def failed(self) -> tuple[CorrelationTest, ...]:
        """Tests with a p-value below ``level / len(tests)`` (Bonferroni).

        For an adequate model, the probability that any test is listed is at most ``level``.
        """
        return tuple(test for test in self.tests if test.p_value < self.level / len(self.tests))

    @property
    def status(self) -> ValidationStatus:
        """Joint result of the tests, unless the model is unstable or its free run diverged."""
        if self.unstable is not None:
            return ValidationStatus.UNSTABLE
        if self.diverged:
            return ValidationStatus.DIVERGED
        if self.exact:
            return ValidationStatus.EXACT
        if any(test.name in _WITH_INPUT for test in self.failed):
            return ValidationStatus.STRUCTURE
        return ValidationStatus.NOISE if self.failed else ValidationStatus.PASSED

    def test(self, name: str, *, output: int = 0, other: int = 0) -> CorrelationTest:
        """Return the test `name`: "ee", "ue", "e(eu)", "(u2)'e", "(u2)'e2", or "ee'" between two outputs.

        `output` is the row index of the output, and `other` that of the input or of the other output, ignored for "ee".
        ModelError if there is no such test, for example because the input is constant.
        """
        for test in self.tests:
            if (test.name, test.output) == (name, output) and test.other in (None, other):
                return test
        known = list(dict.fromkeys(test.name for test in self.tests))
        raise ModelError(
            f"there is no test {name!r} of output {output} with {other}{nearest(name, known)}; "
            f"there are {', '.join(known) or 'none'}, and none with an input that is constant"
        )

    def plot(self, axes: Sequence[Axes] | None = None, *, output: int = 0, input: int = 0) -> list[Axes]:
        """Draw the correlation tests of an output and an input, given by row: five, or fewer if the input is constant.

        Each has its 95 % band. `axes` are the axes to draw on, new ones if omitted; ModelError if they are too few.
        """
        drawn = [t for t in self.tests if t.output == output and t.name != "ee'" and t.other in (None, input)]
        panels = panels_or_new(axes, len(drawn), height=1.8)
        for test, ax in zip(drawn, panels, strict=True):
            test.plot(ax)
            ax.set_xlabel("" if test is not drawn[-1] else ax.get_xlabel())
        return panels

    def __str__(self) -> str:
        lines = [f"{self.n_samples} samples: {self.status.value}"]
        if self.unstable is not None:
            lines += self.unstable.sentences(self.output_units)
        lines += self.notes
        for record, time in self.diverged:
            lines.append(f"the free run of recording {record + 1} diverged at {time:g} s")
        lines.append(f"{'output':16s}{'MSPE':>11s}{'NRMSE':>9s}{'fit %':>8s}{'MSSE':>13s}{'NRMSE':>9s}{'fit %':>8s}")
        for i, name in enumerate(self.output_names):
            one, free = self.one_step, self.free_run
            lines.append(
                f"{name[:15]:16s}{one.mean_square[i]:11.4g}{one.nrmse[i]:9.4f}{one.percent[i]:8.2f}"
                f"{free.mean_square[i]:13.4g}{free.nrmse[i]:9.4f}{free.percent[i]:8.2f}"
            )
        lines.append(f"{'test':30s}{'largest':>9s}{'band':>8s}{'outside':>9s}{'p':>9s}")
        for t in self.tests:
            lines.append(
                f"{self._label(t):30s}{t.largest:9.3f}{t.band:8.3f}{100 * t.share_outside:7.0f} %{t.p_value:9.2g}"
                f"  {'passes' if t.passed else 'fails'}"
            )
        for w in self.whiteness:
            lines.append(f"Ljung-Box, {self.output_names[w.output]}: {w.statistic:.1f} on {w.dof}, p = {w.p_value:.2g}")
        return "\n".join(lines)

    def _label(self, test: CorrelationTest) -> str:
        """Return the name of a test, with its signals if there are several."""
        names = [self.output_names[test.output]]
        if test.other is not None:
            names.append((self.output_names if test.name == "ee'" else self.input_names)[test.other])
        several = len(self.output_names) + len(self.input_names) > 2
        return f"phi {test.name}" + (f" ({', '.join(names)})" if several else "")

    def to_json(self) -> dict[str, Any]:
        """Return the validation as plain data ("deatwin/validation/1"), with null for infinite values."""
        unstable = None
        if self.unstable is not None:
            pole, recorded = self.unstable.pole, self.unstable.recorded_pole
            unstable = {
                "pole": [pole.real, pole.imag],
                "sample_time_s": self.unstable.sample_time,
                "steps": self.unstable.steps,
                "ahead": self.unstable.ahead.document,
                "recorded_pole": None if recorded is None else [recorded.real, recorded.imag],
                "interval": None if self.unstable.interval is None else list(self.unstable.interval),
            }
        return {
            "schema": SCHEMA,
            "status": self.status.name.lower(),
            "advice": self.status.value,
            "n_samples": self.n_samples,
            "level": self.level,
            "exact": self.exact,
            "inputs": list(self.input_names),
            "outputs": [
                {"name": name, "unit": unit} for name, unit in zip(self.output_names, self.output_units, strict=True)
            ],
            "one_step": self.one_step.document,
            "free_run": self.free_run.document,
            "unstable": unstable,
            "gain_error": self.gain_error,
            "gain_error_half_width": self.gain_error_half_width,
            "notes": list(self.notes),
            "diverged": [{"recording": record, "time_s": time} for record, time in self.diverged],
            "tests": plain(self.tests),
            "whiteness": plain(self.whiteness),
        }


def validate(model: NarxModel, recordings: Recordings, *, max_lag: int = 25, level: float = 0.05) -> Validation:
    """Compare a model with recordings one step ahead and in free run, and test the residual.

    The tests use the residuals of the one-step prediction. They are most informative on held-out data, because on
    training data the residual is a little smaller and whiter than the noise. In long recordings, the tests detect
    faults that are too small to matter: look at ``CorrelationTest.largest`` too.

    Parameters
    ----------
    model : NarxModel
        Model to validate.
    recordings : Recording, Experiment, or several
        Recordings in the model's units.
    max_lag : int
        Largest lag of the correlations in samples.
    level : float
        Significance level: probability that a single test fails although the model is adequate.

    Raises
    ------
    ModelError
        If a recording does not suit the model, or there are too few samples for the lags.
    """
    require_model(model)
    whole_number(max_lag, "max_lag")
    probability(level)
    chosen = flatten(recordings)
    predicted = [model.predict(record) for record in chosen]
    simulated = [model.simulate(record) for record in chosen]
    residuals = [response.residuals for response in predicted]
    n_samples = sum(residual.shape[1] for residual in residuals)
    if n_samples < (needed := _LEAST_SAMPLES * max_lag):
        raise ModelError(
            f"{n_samples} samples after the model's lags are too few to test its residuals: correlations over "
            f"{max_lag} lags need {needed}"
        )
    largest = np.max([np.abs(record.outputs).max(axis=1) for record in chosen], axis=0)
    spread = np.concatenate([record.outputs for record in chosen], axis=1).std(axis=1)
    rounding = np.maximum(_ROUNDING * largest, _DIGITS * spread)
    exact = bool(np.any(np.sqrt(Fit.of(predicted).mean_square) <= rounding))
    inputs = [record.inputs[:, response.first :] for record, response in zip(chosen, predicted, strict=True)]
    rows = range(model.n_outputs)
    diverged = tuple((i, r.failed_at_s) for i, r in enumerate(simulated) if r.failed_at_s is not None)
    recorded = recorded_once(model, chosen)
    unstable = unstable_model(model, chosen, recorded, diverged=any(not run.status.ok for run in simulated))
    bounded = not diverged and unstable is None
    gain = gain_error(simulated) if bounded and model.n_outputs == 1 else None
    lacking = stable_model_of_unstable(model, chosen, recorded) if bounded and not exact else ""
    return Validation(
        one_step=Fit.of(predicted),
        free_run=Fit.of(simulated),
        diverged=diverged,
        tests=() if exact else correlation_tests(residuals, inputs, max_lag=max_lag, level=level),
        whiteness=() if exact else tuple(whiteness_of(residuals, row, max_lag=max_lag) for row in rows),
        n_samples=n_samples,
        level=level,
        exact=exact,
        input_names=model.input_names,
        output_names=model.output_names,
        output_units=model.output_units,
        unstable=unstable,
        gain_error=None if gain is None else gain[0],
        gain_error_half_width=None if gain is None else gain[1],
        notes=(*(() if exact else late_inputs(model, chosen)), *([lacking] if lacking else [])),
    )


def _fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    unstable = None
    if (told := document["unstable"]) is not None:
        unstable = Unstable(
            pole=complex(*told["pole"]),
            sample_time=float(told["sample_time_s"]),
            steps=int(told["steps"]),
            ahead=Fit.read(told["ahead"]),
            recorded_pole=None if told["recorded_pole"] is None else complex(*told["recorded_pole"]),
            interval=None if told["interval"] is None else tuple(told["interval"]),
        )
    return {
        "unstable": unstable,
        "gain_error": document["gain_error"],
        "gain_error_half_width": document["gain_error_half_width"],
        "notes": tuple(document["notes"]),
        "one_step": Fit.read(document["one_step"]),
        "free_run": Fit.read(document["free_run"]),
        "diverged": tuple((int(item["recording"]), float(item["time_s"])) for item in document["diverged"]),
        "tests": tuple(read(CorrelationTest, test) for test in document["tests"]),
        "whiteness": tuple(read(Whiteness, found) for found in document["whiteness"]),
        "n_samples": int(document["n_samples"]),
        "level": float(document["level"]),
        "exact": bool(document["exact"]),
        "input_names": tuple(document["inputs"]),
        "output_names": tuple(signal["name"] for signal in document["outputs"]),
        "output_units": tuple(signal["unit"] for signal in document["outputs"]),
    }
