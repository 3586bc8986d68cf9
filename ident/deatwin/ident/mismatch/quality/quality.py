"""Check recordings before anything is fitted, and divide their samples into fitted and held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from deatwin.ident.greybox.parts import Part, settled
from deatwin.ident.mismatch.datasets import samples
from deatwin.ident.mismatch.quality import suspects
from deatwin.ident.mismatch.result import Fault
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import NEGLIGIBLE, PRACTICAL_SHARE
from deatwin.ident.soundness import noise_of_bends, resolution, runs
from deatwin.plant.amplitudes import axis_label, written_amplitude
from deatwin.plant.checks import experiment_for, require_excitation, require_samples
from deatwin.plant.datasets import Described, Metadata, several, status_of, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.prefixes import time_span
from deatwin.plant.recording import Experiment, Recording, label, way_to_record
from deatwin.plant.words import spaced

Masks = tuple[tuple[np.ndarray, ...], ...]
UNSEEN_SHARE = 0.3
"""Share of each record, at its end, that is held out from every fit until verification."""
FEWEST_PER_PARAMETER = 20
FEWEST_FAULTY = 10
"""Number of faulty samples that no sound recording exceeds, unless they are a negligible share of all samples."""
OF_READING = ("the reading is stuck", "the reading has outliers")
"""Faults of the first reading, which decide the verdict."""
MOST_STRETCHES = 6
"""Largest number of stretches that are listed one by one in a line; nobody reads more."""


class Soundness(Enum):
    """State of the recordings; each value is an advice."""

    SOUND = "the recordings are sound"
    FAULTY = "faulty parts of the recordings are left out"


def _joined(name: str) -> Callable[[DataQuality], np.ndarray]:
    """Join the marks of all records, one after another, to one array."""
    return lambda checked: np.concatenate([mask for masks in getattr(checked, name) for mask in masks])


def marked_in_any(*kinds: Masks) -> Masks:
    """Return the samples that are marked in any of several kinds."""
    each = zip(*kinds, strict=True)
    return tuple(tuple(np.any(masks, axis=0) for masks in zip(*one, strict=True)) for one in each)


def by_experiment(checked: DataQuality, arrays: Sequence[np.ndarray]) -> tuple[tuple[np.ndarray, ...], ...]:
    """Group arrays of all recordings, one after another, by their experiments."""
    following = iter(arrays)
    return tuple(tuple(next(following) for _ in experiment.recordings) for experiment in checked.experiments)


@dataclass(frozen=True, kw_only=True, eq=False)
class DataQuality(Described):
    """Recordings with marks for faulty samples and for other samples that the diagnosis reports.

    The marks of one kind are a tuple with one entry for each experiment. This entry is a tuple with one array of bool
    for each recording, of shape (n_samples,), which is True at the marked samples.

    Parameters
    ----------
    experiments : tuple of Experiment
        Experiments as given.
    stuck, outliers : tuple of tuple of ndarray of bool
        Faulty samples of the first reading: those at which it is stuck, and outliers. They are left out.
    clipped : tuple of tuple of ndarray of bool
        Samples at which the first reading stays at a limit. They are kept, because an effect may explain them.
    jumps : tuple of tuple of ndarray of bool
        First samples after a jump of the first reading without a jump of the command. They are kept, because an effect
        may explain them.
    bursts : mapping of str to tuple of tuple of ndarray of bool
        Samples at which a reading is much noisier than elsewhere, which are left out. The key is the name of the
        reading, and empty for the first reading.
    stuck_further : mapping of str to tuple of tuple of ndarray of bool
        Samples at which a reading other than the first is stuck. They are left out of this reading. The key is its
        name.
    settled : tuple of tuple of ndarray of bool
        Samples at which the influence of an unknown initial state has decayed. All other samples are left out.
    unknown : tuple of tuple of ndarray of bool
        Samples after a gap in a recording at which the reading depends on the unknown command during the gap. They are
        left out. Empty if there are none.
    """

    experiments: tuple[Experiment, ...]
    stuck: Masks
    outliers: Masks
    clipped: Masks
    jumps: Masks
    bursts: Mapping[str, Masks] = field(default_factory=dict)
    stuck_further: Mapping[str, Masks] = field(default_factory=dict)
    unknown: Masks = ()
    settled: Masks

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "samples": several(lambda checked: samples(checked.experiments), "coords"),
        "measured": variable(
            "sample",
            of=lambda checked: np.concatenate([r.outputs[0] for one in checked.experiments for r in one.recordings]),
            unit=lambda checked: checked.experiments[0].recordings[0].output_units[0],
        ),
        "stuck": variable("sample", of=_joined("stuck")),
        "outliers": variable("sample", of=_joined("outliers")),
        "clipped": variable("sample", of=_joined("clipped")),
        "jumps": variable("sample", of=_joined("jumps")),
        "sound": variable("sample", of=_joined("sound")),
        "soundness": status_of(of=lambda checked: checked.soundness),
    }

    @property
    def sound(self) -> Masks:
        """Marks of the samples that are neither stuck nor outliers."""
        return tuple(tuple(~mask for mask in masks) for masks in marked_in_any(self.stuck, self.outliers))

    @property
    def usable(self) -> Masks:
        """Marks of the samples of the first reading that are not left out.

        If more than 90 % of the samples are faulty, the marks are those of ``settled``, because a fit needs samples.
        """
        everything = [mask for masks in self.sound for mask in masks]
        if sum(int(m.sum()) for m in everything) >= PRACTICAL_SHARE * sum(m.size for m in everything):
            return tuple(
                tuple(mask & ~out for mask, out in zip(*pair, strict=True))
                for pair in zip(self.sound, self._left_out(""), strict=True)
            )
        return self.settled

    def _left_out(self, name: str) -> Masks:
        """Return samples of a reading that are left out although they are sound."""
        kinds = (self.bursts.get(name), self.stuck_further.get(name), self.unknown, self._unsettled)
        return marked_in_any(*(masks for masks in kinds if masks))

    @property
    def _unsettled(self) -> Masks:
        """Return the samples that are ignored because the start of the motion is unknown."""
        return tuple(tuple(~mask for mask in masks) for masks in self.settled)

    def known(self, name: str) -> Masks:
        """Return marks of the samples that are not left out, for a reading other than the first.

        Parameters
        ----------
        name : str
            Name of the reading.

        Returns
        -------
        tuple of tuple of ndarray of bool
            One tuple for each experiment, with one array for each recording, True at the samples that are kept.
        """
        return tuple(
            tuple(
                np.isfinite(record.reading(name)) & ~out for record, out in zip(one.recordings, left_out, strict=True)
            )
            for one, left_out in zip(self.experiments, self._left_out(name), strict=True)
        )

    @property
    def soundness(self) -> Soundness:
        """``FAULTY`` if more than ten samples, and more than 0.1 % of all samples, are stuck or outliers."""
        masks = [mask for masks in self.sound for mask in masks]
        bad, total = sum(int((~m).sum()) for m in masks), sum(m.size for m in masks)
        return Soundness.FAULTY if bad > max(FEWEST_FAULTY, NEGLIGIBLE * total) else Soundness.SOUND

    @property
    def findings(self) -> tuple[str, ...]:
        """Descriptions of the faults, with their times."""
        return (
            *self._described(self.stuck, "the reading is stuck in"),
            *self._described(self.outliers, "the reading has outliers in"),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on other features: values at a limit, jumps, coarse steps, samples that are left out, and gaps."""
        found = [
            *self._described(self.clipped, "the reading stays at its limit in"),
            *self._described(self.jumps, "the reading jumps in"),
        ]
        for what, readings in (("is much noisier than elsewhere", self.bursts), ("is stuck", self.stuck_further)):
            for name, masks in readings.items():
                found += self._described(masks, f"left out because the {spaced(name) or 'reading'} {what}:")
        if self.unknown:
            found += self._described(
                self.unknown, "left out because it is unknown when the command changed during a gap in the recording:"
            )
        found += self._described(self._unsettled, "left out because the motion before the first sample is unknown:")
        for experiment in self.experiments:
            for number, record in enumerate(experiment.recordings):
                found += _coarse(_called(record, number), record)
            for before, after in pairwise(experiment.recordings):
                if after.start - before.end > before.sample_time:
                    found.append(
                        f"there are no readings between {time_span(before.end, after.start, between=' and ')}; the last "
                        "command is assumed to have been held"
                    )
        return tuple(found)

    def _described(self, masks: Masks, what: str) -> list[str]:
        """Return a line for each record that has marked samples of one kind."""
        found = []
        for experiment, marked in zip(self.experiments, masks, strict=True):
            for number, (record, bad) in enumerate(zip(experiment.recordings, marked, strict=True)):
                if bad.any():
                    where, stretches = record.timepts[bad], runs(bad)
                    many = f"{where.size} samples between {time_span(where[0], where[-1], between=' and ')}"
                    if 1 < len(stretches) <= MOST_STRETCHES:
                        each = (time_span(record.timepts[run[0]], record.timepts[run[-1]]) for run in stretches)
                        many = f"{where.size} samples: {', '.join(each)}"
                    one = f"one sample at {where[0]:.2f} s"
                    found.append(f"{_called(record, number)}: {what} {many if where.size > 1 else one}")
        return found

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the first reading with the marked samples, one experiment after another.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes, passed = axes_or_new(ax), 0.0
        unit, size = written_amplitude(self.experiments[0].recordings[0].output_units[0])
        kinds = [
            ("stuck", self.stuck, "C3", "s"),
            ("outlier", self.outliers, "C1", "x"),
            ("at a limit", self.clipped, "C4", "_"),
            ("jump", self.jumps, "C2", "^"),
        ]
        kinds += [("noisier", self.bursts[""], "C5", ".")] if "" in self.bursts else []
        marked: dict[str, list[np.ndarray]] = {}
        for k, experiment in enumerate(self.experiments):
            for number, record in enumerate(experiment.recordings):
                timepts, reading = passed + record.timepts - experiment.start, record.outputs[0] / size
                axes.plot(timepts, reading, color="0.6", linewidth=0.8)
                for name, masks, _, _ in kinds:
                    marked.setdefault(name, []).append(np.stack([timepts, reading])[:, masks[k][number]])
            passed += experiment.end - experiment.start
        for name, _, colour, marker in kinds:
            where = np.concatenate(marked[name], axis=1)
            if where.size:
                axes.plot(*where, marker, color=colour, markersize=5, label=f"{name}, {where.shape[1]} samples")
        axes.set_xlabel("time of the recordings (s)")
        axes.set_ylabel(axis_label("reading", unit))
        axes.set_title(self.soundness.value, fontsize="small", loc="left")
        if any(mask.size for pieces in marked.values() for mask in pieces):
            axes.legend(fontsize="small")
        return axes


