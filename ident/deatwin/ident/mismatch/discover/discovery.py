"""Result of a search for a free form: its terms, its gain, and its drawing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from deatwin.ident.greybox.filter import Latent
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.discover.dictionary import RATE
from deatwin.ident.mismatch.result import FreeFormSummary, ShapeSummary, TermSummary
from deatwin.ident.mismatch.thresholds import DEVIATIONS
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import (
    Described,
    Metadata,
    Variables,
    attribute,
    columns,
    coordinate,
    several,
    variable,
)
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.primitives import Primitive
from deatwin.plant.model import Plant
from deatwin.plant.records import plain

SHOWN = {"m": ("mm", 1e-3), "m/s": ("mm/s", 1e-3), "N": ("mN", 1e-3)}
"""Units on axes, with their SI size; others are shown as they are."""
BINS, FEWEST = 40, 5
"""Number of bins of the band over the state, and samples that a bin needs."""
NOT_PHYSICS = "fitted formula, without physical meaning"
WORDS = {
    "power": "{x}",
    "magnitude": "|{x}|",
    "signed_square": "{x} |{x}|",
    "dead_band": "{x} beyond a dead band",
    "low_pass": "low-pass of {x}",
    "play": "play of {x}",
    "largest": "largest {x} so far",
    "smallest": "smallest {x} so far",
}
"""Kinds of terms in words."""
VARIABLES = {"command_rate": "rate of the command"}


@dataclass(frozen=True, kw_only=True)
class FoundTerm:
    """One term of a free form."""

    term: Primitive  # with its shape as fitted
    coefficient: float  # factor of the term if its variable is not scaled, in `unit`
    unit: str  # SI
    shape: ShapeSummary | None  # the shape parameter, if any
    inclusion: float  # share of the resampled records that chose it, or one that can hardly be distinguished from it

    @property
    def variable(self) -> str:
        """Return, in words, the variable on which the term depends."""
        return VARIABLES.get(self.term.variable, self.term.variable)

    @property
    def text(self) -> str:
        """Describe the term in words, without its numbers."""
        order = getattr(self.term, "order", 1)
        return WORDS[self.term.kind].format(x=self.variable if order == 1 else f"{self.variable}^{order}")

    @property
    def summary(self) -> TermSummary:
        """Return the summary for a diagnosis; SI."""
        return TermSummary(
            term=self.text, coefficient=self.coefficient, unit=self.unit, shape=self.shape, inclusion=self.inclusion
        )


_output_unit = attrgetter("model.rig.output_unit")


def _term_table(found: Discovery) -> Variables:
    made = dict(columns("term", map(_row, found.terms)))
    made["term_inclusion"] = (*made["term_inclusion"][:2], "", "share of the resampled records that chose it")
    return made


def _along_the_fitted_part(found: Discovery) -> Variables:
    """Return the unknown input along the fitted part, SI, and its smoothed estimate where the readings determine it."""
    first, form, latent = found.terms[0], found.free_form, found.latent
    along: dict[str, Any] = {
        "state": ("sample", found.state, unit_of(first.term.variable, found.model), first.variable),
        "entering": ("sample", found.entering, form.unit, f"added to the {form.node}"),
    }
    if latent is not None:
        along["smoothed"] = ("sample", latent.mean, form.unit, "what entered, given all readings")
        along["deviation"] = ("sample", latent.deviation, form.unit, "standard deviation of what entered")
        along["counted"] = ("sample", latent.counted, "", "whether a reading counts")
        along["part"] = ("sample", latent.origin, "", "number of the part")
    return along


@dataclass(frozen=True, kw_only=True, eq=False)
class Discovery(Described):
    """Free form: a force that is found from the data, reduces the mismatch and has no physical name.

    Parameters
    ----------
    calibration : Calibration
        Plant with the free form, calibrated on the fitted data.
    terms : tuple of FoundTerm
        Terms of the free form, the one with the largest contribution first.
    before, after : float
        Rms error of the free run on held-out data, without and with the free form, SI.
    gain_low : float
        Lower 95 % bound of the decrease of the error from `before` to `after`, SI.
    unseen : ndarray, shape (m,)
        Residuals on held-out data with the free form, SI.
    state : ndarray, shape (n,)
        Signal on which the first term depends, over the fitted data, SI.
    entering : ndarray, shape (n,)
        Force of the free form over the fitted data, in the SI unit of the signal to which it is added.
    latent : Latent or None
        Estimate of the same force by a smoother, directly from the readings and without the terms of the free form.
        None if the readings do not determine the force.
    """

    calibration: Calibration
    terms: tuple[FoundTerm, ...]
    before: float = field(metadata=variable(unit=_output_unit, about="rms error on the held-out part without it"))
    after: float = field(metadata=variable(unit=_output_unit, about="rms error on the held-out part with it"))
    gain_low: float = field(
        metadata=variable(unit=_output_unit, about="lower 95 % bound of the reduction of the rms residual")
    )
    unseen: Array = field(metadata=variable("unseen_sample", unit=_output_unit, about="residual on the held-out part"))
    state: Array
    entering: Array
    latent: Latent | None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "table": several(_term_table),
        "along": several(_along_the_fitted_part),
        "time": coordinate("sample", of=lambda found: None if found.latent is None else found.latent.timepts, unit="s"),
        "place": attribute(of=attrgetter("free_form.enters.value")),
        "signal": attribute(of=attrgetter("free_form.node")),
    }

    @property
    def model(self) -> Plant:
        """The plant with the free form."""
        return self.calibration.plant

    @property
    def free_form(self) -> FreeForm:
        """The free form as an effect of the plant, with the values from which the fit started."""
        return next(effect for effect in self.model.effects if isinstance(effect, FreeForm))

    @property
    def summary(self) -> FreeFormSummary:
        """Summarise the free form for a diagnosis: errors in the unit of `Diagnosis.output`, terms in SI."""
        size = amplitude_unit(self.model.rig.output_unit)[1]
        return FreeFormSummary(
            place=self.free_form.enters.value,
            signal=self.free_form.node,
            terms=tuple(term.summary for term in self.terms),
            before=self.before / size,
            after=self.after / size,
            gain_low=self.gain_low / size,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the force of the free form over the signal on which its first term depends.

        Points show ``latent``, with a band of two standard deviations, unless it is None.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        ax = axes_or_new(ax)
        variable = self.terms[0].term.variable
        unit = unit_of(variable, self.model)
        (across, wide), (up, high) = (SHOWN.get(u, (u, 1.0)) for u in (unit, self.free_form.unit))
        state = self.state / wide
        if self.latent is not None:
            seen = self.latent.counted
            mean, deviation = self.latent.mean[seen] / high, self.latent.deviation[seen] / high
            ax.plot(state[seen], mean, ".", color="0.75", ms=5, zorder=1, label="estimated from the recordings")
            middle, centre, half = _binned(state[seen], mean, deviation)
            band = f"mean ± {DEVIATIONS:g} standard deviations of the estimate"
            ax.fill_between(middle, centre - half, centre + half, color="C0", alpha=0.25, lw=0, zorder=2, label=band)
        ax.plot(state, self.entering / high, ".", color="C3", ms=2, zorder=3, label=NOT_PHYSICS)
        ax.set_xlabel(f"{self.terms[0].variable} ({across})")
        ax.set_ylabel(f"added to the {self.free_form.node} ({up})")
        ax.legend(loc="best", markerscale=2)
        return ax


def _row(term: FoundTerm) -> dict[str, Any]:
    """Return a term as a row of a table."""
    told = plain(term.summary)
    shape = told.pop("shape") or {}
    return {
        "text": told.pop("term"),
        "variable": term.term.variable,
        **told,
        **{f"shape_{key}": value for key, value in shape.items()},
    }


def unit_of(variable: str, plant: Plant) -> str:
    """Return the unit of a plant's signal, `variable`, of which a free form has functions."""
    rig = plant.rig
    rates = {"command_rate": f"{rig.input_unit}/s", RATE: f"{rig.output_unit}/s"}
    known = {"command": rig.input_unit, "time": "s", **rates}
    return known.get(variable, rig.output_unit)


def unit_per(above: str, below: str, degree: int) -> str:
    """Return a unit over a power of another: "N s2/m2" for "N", "m/s" and 2."""
    power = "" if degree == 1 else str(degree)
    length, _, time = below.partition("/")
    return f"{above} {time}{power}/{length}{power}" if time else f"{above}/{length}{power}"


def _binned(state: Array, mean: Array, deviation: Array) -> tuple[Array, Array, Array]:
    """Return the mean state of each bin, the mean force that enters there, and the half-width of its band."""
    edges = np.linspace(state.min(), state.max(), BINS + 1)
    rows = np.clip(np.searchsorted(edges, state, side="right") - 1, 0, BINS - 1)
    filled = [rows == k for k in range(BINS) if np.sum(rows == k) >= FEWEST]
    columns = [(state[k].mean(), mean[k].mean(), DEVIATIONS * np.sqrt(np.mean(deviation[k] ** 2))) for k in filled]
    middle, centre, half = np.array(columns).reshape(-1, 3).T
    return middle, centre, half
