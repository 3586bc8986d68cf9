"""Test whether two models differ: in which order, in which band, and by how much."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import probability, real_number
from deatwin.ident.frequency.comparison.bands import BandMean, Equality, Range, band_means, equality, holm, whole_orders
from deatwin.ident.frequency.linear import operating_input_of
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes
from deatwin.plant.errors import ModelError
from deatwin.plant.words import spaced


class Agreement(Enum):
    """Outcome of the comparison of two frequency responses in one band of frequencies.

    The value of each member is a message for the user.
    """

    ALIKE = "no difference can be shown: in this band, each may be used in place of the other"
    DRIFT = "the means differ, but a drift within a record may be the cause: compare at the same age"
    DIFFERENT = (
        "the two differ by more than chance and drift explain: in this band, neither may be used in place of the other"
    )

    @property
    def ok(self) -> bool:
        """True if no difference can be shown."""
        return self is Agreement.ALIKE


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference between two frequency responses for one order and one band: one entry of a `Comparison`.

    Parameters
    ----------
    first, second : str
        Names of the two responses.
    order : int
        Order n of the generalised frequency response H_n (`gfrf`).
    from_Hz, to_Hz : float
        Edges of the band of output frequencies, Hz.
    test : Equality
        Test of the hypothesis that the means of both responses over the band differ by no more than the share
        ``least`` of the gain (see `compare`; 0 by default).
    adjusted : float
        The p-value of the test, corrected for the number of tests.
    size : float
        Magnitude of the difference of the two means, divided by the root mean square gain of both responses in the
        band.
    agreement : Agreement
        Outcome of the test.
    """

    first: str
    second: str
    order: int
    from_Hz: float
    to_Hz: float
    test: Equality
    adjusted: float
    size: float
    agreement: Agreement

    @property
    def p_value(self) -> float:
        """The p-value of this test alone, without correction for the number of tests."""
        return self.test.p_value

    @property
    def differs(self) -> bool:
        """True if the means over the band differ significantly; a drift may still be the cause."""
        return not self.agreement.ok

    @property
    def sentence(self) -> str:
        """Description of the difference in one sentence."""
        what = f"H_{self.order} of {self.first} and {self.second} from {self.from_Hz:g} to {self.to_Hz:g} Hz"
        if not self.differs:
            return f"{what}: no difference can be shown (p = {self.adjusted:.2g})."
        drift = ", which a drift within a record may explain" if self.agreement is Agreement.DRIFT else ""
        return f"{what}: they differ by {self.size:.2g} of the gain (p = {self.adjusted:.2g}){drift}."


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Drift of a frequency response within one recording, for one order and one band.

    Parameters
    ----------
    name : str
        Name of the recording.
    order : int
        Order n of the generalised frequency response H_n (`gfrf`).
    from_Hz, to_Hz : float
        Edges of the band of output frequencies, Hz.
    test : Equality
        Test of the hypothesis that there is no drift.
    adjusted : float
        The p-value of the test, corrected for the number of tests.
    size : float
        Largest difference between the band's mean responses at two times, divided by the root mean square gain. Part of
        this difference is due to chance.
    drifts : bool
        True if the drift is significant.
    """

    name: str
    order: int
    from_Hz: float
    to_Hz: float
    test: Equality
    adjusted: float
    size: float
    drifts: bool

    @property
    def p_value(self) -> float:
        """The p-value of this test alone, without correction for the number of tests."""
        return self.test.p_value


def _each(name: str) -> Callable[[Comparison], Any]:
    """Return a property of each difference, by pair and column."""
    values = attrgetter(name)
    return lambda found: np.reshape([values(d) for d in found.differences], (len(found.pairs), len(found.columns)))


@dataclass(frozen=True, kw_only=True)
class Comparison(Described):
    """Table of the differences between two or more frequency responses.

    Parameters
    ----------
    differences : tuple of Difference
        Differences sorted by pair of responses, then by order, then by band.
    level : float
        Probability that the table states at least one difference although there is none.
    drifts : tuple of Drift
        Drifts sorted by recording, then by order, then by band. Empty if models were compared.
    """

    differences: tuple[Difference, ...]
    level: float = field(metadata=attribute())
    drifts: tuple[Drift, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "p_value": variable("pair", "column", of=_each("p_value")),
        "adjusted": variable("pair", "column", of=_each("adjusted")),
        "size": variable("pair", "column", of=_each("size")),
        "agreement": variable("pair", "column", of=_each("agreement.name")),
        "pair": coordinate("pair", of=lambda found: [f"{first}, {second}" for first, second in found.pairs]),
        "order": coordinate("column", of=lambda found: [order for order, _, _ in found.columns]),
        "from_Hz": coordinate("column", of=lambda found: [low for _, low, _ in found.columns], unit="Hz"),
        "to_Hz": coordinate("column", of=lambda found: [high for _, _, high in found.columns], unit="Hz"),
    }

    @property
    def ok(self) -> bool:
        """True if no difference can be shown anywhere."""
        return not self.significant

    @property
    def significant(self) -> tuple[Difference, ...]:
        """The significant differences, the most certain first."""
        return tuple(sorted((d for d in self.differences if d.differs), key=lambda d: (d.p_value, -d.size)))

    @property
    def share(self) -> float:
        """Share of the tests that find a difference."""
        return len(self.significant) / len(self.differences)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the responses in each pair that was compared."""
        return tuple(dict.fromkeys((d.first, d.second) for d in self.differences))

    @property
    def columns(self) -> tuple[tuple[int, float, float], ...]:
        """Order and band edges (Hz) of each combination that was compared, as (order, low, high)."""
        return tuple(dict.fromkeys((d.order, d.from_Hz, d.to_Hz) for d in self.differences))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The differences as sentences, the most certain first; a single sentence if there is none."""
        return tuple(d.sentence for d in self.significant) or (
            f"None of {len(self.differences)} tests finds a difference at the level of {self.level:g}.",
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot each difference on `ax` or new axes, with a row for each pair and a column for each order and band."""
        pairs, columns = self.pairs, self.columns
        shape = len(pairs), len(columns)
        rows = [f"{first} – {second}" for first, second in pairs]
        if ax is None:
            from matplotlib import pyplot

            wide, high = 1.6 + 0.6 * shape[1] + 0.075 * max(map(len, rows)), 1.2 + 0.25 * shape[0]
            ax = pyplot.subplots(figsize=(max(6.4, wide), max(4.0, high)), layout="constrained")[1]
        sizes = np.array([100 * d.size if d.differs else np.nan for d in self.differences]).reshape(shape)
        most = max(float(np.nanmax(sizes, initial=0.0)), 1.0)
        image = ax.imshow(sizes, cmap="YlOrBr", vmin=0.0, vmax=most, aspect="auto")
        for number, difference in enumerate(self.differences):
            if difference.differs:
                percent = 100 * difference.size
                text = f"{percent:.0f}" if percent >= 10 else f"{percent:.1f}"
                row, column = divmod(number, shape[1])
                ax.text(
                    column,
                    row,
                    f"({text})" if difference.agreement is Agreement.DRIFT else text,
                    ha="center",
                    va="center",
                    fontsize="small",
                    color="white" if percent > 0.6 * most else "black",
                )
        ax.set_yticks(range(shape[0]), rows, fontsize="small")
        names = [f"$H_{order}$\n{low:g}–{high:g}" for order, low, high in columns]
        ax.set_xticks(range(shape[1]), names, fontsize="small")
        ax.set_xlabel("order and band of output frequencies (Hz)")
        for edge in np.flatnonzero(np.diff([order for order, _, _ in columns])):
            ax.axvline(edge + 0.5, color="0.4", linewidth=0.8)
        ax.figure.colorbar(image, ax=ax, label="difference (% of gain); in brackets: may be drift")
        return ax


