"""Find where actuators differ, and distinguish the actuators from the age at which they were recorded.

All records are fitted with the same terms. What each block says of the mean of H_n over a band is a series in time: its
slowest cosines are the drift, the others the scatter, so one fit of each record says how well the means are known.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import probability, whole_number
from deatwin.ident.frequency.comparison.bands import (
    BandMean,
    Equality,
    Range,
    Scatter,
    band_means,
    equality,
    holm,
    no_drift,
    whole_orders,
)
from deatwin.ident.frequency.comparison.compare import (
    Agreement,
    Comparison,
    Difference,
    Drift,
    difference_of,
    tabulated,
)
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings
from deatwin.ident.narx.robust import BLOCKS, Cosines, pseudovalues
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

SLOW = 8  # Slow cosines of a drift, up to four periods per record: most of the power of a cycle that occurs twice
TIMES = np.linspace(0.0, 1.0, 41)
"""Times at which drifting records are compared, as shares of a record: ten per period of the fastest cosine."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Track:
    """The mean of H_n over a band in one record, and its cosines."""

    mean: BandMean
    cosines: Cosines
    drift: Drift
    moves: bool = False  # True if the record drifts in any order and band

    @property
    def motion(self) -> tuple[Array, Array]:
        """Return values during the record, (n_times, 2), and their squared scales; one time if there is no drift."""
        if not self.moves:
            return self.mean.value[None], self.cosines.scale[None]
        return self.mean.value + self.cosines.drift(TIMES), self.cosines.drift_scales(TIMES)


def compare_records(
    recordings: Mapping[str, Recordings],
    terms: NarxModel | Sequence[Term | str],
    orders: Iterable[int],
    bands: Sequence[Range],
    *,
    operating_input: ArrayLike | None = None,
    input_band: Range | None = None,
    level: float = 0.05,
    least: float = 0.0,
    n_slow: int = SLOW,
    n_blocks: int = BLOCKS,
) -> Comparison:
    """Test in which orders and bands recordings of several actuators differ, and whether drift may be the cause.

    Every recording is fitted with the same terms by least squares. Each pair of recordings is then compared as in
    `compare`, with a covariance estimated from the scatter between blocks of each recording.

    If the two mean responses of a pair differ, the responses at all times of one recording are compared with those at
    all times of the other. If no two of these responses agree, the actuators differ; otherwise drift may be the cause.
    A recording without significant drift is assumed to have a constant response.

    Parameters
    ----------
    recordings : mapping of str to Recording, Experiment, or several
        Recordings of one input and one output, by the name of the actuator. They need the same excitation, the same
        sampling time and about the same length.
    terms : NarxModel, or sequence of Term or str
        Terms of the model that is fitted to each recording.
    orders : iterable of int
        Orders n of H_n, up to 5.
    bands : sequence of (float, float)
        Bands of output frequencies w_1 + ... + w_n, Hz.
    operating_input : float, optional
        Constant input about which all models are expanded, in the input's unit. By default the mean input of all
        recordings.
    input_band : tuple of float, optional
        Lowest and highest input frequency w_i, Hz; by default 0 and the highest edge of the bands.
    level : float
        Probability of finding at least one difference although there is none, and of finding at least one drift
        although there is none. The p-values are corrected for the number of tests (Holm).
    least : float
        Largest difference that is ignored, as a share of the root mean square gain in the band.
    n_slow : int
        Number of cosines that model the drift. The first has half a period in the recording, the second one period, and
        so on.
    n_blocks : int
        Number of blocks into which each recording is divided. A block must be longer than the memory of the actuators.

    Returns
    -------
    Comparison
        Table of the differences between recordings, and of the drifts within each recording.

    Raises
    ------
    ModelError
        If there are fewer than two recordings, if a recording is too short or does not determine the parameters, or for
        the reasons given in `compare`.
    """
    if not isinstance(recordings, Mapping) or len(recordings) < 2:
        raise ModelError("a comparison needs the recordings of at least two actuators, by their names")
    several, n_slow, level = whole_orders(orders), whole_number(n_slow, "n_slow"), probability(level)
    models = {name: Fixed(terms=terms).fit(given).model_ for name, given in recordings.items()}
    centres = [m.operating.input_centre for m in models.values() if m.operating is not None]
    where = np.mean(centres, axis=0) if operating_input is None else operating_input
    followed = {}
    for name, model in models.items():
        means = band_means(model, several, bands, operating_input=where, input_band=input_band)
        values = Cosines.of(pseudovalues(model, recordings[name], n_blocks=n_blocks), n_slow)
        followed[name] = tuple(_track(name, mean, values.projected(mean.gradient)) for mean in means)
    tracks = _judged(followed, level)
    pairs = [
        (difference_of(a.mean, b.mean, (first, second), least), a, b)
        for first, second in itertools.combinations(tracks, 2)
        for a, b in zip(tracks[first], tracks[second], strict=True)
    ]
    table = tabulated([difference for difference, _, _ in pairs], level)
    beyond = [_beyond_drift(d, a, b, least) for d, (_, a, b) in zip(table.differences, pairs, strict=True)]
    explained = holm([test.p_value for test in beyond]) >= level
    return replace(
        table,
        differences=tuple(
            replace(d, agreement=Agreement.DRIFT) if d.differs and by_drift else d
            for d, by_drift in zip(table.differences, explained, strict=True)
        ),
        drifts=tuple(track.drift for each in tracks.values() for track in each),
    )