def check_quality(plant: Plant, experiments: Experiment | Recording | Sequence[Experiment | Recording]) -> DataQuality:
    """Check recordings and mark faulty samples.

    Parameters
    ----------
    plant : Plant
        Plant to which the recordings belong.
    experiments : Experiment or Recording, or a sequence of such
        Experiments and single recordings, each of which starts from rest.

    Returns
    -------
    DataQuality
        Recordings with their faulty samples marked. Outliers and jumps are provisional until `confirm` has compared
        them with a calibrated plant.

    Raises
    ------
    DataError
        If there is no recording, or one of `experiments` is neither an Experiment nor a Recording. Also if a recording
        has no output, the input is constant, or the recording does not suit the rig of the plant.
    ModelError
        If `plant` is not a Plant, or there are too few samples for its parameters.
    """
    require_plant(plant, "a diagnosis")
    given = tuple(experiment_for(plant.rig, one) for one in _listed(experiments))
    records = [record for experiment in given for record in experiment.recordings]
    for record in records:
        if record.outputs.shape[0] == 0:
            raise DataError("a recording has no output column: there is nothing to compare the plant with")
    require_excitation(records)
    require_samples(records, FEWEST_PER_PARAMETER * len(plant.parameters.free), "a diagnosis")
    stuck = tuple(tuple(suspects.stuck(r) | suspects.lost(r) for r in e.recordings) for e in given)
    return DataQuality(
        experiments=given,
        stuck=stuck,
        outliers=_elsewhere(stuck, given, lambda r: suspects.spikes(r.outputs[0]) & suspects.quiet(r)),
        clipped=_elsewhere(stuck, given, suspects.clipped),
        jumps=_elsewhere(stuck, given, lambda r: suspects.jumps(r.outputs[0]) & suspects.quiet(r)),
        settled=tuple(settled(e, plant.rig) for e in given),
    )


