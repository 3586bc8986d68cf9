"""Describe a recording before any model is made: clock, channels, excitation, faults, and how outputs follow inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from deatwin.ident.look.approximation import BestLinearApproximation
from deatwin.ident.look.best_linear import best_linear_approximation
from deatwin.ident.look.inputs import InputPattern, pattern_of
from deatwin.ident.look.link import LINE_CHANCE, Link, links_of
from deatwin.ident.mismatch.quality.noise import noise_level
from deatwin.ident.narx.excited import Excitation, excitation
from deatwin.ident.narx.preprocess import Finding, FindingKind, SamplingChoice, choose_sampling, inspect_recordings
from deatwin.ident.narx.preprocess.findings import FEWEST
from deatwin.ident.narx.regression import Recordings, flatten, require_alike
from deatwin.ident.soundness import resolution
from deatwin.plant.amplitudes import amount, axis_label, written_amplitude
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Axes, envelope, panels_or_new
from deatwin.plant.errors import DataError
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording, label

_Found = TypeVar("_Found")
_FEWEST = 64  # Samples of a record from which the top of its spectrum is the median of some lines
_SHOWN = 3.0  # Times the highest excited frequency up to which the coherence is drawn
_FAR = 10.0  # Distance of an equal reading from all others, in their range, from which it may mark a missing value
_MARKED = {FindingKind.OUTLIERS: "outlier", FindingKind.CLIPPING: "at a limit", FindingKind.CONSTANT: "stands still"}
"""Findings that are marked in the picture, as it calls them."""


@dataclass(frozen=True, kw_only=True)
class ChannelLook:
    """Size of one channel, in its unit."""

    name: str
    role: str  # ``input``, ``output`` or ``extra``
    unit: str  # Empty if unknown
    low: float
    high: float
    mean: float
    deviation: float
    noise: float | None  # Largest that white noise can be, rms; None for inputs and short recordings
    step: float  # Of which all differences are multiples; 0 where there is none

    def __str__(self) -> str:
        text = f"{self.name}: {with_unit(self.low, self.unit)} to {with_unit(self.high, self.unit)}"
        text += f", a range of {with_unit(self.high - self.low, self.unit)}"
        if self.role != "input":
            if self.noise is not None and self.noise > 0.0:
                text += f"; noise at most {with_unit(self.noise, self.unit)} rms"
            if self.step:
                text += f"; resolution {with_unit(self.step, self.unit)}"
        return text


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """Description of a recording before identification, as `look_at` returns it.

    Parameters
    ----------
    recordings : tuple of Recording
        The recording; several if gaps divide it into pieces.
    channels : tuple of ChannelLook
        Range, mean, noise and resolution of each channel.
    patterns : tuple of InputPattern
        Shape and period of each input, estimated from the longest piece.
    excitations : tuple of (Excitation or None)
        Excited frequency bands of each input, estimated from the longest piece; None if the spectrum cannot be
        estimated.
    links : tuple of Link
        Coherence and dead time from each input to each output, ordered by output.
    findings : tuple of Finding
        Irregularities of the signals: trends, drifts, outliers, coarse resolution, values at a limit, inputs with few
        levels, and constant stretches.
    sampling : SamplingChoice or None
        Advice on the sample time for a NARX model; None if the recording is too short.
    best_linear : BestLinearApproximation or None
        Best linear approximation from the first input to the first output, from the longest piece. None if this input
        is not periodic, has fewer than three periods, or another input varies.
    """

    recordings: tuple[Recording, ...]
    channels: tuple[ChannelLook, ...]
    patterns: tuple[InputPattern, ...]
    excitations: tuple[Excitation | None, ...]
    links: tuple[Link, ...]
    findings: tuple[Finding, ...]
    sampling: SamplingChoice | None
    best_linear: BestLinearApproximation | None

    @property
    def n_samples(self) -> int:
        """Number of samples of all pieces."""
        return sum(record.n_samples for record in self.recordings)

    @property
    def sample_time(self) -> float:
        """Time between two samples, s."""
        return self.recordings[0].sample_time

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each gap between pieces, s."""
        return tuple((before.end, after.start) for before, after in pairwise(self.recordings))

    @property
    def clock(self) -> str:
        """Number of samples, sample time, start, end and gaps of the recording, as text."""
        first, last = self.recordings[0], self.recordings[-1]
        text = f"{self.n_samples} samples, every {self.sample_time:.6g} s, from {first.start:.6g} to {last.end:.6g} s"
        uneven = [said for record in self.recordings if (said := record.provenance.get("resampled"))]
        asked = [said for record in self.recordings if (said := record.provenance.get("clock"))]
        if self.gaps:
            longest = max(end - start for start, end in self.gaps)
            text += f"; {len(self.gaps)} gap{'s' if len(self.gaps) > 1 else ''}, the longest {longest:.4g} s"
        times = f"the times are uneven, so the recording was resampled: {uneven[0]}" if uneven else "evenly spaced"
        return "; ".join([text, times, *asked[:1]])

    @property
    def lines(self) -> tuple[str, ...]:
        """Description of the recording, in lines of plain text."""
        found = [self.clock, *map(str, self.channels)]
        for pattern, excited in zip(self.patterns, self.excitations, strict=True):
            bands = "" if excited is None else ", ".join(f"{low:.3g} to {high:.3g} Hz" for low, high in excited.bands)
            found.append(f"{pattern.name}: {pattern}" + (f"; its power lies in {bands}" if bands else ""))
        found += [str(link) for link in self.links]
        found += [] if self.best_linear is None else [str(self.best_linear)]
        found += [f"{finding.signal}: {finding.text.removeprefix(f'{finding.signal} ')}" for finding in self.findings]
        found += [] if "file" in self.recordings[0].provenance else _marks(self.recordings)  # reading has told it
        return tuple(found)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def to_dict(self) -> dict[str, Any]:
        """Return all findings as plain data for JSON; times in s, values in the channels' units."""
        return {
            "file": label(self.recordings[0]),
            "samples": self.n_samples,
            "sample_time_s": self.sample_time,
            "start_s": self.recordings[0].start,
            "end_s": self.recordings[-1].end,
            "gaps_s": [list(gap) for gap in self.gaps],
            "clock": self.clock,
            "channels": [asdict(channel) for channel in self.channels],
            "inputs": [
                asdict(pattern)
                | {"shape": pattern.shape.name.lower()}
                | {"excited_Hz": None if excited is None else [list(band) for band in excited.bands]}
                for pattern, excited in zip(self.patterns, self.excitations, strict=True)
            ],
            "links": [_link(link) for link in self.links],
            "findings": [asdict(finding) | {"kind": finding.kind.name.lower()} for finding in self.findings],
            "sampling": None if self.sampling is None else self.sampling.status.name.lower(),
            "best_linear": None if self.best_linear is None else self.best_linear.to_dict(),
        }

    def plot(self, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
        """Draw the first input, the first output with its faults, and their coherence, on three `axes` or new ones."""
        chosen = panels_or_new(axes, 3, height=1.8)
        for record in self.recordings:
            unit, size = written_amplitude(record.output_units[0])
            chosen[0].plot(*envelope(record.timepts, record.inputs[0]), color="C0", linewidth=0.8)
            chosen[1].plot(*envelope(record.timepts, record.outputs[0] / size), color="C0", linewidth=0.8)
            chosen[0].set(xlabel="time (s)", ylabel=axis_label(record.input_names[0], record.input_units[0]))
            chosen[1].set(xlabel="time (s)", ylabel=axis_label(record.output_names[0], unit))
        self._mark(chosen[1])
        link = self.links[0]
        chosen[2].plot(link.frequencies, link.coherence, color="C0", linewidth=1.0, label="with the input")
        chosen[2].plot(
            link.frequencies, link.coherence_squared, color="C1", linewidth=1.0, label="with the squared input"
        )
        chosen[2].axhline(LINE_CHANCE, color="0.5", linestyle=":", linewidth=1.0, label="by chance")
        if (excited := self.excitations[0]) is not None:
            for low, high in excited.bands:
                chosen[2].axvspan(low, high, color="0.5", alpha=0.15, linewidth=0.0)
            chosen[2].set_xlim(0.0, min(_SHOWN * excited.highest_Hz, 0.5 / self.sample_time))
        chosen[2].set(xlabel="frequency (Hz), excited band shaded", ylabel="coherence of the output", ylim=(0.0, 1.02))
        for panel in chosen[1:]:
            if panel.get_legend_handles_labels()[0]:
                panel.legend(
                    fontsize="small",
                    ncols=3,
                    loc="lower right",
                    bbox_to_anchor=(1.0, 1.0),
                    frameon=False,
                    borderaxespad=0.2,
                )
        return chosen

    def _mark(self, axes: Axes) -> None:
        """Shade the faulty stretches of the first output."""
        told = set()
        for finding in self.findings:
            kind = _MARKED.get(finding.kind)
            if kind is None or finding.signal != self.recordings[0].output_names[0]:
                continue
            width = max(finding.to_s - finding.from_s, self.sample_time)
            name = None if kind in told else kind
            colour = f"C{1 + list(_MARKED.values()).index(kind)}"
            axes.axvspan(finding.from_s, finding.from_s + width, color=colour, alpha=0.3, label=name)
            told.add(kind)


def look_at(recordings: Recordings) -> Look:
    """Inspect a recording before a model is identified.

    Recordings of any length are accepted; results that need a longer recording are omitted.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        One recording, or its pieces between gaps, with the same signals and sample time.

    Raises
    ------
    DataError
        If the recording has no input or no output.
    ModelError
        If `recordings` is empty, or contains anything but recordings and experiments; or if the pieces differ in
        signals, units or sample time.
    """
    records = flatten(recordings)
    require_alike(records)
    longest = max(records, key=lambda record: record.n_samples)
    if longest.outputs.shape[0] == 0 or longest.inputs.shape[0] == 0:
        raise DataError(f"{label(longest)}: a recording to look at needs an input and an output")
    silent, dt = np.zeros(longest.n_samples), longest.sample_time
    excitations = tuple(
        _if_possible(lambda u: excitation(Recording.from_arrays(u, silent, dt)), values) for values in longest.inputs
    )
    patterns = tuple(
        pattern_of(name, values, longest.sample_time)
        for name, values in zip(longest.input_names, longest.inputs, strict=True)
    )
    first = patterns[0]
    return Look(
        recordings=tuple(records),
        channels=_channels(records),
        patterns=patterns,
        excitations=excitations,
        links=links_of(records, excitations),
        findings=_findings(records),
        sampling=_if_possible(choose_sampling, [longest]),
        best_linear=_if_possible(best_linear_approximation, longest, period=first.period_s) if first.periods else None,
    )


def _if_possible(find: Callable[..., _Found], *arguments: Any, **more: Any) -> _Found | None:
    """Return what a function finds; None if the recording does not allow it."""
    try:
        return find(*arguments, **more)
    except DataError:
        return None


def _channels(records: Sequence[Recording]) -> tuple[ChannelLook, ...]:
    first, found = records[0], []
    extras = [np.array(list(record.extras.values())) for record in records]
    for role, names, units, rows in (
        ("input", first.input_names, first.input_units, [record.inputs for record in records]),
        ("output", first.output_names, first.output_units, [record.outputs for record in records]),
        ("extra", tuple(first.extras), tuple(first.extra_units.values()), extras),
    ):
        for k, (name, unit) in enumerate(zip(names, units, strict=True)):
            pieces = [piece for row in rows if (piece := row[k][np.isfinite(row[k])]).size]
            if not pieces:
                continue
            values = np.concatenate(pieces)
            found.append(
                ChannelLook(
                    name=name,
                    role=role,
                    unit=unit,
                    low=float(values.min()),
                    high=float(values.max()),
                    mean=float(values.mean()),
                    deviation=float(values.std()),
                    noise=None if role == "input" else _noise(records, pieces),
                    step=resolution(values),
                )
            )
    return tuple(found)


def _marks(records: Sequence[Recording]) -> list[str]:
    """Ask for the meaning of an equal reading in several samples, far outside the range of all others."""
    found = []
    for row, (name, unit) in enumerate(zip(records[0].output_names, records[0].output_units, strict=True)):
        values, counts = np.unique(np.concatenate([record.outputs[row] for record in records]), return_counts=True)
        for k, rest in ((0, values[1:]), (-1, values[:-1])):
            if rest.size > 1 and counts[k] > 1 and np.abs(rest - values[k]).min() > _FAR * np.ptp(rest):
                found.append(
                    f"{name}: {counts[k]} readings are {amount(f'{values[k]:.9g}', unit)}, far outside all others; if that marks "
                    "missing values, leave these cells empty"
                )
    return found


def _noise(records: Sequence[Recording], pieces: Sequence[Array]) -> float | None:
    """Estimate the noise of a channel as the diagnosis does that of residuals; here motion is in it, too."""
    if max(piece.size for piece in pieces) < _FEWEST:
        return None
    commands = [record.inputs[0] for record in records]
    if [piece.size for piece in pieces] != [command.size for command in commands]:
        return None  # with missing values the differences of neighbours tell nothing
    level = noise_level(pieces, records[0].sample_time, 0.0, commands).level
    return max(level, resolution(np.concatenate(pieces)) / np.sqrt(12.0))  # steps hide what is smaller


def _findings(records: Sequence[Recording]) -> tuple[Finding, ...]:
    """Return what `inspect_recordings` finds in the pieces that are long enough for it."""
    enough = [record for record in records if record.n_samples >= FEWEST]
    found = inspect_recordings(enough) if enough else ()
    inputs, slow = set(records[0].input_names), (FindingKind.TREND, FindingKind.DRIFT)
    moved = {finding.kind for finding in found if finding.signal in inputs}
    return tuple(one for one in found if one.kind not in slow or one.kind not in moved)


def _link(link: Link) -> dict[str, Any]:
    dead = link.dead_time
    return {
        "input": link.input_name,
        "output": link.output_name,
        "status": link.status.name.lower(),
        "coherence_in_band": link.in_band,
        "coherence_by_chance": link.chance,
        "dead_time_samples": None if dead is None else dead.samples,
        "dead_time_interval": None if dead is None or dead.interval is None else list(dead.interval),
        "dead_time_s": None if dead is None else dead.seconds,
    }
