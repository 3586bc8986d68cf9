"""The advice of a diagnosis: an input that would decide between explanations, or another quantity to measure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deatwin.ident.mismatch.advise.offer import PricedReading
from deatwin.ident.mismatch.result import AdviceSummary
from deatwin.ident.mismatch.thresholds import DISTINGUISHED, NEGLIGIBLE
from deatwin.plant.amplitudes import axis_label, written_amplitude
from deatwin.plant.datasets import (
    Described,
    Metadata,
    Variables,
    attribute,
    coordinate,
    several,
    table_along,
    variable,
)
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.effects.titles import effects_in_words
from deatwin.plant.files import write_csv
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.words import listed, spaced

INPUT_FILE = "next_input.csv"
"""Name of the file in which `deatwin diagnose` stores the commands of the advised experiment."""
_COLOURS = ("C0", "C1", "C3", "C4", "C5")  # without the grey of the input


def write_input(path: Path | str, commands: Recording) -> None:
    """Write commands as a CSV file, ``time_s,command_V``, that `deatwin simulate` and a drive can take."""
    name, unit = commands.input_names[0], commands.input_units[0]
    header = name if unit in ("", "1") else f"{name}_{unit}"
    write_csv(path, {"time_s": np.round(commands.timepts, 9), header: commands.inputs[0]})


@dataclass(frozen=True, kw_only=True, eq=False)
class Advice(Described):
    """Advice on the next experiment, which would distinguish the explanations that remain possible.

    The advice rests on the squared distance d² between two explanations (`Distance`) for the new input.

    Parameters
    ----------
    alternatives : tuple of str
        Explanations to be distinguished, the best so far first.
    recording : Recording or None
        Commands of the advised input, without readings; None if no input can distinguish the explanations.
    waveform : str
        Description of the input; empty if there is none.
    added_mass : float or None
        Mass to add to the load before the experiment, kg; None if none is needed.
    measure : str or None
        Signal to measure in addition, if the input alone cannot distinguish all explanations.
    confusion_before, confusion_after : float
        Probability that the nearest wrong explanation fits better than the true one, before and after the advised
        experiment. It is averaged over the explanations, each of which is taken as the true one in turn. Both values
        are equal if no experiment is advised. `confusion_before` is the larger of two estimates: one to first order,
        one from refits to all recordings.
    undecided : tuple of str
        Entries of `alternatives` that the experiment would not distinguish from at least one other entry (d² below 16).
    tried : mapping of str to float
        For each waveform, the smallest d² between two of the explanations, to first order. For this comparison, all
        waveforms have the same length.
    predicted : tuple of ndarray, each of shape (n,)
        Readings that each explanation in `alternatives` predicts for the input, SI. All explanations but the first are
        refitted to the readings that the first one predicts.
    log_odds : float
        Expected natural logarithm of the odds of the true explanation over the nearest other explanation, after an
        experiment with the best waveform and no additional reading.
    readings : tuple of PricedReading
        Additional readings that the rig could have, the most informative first.
    noise : float
        Standard deviation of the sensor noise, SI.
    output : tuple of str
        Name and SI unit of the reading.
    """

    alternatives: tuple[str, ...] = field(
        metadata=coordinate("rival", name="rival", of=lambda advice: np.array(advice.alternatives, dtype=str))
    )
    recording: Recording | None
    waveform: str = field(metadata=attribute(name="advised", of=lambda advice: advice.waveform or None))
    added_mass: float | None = field(metadata=attribute(name="added_mass_kg"))
    measure: str | None = field(metadata=attribute())
    confusion_before: float = field(metadata=attribute())
    confusion_after: float = field(metadata=attribute())
    undecided: tuple[str, ...] = field(metadata=attribute(of=lambda advice: ", ".join(advice.undecided)))
    tried: Mapping[str, float] = field(
        metadata=variable(
            "waveform",
            name="d2",
            of=lambda advice: list(advice.tried.values()),
            about="squared distance d² of the explanations, to first order",
        )
    )
    predicted: tuple[np.ndarray, ...]
    log_odds: float = field(metadata=attribute(name="log_odds_of_the_input"))
    readings: tuple[PricedReading, ...] = field(metadata=table_along("could_be_read", kind=PricedReading))
    noise: float = field(
        metadata=variable(unit=lambda advice: advice.output[1], about="standard deviation of the sensor's noise")
    )
    output: tuple[str, str]

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "input": several(lambda advice: advice._input()),
        "waveforms": coordinate("waveform", name="waveform", of=lambda advice: np.array(list(advice.tried), dtype=str)),
        "time": coordinate(
            "time", of=lambda advice: None if advice.recording is None else advice.recording.timepts, unit="s"
        ),
        "sentence": attribute(),
        "seconds": attribute(),
        "output_name": attribute(of=lambda advice: advice.output[0]),
    }

    @property
    def seconds(self) -> float | None:
        """Length of the input, s; None if there is no input."""
        return None if self.recording is None else self.recording.duration

    @property
    def experiment(self) -> Experiment | None:
        """The input as an experiment from rest on the unchanged rig; None if no such experiment is advised."""
        if self.recording is None or self.added_mass is not None:
            return None
        return Experiment(recordings=(self.recording,))

    @property
    def sentence(self) -> str:
        """The advice in words."""
        which = spaced(listed(self.alternatives))
        if self.recording is None:
            return f"No input within the rig's limits can distinguish {which}; measure {self.measure}.{self._odds}"
        load = "" if self.added_mass is None else f" with {1e3 * self.added_mass:.3g} g added to the load"
        before, after = _percent(self.confusion_before), _percent(self.confusion_after)
        rest = (
            ""
            if not self.undecided
            else f"; if {spaced(listed(self.undecided))} still remain possible, measure {self.measure}"
        )
        return (
            f"Record a further experiment of {self.seconds:.4g} s{load} ({self.waveform}, {INPUT_FILE}) to "
            f"distinguish {which}. The probability that a wrong explanation fits better than the true one then falls from {before} to "
            f"{after}{rest}.{self._odds}"
        )

    @property
    def _odds(self) -> str:
        """State how likely the best further reading would make the true explanation, if it can distinguish them."""
        best = next((one for one in self.readings if one.resolves), None)
        if best is None:
            return ""
        return (
            f" If you add {best.words} ({best.noise_source}), the true explanation is expected to become "
            f"e^{best.log_odds:.3g} times as likely as the next best one. The best input alone gives only a "
            f"factor of e^{self.log_odds:.3g}."
        )

    @property
    def summary(self) -> AdviceSummary:
        """Summarise the advice for a diagnosis; without an input, file and seconds are None."""
        none = self.recording is None
        return AdviceSummary(
            file=None if none else INPUT_FILE,
            seconds=self.seconds,
            confusion_before=self.confusion_before,
            confusion_after=None if none else self.confusion_after,
            waveform=self.waveform or None,
            added_mass_g=None if self.added_mass is None else 1e3 * self.added_mass,
            measure=self.measure,
            undecided=self.undecided,
            log_odds=self.log_odds,
            readings=self.readings,
        )

    def _input(self) -> Variables:
        recording = self.recording
        if recording is None:
            return {}
        found: dict[str, tuple[Any, ...]] = {
            "command": ("time", recording.inputs[0], recording.input_units[0], recording.input_names[0])
        }
        if self.predicted:
            readings = np.stack(self.predicted)
            found["predicted"] = (("rival", "time"), readings, self.output[1], f"{self.output[0]}, predicted")
        return found

    def save_input(self, path: Path | str) -> None:
        """Write the input as a CSV file with columns such as ``time_s,command_V``, for `deatwin simulate` or a drive.

        Parameters
        ----------
        path : path
            File to write; nothing is written if no input is advised.
        """
        if self.recording is not None:
            write_input(path, self.recording)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the input, and the differences between the readings that the explanations predict.

        If no input is advised, draw the d² of each waveform.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        if self.recording is None:
            self._draw_tried(axes)
        else:
            self._draw_input(self.recording, axes)
        return axes

    def _draw_tried(self, ax: Axes) -> None:
        names = sorted(self.tried, key=lambda name: self.tried[name])
        ax.barh(names, [self.tried[name] for name in names], color="0.6")
        ax.axvline(DISTINGUISHED, color="C3", linestyle="--", label="distinguished")
        ax.set_xlabel("d² between the explanations")
        ax.set_title(f"no input distinguishes them: measure {self.measure}", fontsize="medium")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), frameon=False)

    def _draw_input(self, recording: Recording, ax: Axes) -> None:
        unit, size = written_amplitude(self.output[1])
        times = recording.timepts - recording.start
        apart = [(readings - self.predicted[0]) / size for readings in self.predicted]
        lines = [
            ax.plot(times, left, color=colour, linewidth=0.9, label=effects_in_words(name.replace("+", " + ")))[0]
            for name, left, colour in zip(self.alternatives, apart, cycle(_COLOURS), strict=False)
        ]
        for line in lines:  # a small curve is drawn over a large one
            line.set_zorder(2.0 + 1.0 / (1.0 + float(np.ptp(line.get_ydata()))))
        band = ax.axhspan(-self.noise / size, self.noise / size, color="0.9", zorder=0, label="sensor noise")
        ax.set_xlabel("time (s)")
        ax.set_ylabel(axis_label(f"difference of {self.output[0]}", unit))
        commands = ax.twinx()
        line = commands.plot(times, recording.inputs[0], color="0.5", linewidth=0.7, label="input")[0]
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 1.2 * (high - low))  # leaves the upper half of the drawing to the input
        span = float(np.ptp(recording.inputs[0])) or 1.0
        commands.set_ylim(float(recording.inputs[0].min()) - 1.4 * span, float(recording.inputs[0].max()) + 0.1 * span)
        lowest, highest = recording.inputs[0].min() - 0.1 * span, recording.inputs[0].max() + 0.1 * span
        commands.set_yticks([tick for tick in commands.get_yticks() if lowest <= tick <= highest])
        commands.grid(False)
        commands.set_ylabel(axis_label(recording.input_names[0], recording.input_units[0]), color="0.4")
        ax.legend(handles=[*lines, band, line], loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)
        before, after = _percent(self.confusion_before), _percent(self.confusion_after)
        load = "" if self.added_mass is None else f", {1e3 * self.added_mass:.3g} g added"
        ax.set_title(
            f"{self.waveform}{load}\nprobability of a wrong choice: {before} now, {after} afterwards", fontsize="medium"
        )


def _percent(share: float) -> str:
    """Write a probability in per cent; below a thousandth, only the bound is given."""
    return f"{100 * share:.2g} %" if share >= NEGLIGIBLE else "below 0.1 %"