def _elsewhere(stuck: Masks, experiments: Sequence[Experiment], find: Callable[[Recording], np.ndarray]) -> Masks:
    """Return the samples that `find` marks, except in and next to stuck stretches, which are reported already."""
    from scipy.ndimage import binary_dilation

    return tuple(
        tuple(find(record) & ~binary_dilation(mask) for record, mask in zip(experiment.recordings, masks, strict=True))
        for experiment, masks in zip(experiments, stuck, strict=True)
    )


def _listed(
    experiments: Experiment | Recording | Sequence[Experiment | Recording],
) -> tuple[Experiment | Recording, ...]:
    """Return the arguments after a check of their kinds."""
    given = tuple(experiments) if isinstance(experiments, Sequence) else (experiments,)
    if not given:
        raise DataError("no recording was given: a diagnosis needs at least one")
    for place, one in enumerate(given):
        if not isinstance(one, Experiment | Recording):
            raise DataError(
                f"experiment {place + 1} is a {type(one).__name__}, neither an Experiment nor a Recording: "
                f"{way_to_record(one)}"
            )
    return given


@checks_its_arguments
def confirm(checked: DataQuality, readings: Sequence[Sequence[np.ndarray]]) -> DataQuality:
    """Keep only those outliers and jumps that also appear in the residual of a calibrated plant.

    All others are fast motion of the plant.

    Parameters
    ----------
    checked : DataQuality
        Recordings as `check_quality` returned them.
    readings : sequence of sequence of ndarray, each of shape (n,)
        Simulated readings of the calibrated plant, for each experiment and each of its recordings, SI.

    Returns
    -------
    DataQuality
    """
    outliers, jumps = [], []
    for k, (experiment, simulated) in enumerate(zip(checked.experiments, readings, strict=True)):
        residuals = [r.outputs[0] - y for r, y in zip(experiment.recordings, simulated, strict=True)]
        outliers.append(tuple(m & suspects.spikes(e) for m, e in zip(checked.outliers[k], residuals, strict=True)))
        jumps.append(tuple(m & suspects.jumps(e) for m, e in zip(checked.jumps[k], residuals, strict=True)))
    return replace(checked, outliers=tuple(outliers), jumps=tuple(jumps))