def compare(
    first: NarxModel,
    second: NarxModel,
    orders: Iterable[int],
    bands: Sequence[Range],
    *,
    operating_input: ArrayLike | None = None,
    input_band: Range | None = None,
    level: float = 0.05,
    least: float = 0.0,
    names: tuple[str, str] = ("first", "second"),
) -> Comparison:
    """Test in which orders and frequency bands the frequency responses of two independent models differ.

    For each order n and band, the test compares the complex means of the generalised frequency response H_n over the
    band. The covariances of these means follow from the covariances of the models' parameters.

    If the models represent all physics, their terms may differ. Otherwise compare only models that have the same terms,
    were fitted in the same way to recordings with similar excitation, and have covariances from `robust`.

    A change that averages out over a band is missed, for example a small shift of a resonance within the band. To find
    such a change, choose bands no wider than the resonance.

    Parameters
    ----------
    first, second : NarxModel
        Models of one input and one output, in the same units, identified from different data.
    orders : iterable of int
        Orders n of H_n, up to 5.
    bands : sequence of (float, float)
        Bands of output frequencies w_1 + ... + w_n, Hz.
    operating_input : float, optional
        Constant input about which both models are expanded, in the input's unit. By default halfway between the mean
        training inputs of the two models.
    input_band : tuple of float, optional
        Lowest and highest input frequency w_i, Hz; by default 0 and the highest edge of the bands.
    level : float
        Probability of finding at least one difference although there is none. The p-values of all orders and bands are
        corrected for their number (Holm).
    least : float
        Largest difference that is ignored, as a share of the root mean square gain in the band.
    names : tuple of str
        Names of the two models in the table.

    Raises
    ------
    ModelError
        If the units of the models differ, if neither model has a covariance, if an argument is invalid, if no output
        frequency lies in a band, or for the reasons given in `gfrf`.
    """
    for what in ("input_units", "output_units"):
        one, other = getattr(require_model(first), what), getattr(require_model(second), what)
        if one != other:
            raise ModelError(f"the models have the {spaced(what)} {one} and {other}: they must be the same")
    if not real_number(least, "least") >= 0:
        raise ModelError(f"least = {least}; it must be a share of at least 0")
    are_texts = isinstance(names, tuple | list) and all(isinstance(name, str) for name in names)
    if not are_texts or len(names) != 2 or names[0] == names[1]:
        raise ModelError(f"names = {names!r}; give two different names")
    where = operating_input
    if where is None:
        where = (operating_input_of(first, None) + operating_input_of(second, None)) / 2
    several = whole_orders(orders)
    ours, theirs = (
        band_means(model, several, bands, operating_input=where, input_band=input_band) for model in (first, second)
    )
    return tabulated([difference_of(a, b, names, least) for a, b in zip(ours, theirs, strict=True)], level)


def difference_of(a: BandMean, b: BandMean, names: tuple[str, str], least: float) -> Difference:
    """Compare two means over a band, without correction for the number of tests."""
    gain = float(np.hypot(a.gain, b.gain) / np.sqrt(2))
    apart = a.value - b.value
    test = equality(apart, (a.scatter, b.scatter), least * gain)
    return Difference(
        first=names[0],
        second=names[1],
        order=a.order,
        from_Hz=a.from_Hz,
        to_Hz=a.to_Hz,
        test=test,
        adjusted=test.p_value,
        size=float(np.linalg.norm(apart)) / gain if gain > 0 else 0.0,
        agreement=Agreement.ALIKE,
    )


def tabulated(differences: Sequence[Difference], level: float) -> Comparison:
    """Correct tests for their number, and decide which differences are significant."""
    level = probability(level)
    corrected = holm([d.p_value for d in differences])
    judged = (
        replace(d, adjusted=float(p), agreement=Agreement.DIFFERENT if p < level else Agreement.ALIKE)
        for d, p in zip(differences, corrected, strict=True)
    )
    return Comparison(differences=tuple(judged), level=level)
