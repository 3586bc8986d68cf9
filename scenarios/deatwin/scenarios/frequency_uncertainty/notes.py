"""What the page says in words: the answer to the thesis' question, what it rests on, and what is not known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.scenarios.frequency_uncertainty.actuators import FACTOR, REPEATS, STRUCTURE
from deatwin.scenarios.frequency_uncertainty.benchmarks import Benchmarks
from deatwin.scenarios.frequency_uncertainty.consistency import SLOW, Consistency
from deatwin.scenarios.frequency_uncertainty.study import Study
from deatwin.scenarios.frequency_uncertainty.verdicts import DRIFTING, FASTER
from deatwin.scenarios.frequency_uncertainty.words import band_of
from deatwin.studies.report.story import Note

Array = NDArray[np.float64]


def answer(fleet: Consistency) -> str:
    """How consistent fabrication is, in a few sentences."""
    steady, recorded = fleet.spread("steady"), fleet.spread("fleet")
    table, as_is = fleet.tables["steady"], fleet.tables["fleet"]
    worst = int(np.argmax(steady))
    order, low, high = fleet.columns[worst]
    return (
        f"Fabrication alone makes the six differ by {_by_order(fleet, steady)} (standard deviation), most in "
        f"H{'₁₂₃'[order - 1]} at {band_of(low, high)}, and significantly in {_count(table, Agreement.DIFFERENT)} of "
        f"{len(table.differences)} tests. What happens to them while they are recorded raises that to "
        f"{_by_order(fleet, recorded)}. Of the {len(as_is.significant)} tests that then find a difference "
        f"{_count(as_is, Agreement.DRIFT)} lie within the reach of drift."
    )


def notes(study: Study) -> list[Note]:
    """Write the notes."""
    fleet = study.consistency
    return [_words(), _question(fleet), _comparison(fleet), _propagation(study.benchmarks), _figures()]


def _words() -> Note:
    return Note(
        title="What the letters mean",
        paragraphs=[
            "Order n of an output is of n-th power in the input. Hₙ is its generalised frequency response function, a "
            "function of n frequencies; H₁ is the ordinary frequency response. Yₙ is the spectrum of order n of the "
            "output. “Propagated” is what follows for a response from the covariance of the model's parameters, to "
            "first order; “draws” are responses of models whose parameters are drawn from that covariance.",
            "A difference is significant if its probability by chance, multiplied for the number of tests as Holm "
            "does it, is below 5 %. A history is what happens to an actuator while it is recorded.",
        ],
    )


def _question(fleet: Consistency) -> Note:
    leading = sorted(fleet.shares, key=lambda name: -float(np.sum(fleet.shares[name])))[:3]
    names = _listed([name.replace("_", " ").replace(".", " ") for name in leading])
    unseen = [d.size for d in fleet.tables["steady"].differences if not d.differs]
    return Note(
        title="How consistent is fabrication?",
        paragraphs=[
            answer(fleet),
            f"The tolerances from which the fleet is drawn predict {_by_order(fleet, fleet.predicted)}; found are "
            f"{_by_order(fleet, fleet.spread('steady'))}. Most of it comes from {names}.",
            f"Where no difference is found there may be one: in the {len(unseen)} such tests of the six without "
            f"histories the measured difference is up to {100 * max(unseen, default=0.0):.0f} % of the gain, mostly "
            "in the third order, which a record tells least well.",
        ],
    )


def _comparison(fleet: Consistency) -> Note:
    repeats = fleet.tables["repeats"]
    found = np.array([d.p_value < repeats.level for d in repeats.differences])
    single, columns = found.mean(), 100 * found.reshape(len(repeats.pairs), -1).mean(axis=0)
    late = [name for name in DRIFTING if not any(d.drifts for d in fleet.tables["fleet"].drifts if d.name == name)]
    return Note(
        title="What the comparison rests on",
        paragraphs=[
            f"All records are fitted with the same {len(STRUCTURE)} terms at every {FACTOR}th sample, by least "
            "squares, and compared at 2.4 V by the mean of each response over each band of output frequencies, a "
            "complex number. The terms are set beforehand: of terms chosen on the data no covariance says how much "
            "they owe to the choice. They do not hold all of the physics, so that residuals are not white and the "
            "covariance of least squares is wrong; how far parameters scatter is read from the record itself.",
            f"Whether that is right is told by {REPEATS} records of one actuator that does not change, each under "
            f"noise of its own: {100 * single:.1f} % of their single tests find a difference at 5 %, "
            f"by order and band {columns.min():.1f} to {columns.max():.1f} %.",
            f"Differences of the records as they are may be differences of age. The {SLOW} slowest cosines over each "
            "record say whether and how far it drifts; a pair counts as different beyond drift where no time of one "
            "record is like any time of the other. What varies faster is followed in part only: the room of the "
            "fourth actuator goes through nearly two cycles while it is compared."
            f"{f' No drift is found for {_listed(late)}, and that measure is missed.' if late else ''} One fabrication "
            "with each of the five histories that go on is the test of that: what is called different there is called "
            "so wrongly, unless a history has already done something that it does not undo by the time the records "
            "begin. They begin at 60 s, after the transient from rest, and after the shift of the sixth actuator at "
            "45 s, which from then on is a difference like any other.",
        ],
    )


def _propagation(benchmarks: Benchmarks) -> Note:
    slow = [f"{one.label} ({one.ratio:.0f})" for one in benchmarks.speeds if one.ratio < FASTER]
    return Note(
        title="When the law of propagation holds",
        paragraphs=[
            "The covariance of a response is J Σ J', with the exact derivative J of real and imaginary part by the "
            "parameters, through the operating point too. It is the law of a response that is linear in the "
            "parameters. The nonlinearity is how far the response departs from its tangent over the spread of the "
            "parameters, in units of the ellipse; up to 0.25 the law is taken to hold, and beyond it propagation "
            "warns.",
            "Gain and phase have a law of their own on top, which fails where the gain is near zero however well the "
            "parameters are known: there the gain of a complex normal number is never negative and its phase is "
            "anything. Ellipses in the complex plane hold there.",
            "Equal accuracy of propagation and draws means as many draws as make the covariance of the draws depart "
            "as far from the true one as the propagated does. Where propagation is off by a per cent, as about the "
            "resonance of the linear system, not many are needed; where all draws together cannot tell it from exact, "
            "the number is a lower bound."
            f"{f' The ratio of {FASTER:g} is missed for {_listed(slow)}.' if slow else ''}",
        ],
    )


def _figures() -> Note:
    return Note(
        title="What of the thesis' figures is known",
        paragraphs=[
            "Of figures 7.1 to 7.6 the caption of the first can be read in public: an interval for a real quantity "
            "beside an ellipse for a complex one. What the other five show could not be found. From the section's text "
            "and the abstract of the paper that grew from the chapter (Jacobs, Dodd, Anderson, IEEE Trans. Automatic "
            "Control 64, 2019, doi:10.1109/TAC.2018.2866474) they take normally distributed parameters to frequency "
            "responses of synthetic systems and of one real system, and hold that against Monte Carlo sampling. The "
            "numbers 7.2 to 7.6 here follow the chapter's course, and the systems are benchmark systems of the "
            "identification literature: whether figure for figure the same is drawn is not known."
        ],
    )


def _by_order(fleet: Consistency, spread: Array) -> str:
    """Ranges over the bands, for each order."""
    texts = []
    for order in sorted({column[0] for column in fleet.columns}):
        of = [100 * value for value, column in zip(spread, fleet.columns, strict=True) if column[0] == order]
        low, high = f"{min(of):.0f}", f"{max(of):.0f}"
        texts.append(f"{low if low == high else f'{low} to {high}'} % in H{'₁₂₃'[order - 1]}")
    return _listed(texts)


def _count(table: Comparison, kind: Agreement) -> int:
    return sum(d.agreement is kind for d in table.differences)


def _listed(texts: list[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]
