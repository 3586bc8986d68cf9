"""Before anything is fitted: are the recordings sound, and which samples are fitted, which kept unseen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from deatwin.ident.greybox.fit import Part
from deatwin.plant.checks import require_excitation, require_samples
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

__all__ = ["Gate", "Soundness", "confirm", "gate", "split"]

Masks = tuple[tuple[np.ndarray, ...], ...]
UNSEEN_SHARE = 0.3
"""The last part of each record that no fit sees until verification."""
STUCK_SECONDS = 1.0
SPIKE_DEVIATIONS = 12.0
"""A normal reading this far from its neighbours' cubic comes once in 10^32 samples."""
QUIET_SECONDS = 1.0
"""After a jump of the command the film rings: readings are not called spikes for this long."""
FEWEST_PER_PARAMETER = 20


class Soundness(Enum):
    """State of the recordings; the text is the advice."""

    SOUND = "the recordings are sound"
    FAULTY = "part of the recordings is at fault and left out"


@dataclass(frozen=True, kw_only=True, eq=False)
class Gate:
    """Recordings as the diagnosis may use them.

    Parameters
    ----------
    experiments : tuple of Experiment
        As given.
    stuck, outliers : tuple of tuple of ndarray of bool
        For each experiment and record, the samples at fault.
    """

    experiments: tuple[Experiment, ...]
    stuck: Masks
    outliers: Masks

    @property
    def sound(self) -> Masks:
        """For each experiment and record, the samples without a fault."""
        pairs = zip(self.stuck, self.outliers, strict=True)
        return tuple(tuple(~(s | o) for s, o in zip(*pair, strict=True)) for pair in pairs)

    @property
    def soundness(self) -> Soundness:
        """Whether there is a fault: a lone outlier is a nuisance, a stuck sensor or a burst is a fault."""
        masks = [mask for masks in self.sound for mask in masks]
        bad, total = sum(int((~m).sum()) for m in masks), sum(m.size for m in masks)
        return Soundness.FAULTY if bad > max(10, 1e-3 * total) else Soundness.SOUND

    @property
    def findings(self) -> tuple[str, ...]:
        """What is wrong, and where."""
        found: list[str] = []
        for experiment, stuck, outliers in zip(self.experiments, self.stuck, self.outliers, strict=True):
            for number, record in enumerate(experiment.recordings):
                name = record.provenance.get("file", f"record {number + 1}")
                found += _describe(name, record, stuck[number], "the reading is stuck")
                found += _describe(name, record, outliers[number], "outliers")
        return tuple(found)


def gate(plant: Plant, experiments: Sequence[Experiment]) -> Gate:
    """Check recordings, and mark the samples that are at fault.

    Parameters
    ----------
    plant : Plant
        Whose recordings they should be.
    experiments : sequence of Experiment
        Each from rest.

    Returns
    -------
    Gate
        Its outliers are suspects until `confirm` has seen them beside a calibrated plant.

    Raises
    ------
    DataError
        If there is nothing to diagnose: no recording, no output, a constant input, too few samples.
    """
    if not experiments:
        raise DataError("no recording was given: a diagnosis needs at least one")
    records = [record for experiment in experiments for record in experiment.recordings]
    for record in records:
        if record.outputs.shape[0] == 0:
            raise DataError("a recording has no output column: there is nothing to compare the plant with")
    require_excitation(records)
    longest = max(records, key=lambda r: r.n_samples)
    require_samples(longest, FEWEST_PER_PARAMETER * len(plant.parameters.free), "a diagnosis")
    return Gate(
        experiments=tuple(experiments),
        stuck=tuple(tuple(_stuck(r) for r in e.recordings) for e in experiments),
        outliers=tuple(tuple(_spikes(r.outputs[0]) & _quiet(r) for r in e.recordings) for e in experiments),
    )


def confirm(checked: Gate, readings: Sequence[Sequence[np.ndarray]]) -> Gate:
    """Keep the outliers that also stand out of the residual: fast motion of the plant itself is no fault.

    Parameters
    ----------
    checked : Gate
        With suspects.
    readings : sequence of sequence of ndarray, each of shape (n,)
        The calibrated plant's, for each experiment and record, SI.

    Returns
    -------
    Gate
    """
    confirmed = []
    for experiment, suspects, simulated in zip(checked.experiments, checked.outliers, readings, strict=True):
        residuals = (r.outputs[0] - y for r, y in zip(experiment.recordings, simulated, strict=True))
        confirmed.append(tuple(mask & _spikes(e) for mask, e in zip(suspects, residuals, strict=True)))
    return replace(checked, outliers=tuple(confirmed))


