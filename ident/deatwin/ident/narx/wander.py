"""Estimate time-varying parameters of an actuator; how much they may vary is chosen on held-out samples.

A walk of likeliest variances follows whatever the structure lacks, and reproduces only the record that it was fitted to.
So the wander is chosen, and judged, on blocks left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.narx import Fixed, NarxModel, Recording, Term, TermTable, ThetaSmoother, ThetaTrajectory, refine
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.recursive import regressor_sizes
from deatwin.ident.narx.regression import Regression
from deatwin.plant.arrays import Array, root_mean_square

Structure = tuple[Term, ...]
Recordings = Sequence[Recording]
BLOCK = 20.0  # Length of a block of the record, s: some twenty correlation times, a hundredth of the slowest histories'
CYCLE = 4  # Blocks in a cycle, of which one is for choosing and one for judging
CHOOSING, JUDGING = 2, 0
SHARES = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Shares of the reading's standard deviation by which each term's contribution may wander over the whole record."""

CONSTANT, REFINED, VARYING, LIKELIEST = "constant", "constant, least free-run error", "varying", "varying, likeliest"
PAST = 5  # Blocks before the first forecast
KEPT_EVERY = 1.0  # Interval at which a trajectory is kept, s


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Parameters of an actuator along time, and free-run errors divided by the standard deviation of the reading."""

    name: str
    recording: Recording  # Whole recording, thinned
    share: float  # Chosen one of `SHARES`
    seen: Mapping[str, float]  # Errors on the fitted record, by method
    unseen: Mapping[str, float]  # Errors on the blocks for judging, with parameters from all others
    ahead: Mapping[str, float]  # Errors of `CONSTANT` and `VARYING` on each block, with parameters from earlier ones
    trajectory: ThetaTrajectory  # Trajectory fitted to the whole record, kept every second
    held: ThetaTrajectory  # Trajectory fitted without the blocks for judging
    held_constant: NarxModel  # Model by least squares without the blocks for judging
    judged: tuple[Recording, ...]  # The blocks for judging


def follow_actuator(name: str, recording: Recording, structure: Structure) -> Track:
    """Choose how much the parameters may vary, estimate them along time, and judge the result."""

    def error(model: NarxModel | ThetaTrajectory, sections: Recordings) -> float:
        return root_mean_square(free_run_errors(model, sections)) / float(recording.outputs.std())

    without = stretches(recording, (JUDGING,))
    judged = _within(blocks_of(recording, JUDGING), without)
    share = chosen_share(_choice_errors(structure, recording))
    smoother = walked(structure, [recording], share, recording)
    constants, held_constants = _constants(structure, [recording]), _constants(structure, without)
    held, likeliest = walked(structure, without, share, recording).trajectory_, _likeliest(structure, without)
    seen: dict[str, NarxModel | ThetaTrajectory] = {**constants, VARYING: smoother.trajectory_}
    unseen: dict[str, NarxModel | ThetaTrajectory] = {**held_constants, VARYING: held, LIKELIEST: likeliest}
    standing = walked(structure, [recording], 0.0, recording)
    step = max(1, round(KEPT_EVERY / recording.sample_time))
    return Track(
        name=name,
        recording=recording,
        share=share,
        seen={key: error(model, [recording]) for key, model in seen.items()} | {LIKELIEST: error(likeliest, without)},
        unseen={key: error(model, judged) for key, model in unseen.items()},
        ahead={
            CONSTANT: _ahead(standing.filtered_, recording) / float(recording.outputs.std()),
            VARYING: _ahead(smoother.filtered_, recording) / float(recording.outputs.std()),
        },
        trajectory=smoother.trajectory_.thinned(step),
        held=held.thinned(step),
        held_constant=held_constants[CONSTANT],
        judged=tuple(judged),
    )


def _choice_errors(structure: Structure, recording: Recording) -> Array:
    """Return the error of each of `SHARES` on the blocks for choosing, which no fit uses."""
    training = stretches(recording, (CHOOSING, JUDGING))
    blocks = _within(blocks_of(recording, CHOOSING), training)
    walks = (walked(structure, training, share, recording).trajectory_ for share in SHARES)
    return np.array([root_mean_square(free_run_errors(walk, blocks)) for walk in walks])


def chosen_share(errors: Array) -> float:
    """Return the share with the smallest error. Shapes: `errors` (n_shares,)."""
    return SHARES[int(np.argmin(errors))]


def walked(structure: Structure, training: Recordings, share: float, whole: Recording) -> ThetaSmoother:
    """Filter and smooth parameters that may vary by a given share."""
    regression = Regression.on(whole, TermTable(structure))
    sizes = regressor_sizes(regression.matrix()[0]) * regression.output_scale / regression.term_scales
    wander = share * float(whole.outputs.std()) / sizes
    residual = Fixed(terms=structure).fit(list(training)).model_.noise_variance
    return ThetaSmoother(
        terms=structure, noise_variance=float(residual), drift_variance=wander**2 / whole.n_samples
    ).fit(list(training))


def _constants(structure: Structure, training: Recordings) -> dict[str, NarxModel]:
    """Return constant parameters of the smallest free-run error, started from least squares."""
    constant = Fixed(terms=structure).fit(list(training)).model_
    sound = all(constant.simulate(section).status.ok for section in training)
    return {CONSTANT: constant, REFINED: refine(constant, list(training)) if sound else constant}


def _likeliest(structure: Structure, training: Recordings) -> ThetaTrajectory:
    """Return the parameters for the most likely variances of the walk."""
    smoother = ThetaSmoother(terms=structure, drift="common").fit(list(training))
    if smoother.status_ is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return smoother.trajectory_


def free_run_errors(model: NarxModel | ThetaTrajectory, sections: Recordings) -> Array:
    """Return errors of free runs, each started from the first samples of its section. Shapes: returns (n,)."""
    errors = []
    for section in sections:
        run = model.simulate(section)
        errors.append(run.residuals[0] if run.status.ok else np.full(section.n_samples - run.first, np.inf))
    return np.concatenate(errors)


def _ahead(filtered: ThetaTrajectory, recording: Recording) -> float:
    """Return the error on each block of a model trained on earlier samples only, in the output's unit."""
    every = _cut(recording)[PAST:]
    runs = [free_run_errors(filtered.at(block.start - block.sample_time), [block]) for block in every]
    return root_mean_square(np.concatenate(runs))


def blocks_of(recording: Recording, kind: int) -> list[Recording]:
    """Return every fourth block of a record."""
    return [block for number, block in enumerate(_cut(recording)) if number % CYCLE == kind]


def stretches(recording: Recording, left_out: Sequence[int]) -> list[Recording]:
    """Return the stretches of a record that remain without some kinds of blocks, with neighbours joined."""
    size, count = _block_size(recording), len(_cut(recording))
    kept = np.array([number % CYCLE not in left_out for number in range(count)])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(int), [0]])))
    return [recording.section(a * size, b * size) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _cut(recording: Recording) -> list[Recording]:
    """Return the complete blocks; a remainder at the end is not used."""
    size = _block_size(recording)
    return [recording.section(k * size, (k + 1) * size) for k in range(recording.n_samples // size)]


def _block_size(recording: Recording) -> int:
    """Return the number of samples in a block, an even number."""
    return 2 * round(BLOCK / recording.sample_time / 2)


def _within(blocks: Iterable[Recording], training: Recordings) -> list[Recording]:
    """Return the blocks between the first and the last training sample, where parameters are known."""
    return [b for b in blocks if b.start > training[0].start and b.end < training[-1].end]