def _track(name: str, mean: BandMean, cosines: Cosines) -> _Track:
    """Follow a mean through its record, uncorrected."""
    way = cosines.drift(TIMES)
    reach = float(np.linalg.norm(way[:, None] - way, axis=-1).max())
    test = no_drift(cosines)
    drift = Drift(
        name=name,
        order=mean.order,
        from_Hz=mean.from_Hz,
        to_Hz=mean.to_Hz,
        test=test,
        adjusted=test.p_value,
        size=reach / mean.gain if mean.gain > 0 else 0.0,
        drifts=False,
    )
    known = replace(mean, scatter=Scatter(scale=cosines.scale, dof=float(cosines.dof)))
    return _Track(mean=known, cosines=cosines, drift=drift)


def _judged(tracks: Mapping[str, tuple[_Track, ...]], level: float) -> dict[str, tuple[_Track, ...]]:
    """Correct the tests of drift for their number. A record that drifts anywhere counts as drifting everywhere."""
    corrected = iter(holm([track.drift.p_value for each in tracks.values() for track in each]))
    judged = {}
    for name, each in tracks.items():
        p_values = [float(next(corrected)) for _ in each]
        moves = min(p_values) < level
        judged[name] = tuple(
            replace(track, drift=replace(track.drift, adjusted=p, drifts=p < level), moves=moves)
            for track, p in zip(each, p_values, strict=True)
        )
    return judged


def _beyond_drift(difference: Difference, a: _Track, b: _Track, least: float) -> Equality:
    """Test whether two records differ by more than the drift within each record."""
    if not difference.differs or not (a.moves or b.moves):
        return difference.test
    (one, its), (other, others) = a.motion, b.motion
    gain = float(np.hypot(a.mean.gain, b.mean.gain) / np.sqrt(2))
    return equality(
        one[:, None] - other,
        (Scatter(its[:, None], a.cosines.dof), Scatter(others[None, :], b.cosines.dof)),
        least * gain,
    )


Means = tuple[BandMean, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Contrast:
    """Measured and true difference of two actuators in one order and band, relative to the gain."""

    measured: float  # Measured difference, along the direction of the true one
    true: float  # Magnitude of the true difference
    error: float  # Standard error of the measured difference
    inside: bool  # True if the complex true difference lies in the 95 % region of the measured one


def contrast(measured: tuple[BandMean, BandMean], true: tuple[BandMean, BandMean]) -> Contrast:
    """Compare a measured difference with the true one."""
    gain = float(np.hypot(true[0].gain, true[1].gain) / np.sqrt(2))
    away, apart = (pair[0].value - pair[1].value for pair in (measured, true))
    along = apart / max(float(np.linalg.norm(apart)), np.finfo(float).tiny)
    scale = sum(mean.scatter.scale for mean in measured)
    test = equality(away - apart, [mean.scatter for mean in measured])
    return Contrast(
        measured=float(along @ away) / gain,
        true=float(np.linalg.norm(apart)) / gain,
        error=float(np.sqrt(along @ scale @ along)) / gain,
        inside=test.p_value > 0.05,
    )


def spread_of_means(group: Iterable[Means]) -> Array:
    """Return the relative standard deviation (n_columns,) of a group, without the estimates' own scatter."""
    found = []
    for column in zip(*group, strict=True):
        values = np.array([mean.value for mean in column])
        scatter = np.mean([np.trace(m.scatter.scale) * (1.0 + 2.0 / (m.scatter.dof - 2.0)) for m in column])
        variance = values.var(axis=0, ddof=1).sum() - scatter
        gain = np.sqrt(np.mean([mean.gain**2 for mean in column]))
        found.append(np.sqrt(max(0.0, variance)) / gain)
    return np.array(found)


def shares_of(wished: Means, off: Mapping[str, Means]) -> dict[str, Array]:
    """Return the spread (n_columns,) due to each tolerance alone; `off` has the responses at the tolerances' ends."""
    return {
        name: np.array(
            [np.linalg.norm(a.value - b.value) / (np.sqrt(3) * b.gain) for a, b in zip(made, wished, strict=True)]
        )
        for name, made in off.items()
    }


def share_of(table: Comparison, agreement: Agreement) -> Array:
    """Return the share of a table's pairs with a given agreement. Shapes: returns (n_columns,)."""
    flags = np.array([d.agreement is agreement for d in table.differences])
    return np.asarray(flags.reshape(len(table.pairs), len(table.columns)).mean(axis=0))
