"""Result of planning an experiment."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.mismatch.advise.advice import write_input
from deatwin.ident.mismatch.advise.offer import SensorOffer
from deatwin.plant.amplitudes import axis_label, written_unit
from deatwin.plant.drawing import Axes, axes_or_new, plain_numbers
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording
from deatwin.plant.records import INTERNAL, plain
from deatwin.plant.words import spaced

SCHEMA = "deatwin/plan/1"


@dataclass(frozen=True, kw_only=True)
class Foreseen:
    """Detectability of one effect in a planned experiment.

    Parameters
    ----------
    effect, family : str
        Canonical names of the effect and of its family.
    strength : str
        Name of the parameter that is the strength of the effect.
    unit : str
        SI unit of the strengths.
    typical : float
        Typical strength, in `unit`.
    change : float
        Rms change that the effect causes in the readings at its typical strength, in the unit `ExperimentPlan.unit`.
    smallest : float or None
        Smallest strength, in `unit`, at which the effect would be detected. None if the effect would not be detected at
        any strength within the range of the parameter.
    smallest_change : float or None
        Rms change that the effect causes in the readings at the smallest strength, in the unit `ExperimentPlan.unit`.
    alike : tuple of str
        Effects from which this effect, at its typical strength, could not be distinguished, the most similar first.
    """

    effect: str
    family: str
    strength: str
    unit: str
    typical: float
    change: float
    smallest: float | None
    smallest_change: float | None
    alike: tuple[str, ...]

    @property
    def visible(self) -> bool:
        """True if the effect would be detected at its typical strength."""
        return self.smallest is not None and self.smallest <= abs(self.typical)

    @property
    def sentence(self) -> str:
        """The strength at which the effect would be detected, in one sentence."""
        name = spaced(self.effect)
        if self.smallest is None:
            return f"{name}: not detected at any strength within its range"
        least = with_unit(self.smallest, self.unit)
        shown = f"{name}: detected if its {spaced(self.strength)} is {least} or larger"
        others = ", ".join(spaced(other) for other in self.alike)
        return f"{shown}; not distinguished from {others}" if others else shown


@dataclass(frozen=True, kw_only=True)
class TellingReading(SensorOffer):
    """Additional reading, with the pairs of effects that could be distinguished only with this reading.

    Parameters
    ----------
    reading, unit : str
        Name of the signal, and its SI unit.
    noise : float
        Standard deviation of the reading's noise, SI.
    noise_source : str
        Source of the value of `noise`.
    tells : tuple of tuple of str
        Pairs of effects, at their typical strengths, that the rig's own readings do not distinguish, but this one does.
    left : int
        Number of pairs of effects that the rig's own readings do not distinguish.
    """

    tells: tuple[tuple[str, ...], ...]
    left: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ExperimentPlan:
    """Plan of an experiment: the effects that it would reveal, each with the smallest strength that is detected.

    Parameters
    ----------
    output : str
        Name of the reading.
    unit : str
        Unit of the changes of the readings, of the noise and of the model error.
    noise, model_error : float
        Sensor noise and model error of the plant, rms, in `unit`.
    seconds : float
        Length of the input, s.
    waveform : str
        Description of the input if it is advised; empty if it was given.
    effects : tuple of Foreseen
        All effects that can be added to the plant, also those too weak to be detected. They are sorted by the ratio of the smallest strength that is detected to the
        typical strength, the smallest ratio first.
    impossible : tuple of str
        Effects with which the plant could not be simulated.
    tried : mapping of str to float
        For each waveform that was tried, the probability that an effect is confused with the most similar other effect,
        averaged over the effects. Empty if the input was given.
    readings : tuple of TellingReading
        Additional readings that the rig could have, the most informative first.
    recording : Recording
        The input, with the readings of the nominal plant.
    """

    output: str
    unit: str
    noise: float
    model_error: float
    seconds: float
    waveform: str
    effects: tuple[Foreseen, ...]
    impossible: tuple[str, ...]
    tried: dict[str, float]
    readings: tuple[TellingReading, ...]
    recording: Recording = field(metadata=INTERNAL)

    @property
    def sentence(self) -> str:
        """The plan in one sentence."""
        seen = [one for one in self.effects if one.visible]
        alone = [one for one in seen if not one.alike]
        told = "all" if len(alone) == len(seen) else f"{len(alone) or 'none'}"
        of = f" of {self.seconds:.3g} s"
        what = f"the best input that was tried ({self.waveform}{of})" if self.waveform else f"this input{of}"
        return (
            f"with {what}, {len(seen)} of {len(self.effects)} effects would be detected at their typical strengths"
            f"{f', and {told} of these could be distinguished from every other effect' if seen else ''}{self._more}"
        )

    @property
    def _more(self) -> str:
        """State what the best additional reading would distinguish."""
        best = next((one for one in self.readings if one.tells), None)
        if best is None:
            return ""
        return (
            f"; {best.words} ({best.noise_source}) would also distinguish {len(best.tells)} of the {best.left} pairs of "
            "effects that this input cannot distinguish"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, in the format of ``plan.json``.

        Returns
        -------
        dict
        """
        rows = [{**plain(one), "visible": one.visible} for one in self.effects]
        return {"schema": SCHEMA, "sentence": self.sentence, **plain(self), "effects": rows}

    def save_input(self, path: Path | str) -> None:
        """Write the input as a CSV file with columns such as ``time_s,command_V``, for `deatwin simulate` or a drive.

        Parameters
        ----------
        path : path
            File to write.
        """
        write_input(path, self.recording)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw ``smallest_change`` and ``change`` of each effect, that is, at its smallest and its typical strength.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; created if omitted.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        shown = [(one, one.smallest_change) for one in self.effects if one.smallest_change is not None][::-1]
        places, least = np.arange(len(shown)), np.array([change for _, change in shown])
        typical = np.array([one.change for one, _ in shown])
        axes.hlines(places, np.minimum(least, typical), np.maximum(least, typical), color="tab:gray", linewidth=1)
        axes.plot(least, places, "o", color="tab:blue", label="smallest change that is detected")
        axes.plot(typical, places, "d", color="tab:orange", label="change at the typical strength")
        axes.axvline(self.noise, color="tab:gray", linestyle=":", label="sensor noise")
        axes.set_yticks(places, [spaced(one.effect) for one, _ in shown])
        axes.set(xscale="log", xlabel=axis_label("change of the reading, rms", written_unit(self.unit)))
        plain_numbers(axes.xaxis)
        axes.legend(fontsize="small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        return axes