def split(
    checked: Gate, onset: float | None = None
) -> tuple[tuple[Part, ...], tuple[Part, ...], tuple[Part, ...]]:
    """The fitted part, the unseen part, and both together.

    The last 30 % of each record are unseen. Where the mismatch begins inside such a part, the last 30 % of what
    follows its onset are, so that the fit can see it too.

    Parameters
    ----------
    checked : Gate
        What `gate` returned.
    onset : float, optional
        Clock time at which a mismatch begins, s.

    Returns
    -------
    fitted, unseen, everything : tuple of Part
        One part for each experiment.
    """
    fitted, unseen, everything = [], [], []
    for experiment, sound in zip(checked.experiments, checked.sound, strict=True):
        cuts = [_cut(record, onset) for record in experiment.recordings]
        early = tuple(np.arange(m.size) < cut for m, cut in zip(sound, cuts, strict=True))
        fitted.append(Part(experiment=experiment, masks=tuple(s & e for s, e in zip(sound, early, strict=True))))
        unseen.append(Part(experiment=experiment, masks=tuple(s & ~e for s, e in zip(sound, early, strict=True))))
        everything.append(Part(experiment=experiment, masks=sound))
    return tuple(fitted), tuple(unseen), tuple(everything)


def _cut(record: Recording, onset: float | None) -> int:
    """First unseen sample of a record."""
    cut = round((1 - UNSEEN_SHARE) * record.n_samples)
    if onset is None or not record.timepts[cut] <= onset < record.timepts[-1]:
        return cut
    begin = int(np.searchsorted(record.timepts, onset))
    return begin + round((1 - UNSEEN_SHARE) * (record.n_samples - begin))


def _stuck(record: Recording) -> np.ndarray:
    """Runs of one and the same reading, longer than a second, while the command moves."""
    reading, command = record.outputs[0], record.inputs[0]
    bounds = np.flatnonzero(np.diff(reading) != 0) + 1
    starts, ends = np.r_[0, bounds], np.r_[bounds, reading.size]
    mask = np.zeros(reading.size, dtype=bool)
    shortest = max(3, round(STUCK_SECONDS / record.sample_time))
    for first, last in zip(starts, ends, strict=True):
        if last - first >= shortest and np.ptp(command[first:last]) > 0.02 * np.ptp(command):
            mask[first:last] = True
    # A reading at the end of its range is clipped, not stuck: that is physics, and an effect of the catalogue.
    return mask & (reading != reading.max()) & (reading != reading.min())


def _spikes(signal: np.ndarray) -> np.ndarray:
    """Single values far from the cubic through their four neighbours."""
    padded = np.pad(signal, 2, mode="edge")
    before_last, before, after, after_next = (padded[k : k + signal.size] for k in (0, 1, 3, 4))
    deviation = np.abs(signal - (4 * (before + after) - before_last - after_next) / 6)
    typical = 1.4826 * np.median(deviation) + 1e-15
    # A spike bends its neighbours' cubics too, by two thirds of its size: only the peak is the outlier.
    around = np.pad(deviation, 1)
    peak = (deviation >= around[:-2]) & (deviation >= around[2:])
    return peak & (deviation > SPIKE_DEVIATIONS * typical)


def _quiet(record: Recording) -> np.ndarray:
    """Samples away from jumps of the command, after which the film rings."""
    command = record.inputs[0]
    step = np.abs(np.diff(command, prepend=command[0]))
    # Holds jump by less than noise wanders in a sample or two, so the size is relative to the usual step.
    jumps = np.flatnonzero(step > max(0.005 * np.ptp(command), 5 * float(np.median(step))))
    quiet = np.ones(command.size, dtype=bool)
    ring = round(QUIET_SECONDS / record.sample_time)
    for jump in jumps:
        quiet[max(0, jump - 2) : jump + ring] = False
    quiet[:ring] = quiet[-2:] = False  # the record before this one may have ended at another command
    return quiet


def _describe(name: str, record: Recording, bad: np.ndarray, what: str) -> list[str]:
    if not bad.any():
        return []
    where = record.timepts[bad]
    return [f"{name}: {what} in {int(bad.sum())} samples between {where[0]:.2f} and {where[-1]:.2f} s"]
