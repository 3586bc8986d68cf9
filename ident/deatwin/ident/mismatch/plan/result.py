"""Result of planning an experiment."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.mismatch.advise.advice import write_input
from deatwin.ident.mismatch.advise.offer import SensorOffer
from deatwin.plant.amplitudes import axis_label, written_unit
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording
from deatwin.plant.records import INTERNAL, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCHEMA = "deatwin/plan/1"


@dataclass(frozen=True, kw_only=True)
class Foreseen:
    """Detectability of one effect in a planned experiment.

    Parameters
    ----------
    effect, family : str
        Canonical names.
    strength : str
        Name of the parameter that is its strength.
    unit : str
        SI unit of the strength.
    typical : float
        Typical strength.
    change : float
        Rms by which the typical strength changes the readings, in the plan's unit.
    smallest : float or None
        Strength from which on the effect would be found to act; None where no strength within its range would.
    smallest_change : float or None
        Rms by which that changes the readings, in the plan's unit.
    alike : tuple of str
        Effects that could not be told from this one at its typical strength, the most alike first.
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
        """True if the effect would be found to act at its typical strength."""
        return self.smallest is not None and self.smallest <= abs(self.typical)

    @property
    def sentence(self) -> str:
        """Return what the experiment would show of the effect, in one sentence."""
        name = self.effect.replace("_", " ")
        if self.smallest is None:
            return f"{name}: this input does not show it at any strength within its range"
        least = with_unit(self.smallest, self.unit)
        shown = f"{name}: found if its {self.strength.replace('_', ' ')} is {least} or larger"
        others = ", ".join(other.replace("_", " ") for other in self.alike)
        return f"{shown}; not distinguished from {others}" if others else shown


@dataclass(frozen=True, kw_only=True)
class TellingReading(SensorOffer):
    """Reading that was not recorded, and the pairs of effects that it, but not the input, would distinguish.

    Parameters
    ----------
    reading, unit : str
        Name of the signal, and its SI unit.
    noise : float
        Standard deviation of its noise, SI.
    noise_source : str
        Where that is known from.
    tells : tuple of tuple of str
        Pairs of effects, at their typical strengths, that it tells apart.
    left : int
        Number of pairs that the input leaves without it.
    """

    tells: tuple[tuple[str, ...], ...]
    left: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ExperimentPlan:
    """Plan of an experiment: which effects it would reveal, and from which strength on.

    Parameters
    ----------
    output : str
        Name of the reading.
    unit : str
        Unit of all changes of the readings.
    noise, model_error : float
        Rms of the sensor's noise and of the plant's own error, in that unit.
    seconds : float
        Length of the input.
    waveform : str
        What the input looks like, in words, where it is advised; empty where it was given.
    effects : tuple of Foreseen
        The effects that the rig can take, those first of which the least is needed.
    impossible : tuple of str
        Effects with which the plant could not be simulated.
    tried : mapping of str to float
        For each waveform that was tried, the probability of taking an effect for its nearest alternative, averaged over
        the effects; empty where the input was given.
    readings : tuple of TellingReading
        Readings that the rig could have beside its own, the one first that tells most apart.
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
        of = f" of {self.seconds:.3g} s"
        what = f"the best input that was tried ({self.waveform}{of})" if self.waveform else f"this input{of}"
        return (
            f"with {what}, {len(seen)} of {len(self.effects)} effects would be found at their typical strengths, "
            f"and {len(alone)} of them distinguished from all others{self._more}"
        )

    @property
    def _more(self) -> str:
        """Return what the best reading would tell that the rig does not have."""
        best = next((one for one in self.readings if one.tells), None)
        if best is None:
            return ""
        return (
            f"; {best.words} ({best.noise_source}) would also distinguish {len(best.tells)} of the {best.left} pairs of "
            "effects that the input cannot"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, as ``plan.json`` holds it.

        Returns
        -------
        dict
        """
        rows = [{**plain(one), "visible": one.visible} for one in self.effects]
        return {"schema": SCHEMA, "sentence": self.sentence, **plain(self), "effects": rows}

    def save_input(self, path: Path | str) -> None:
        """Write the input as a CSV file, ``time_s,command_V``, that `deatwin simulate` and a drive can take.

        Parameters
        ----------
        path : path
            File to write.
        """
        write_input(path, self.recording)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw for each effect the change of the readings that would be found, beside its typical one.

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
        axes.plot(least, places, "o", color="tab:blue", label="found from here on")
        axes.plot(typical, places, "d", color="tab:orange", label="at its typical strength")
        axes.axvline(self.noise, color="tab:gray", linestyle=":", label="sensor noise")
        axes.set_yticks(places, [one.effect.replace("_", " ") for one, _ in shown])
        axes.set(xscale="log", xlabel=axis_label("change of the reading, rms", written_unit(self.unit)))
        axes.legend()
        return axes