def split(
    checked: DataQuality,
    onset: float | None = None,
    weights: Mapping[str, float] = MappingProxyType({}),
    levels: Sequence[tuple[np.ndarray, ...]] | None = None,
) -> tuple[tuple[Part, ...], tuple[Part, ...], tuple[Part, ...]]:
    """Return the fitted part, the held-out part and both together of each experiment, then of each further reading.

    A mismatch begins at `onset`, s; `weights` belong to further readings, `levels` to the noise of the first reading,
    as in `Part`. Experiments without sound samples, and further readings without any on both sides of the cut, are
    skipped.
    """
    # The last 30 % of the sound samples of each record are held out. If the mismatch begins within these, the last 30 %
    # of the samples after its onset are held out instead, so that the fit includes a part of the mismatch.
    first: list[tuple[Part, Part, Part]] = []
    further: list[tuple[Part, Part, Part]] = []
    for number, (experiment, sound) in enumerate(zip(checked.experiments, checked.usable, strict=True)):
        cuts = [_cut(record, mask, onset) for record, mask in zip(experiment.recordings, sound, strict=True)]
        early = [np.arange(m.size) < cut for m, cut in zip(sound, cuts, strict=True)]
        whole = Part(experiment=experiment, masks=sound, levels=levels[number] if levels else None)
        if not (three := _divided(whole, early))[0].size:
            continue
        first.append(three)
        for name, weight in weights.items():
            known = Part(experiment=experiment, masks=checked.known(name)[number], reading=name, weight=weight)
            three = _divided(known, early)
            if three[0].size and three[1].size:
                further.append(three)
    fitted, unseen, everything = (tuple(three[k] for three in (*first, *further)) for k in range(3))
    return fitted, unseen, everything


def _divided(whole: Part, early: Sequence[np.ndarray]) -> tuple[Part, Part, Part]:
    """Return the fitted part, with the `early` samples, (n,) for each record, the held-out part, and the whole."""
    fitted = tuple(mask & own for mask, own in zip(whole.masks, early, strict=True))
    unseen = tuple(mask & ~own for mask, own in zip(whole.masks, early, strict=True))
    return replace(whole, masks=fitted), replace(whole, masks=unseen), whole


def _cut(record: Recording, sound: np.ndarray, onset: float | None) -> int:
    """Return the first held-out sample of a record."""
    whole = np.flatnonzero(sound)
    if whole.size == 0:
        return record.n_samples
    cut = _first_late(whole)
    if onset is None or not record.timepts[cut] <= onset < record.timepts[whole[-1]]:
        return cut
    return _first_late(whole[record.timepts[whole] >= onset])


def _first_late(samples: np.ndarray) -> int:
    """Return the first of the held-out samples, of which there is at least one."""
    return int(samples[min(round((1 - UNSEEN_SHARE) * samples.size), samples.size - 1)])


def _coarse(name: str, record: Recording) -> list[str]:
    step, noise = resolution(record.outputs[0]), noise_of_bends(record.outputs[0])
    if step**2 / 12.0 <= PRACTICAL_SHARE * noise**2:
        return []
    unit, size = written_amplitude(record.output_units[0])
    return [f"{name}: the readings are quantised in steps of {step / size:.3g} {unit}".rstrip()]


def _called(record: Recording, number: int) -> str:
    return record.provenance.get("file", f"record {number + 1}")


def faults_of(checked: DataQuality) -> tuple[Fault, ...]:
    """Return one entry for each kind of fault in a recording."""
    found: list[Fault] = []
    kinds = list(zip(OF_READING, (checked.stuck, checked.outliers), strict=True))
    kinds += [(f"the {spaced(name)} is stuck", masks) for name, masks in checked.stuck_further.items()]
    for number, experiment in enumerate(checked.experiments):
        for place, record in enumerate(experiment.recordings):
            for fault, masks in kinds:
                bad = record.timepts[masks[number][place]]
                if bad.size:
                    found.append(
                        Fault(
                            experiment=number + 1,
                            recording=place + 1,
                            file=label(record),
                            fault=fault,
                            samples=int(bad.size),
                            from_s=float(bad[0]),
                            to_s=float(bad[-1]),
                        )
                    )
    return tuple(found)
