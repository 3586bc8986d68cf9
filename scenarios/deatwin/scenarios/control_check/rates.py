"""How often a verdict kept its word, with exact bounds."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor

from deatwin.control.checking.specification import Verdict
from deatwin.scenarios.concealed_physics.rates import least
from deatwin.scenarios.control_check.trials import Outcome
from deatwin.scenarios.svb_benchmark.trials import Rate

PASS = Verdict.PASS.value


def inside(outcomes: Iterable[Outcome]) -> Rate:
    """Of the designs that the check passed, those whose true steps lie wholly inside the predicted band."""
    return Rate.of(o.inside == 1.0 for o in outcomes if o.verdict == PASS)


def sound(outcomes: Iterable[Outcome]) -> Rate:
    """Of the designs that the check passed, those that kept every limit on the true rig."""
    return Rate.of(o.sound is True for o in outcomes if o.verdict == PASS)


def caught(outcomes: Iterable[Outcome]) -> Rate:
    """Of the designs that broke a limit on the true rig, those that the check did not pass."""
    return Rate.of(o.verdict != PASS for o in outcomes if o.sound is False)


def broken(outcomes: Iterable[Outcome]) -> tuple[Outcome, ...]:
    """Trials whose verdict was `pass` and whose truth left the predicted band or broke a limit."""
    return tuple(o for o in outcomes if o.verdict == PASS and not (o.sound and o.inside == 1.0))


def least_percent(rate: Rate) -> int:
    """The one-sided lower 95 % bound of a rate, rounded down: what is printed is never more than what was shown.

    Examples
    --------
    >>> round(100 * least(Rate(hits=44, count=45)), 2), least_percent(Rate(hits=44, count=45))
    (89.89, 89)
    """
    return floor(100 * least(rate))


def in_words(rate: Rate) -> str:
    """A rate with its one-sided lower 95 % bound."""
    if not rate.count:
        return "no trial"
    bound = f"with 95 % confidence at least {least_percent(rate)} %"
    return f"{rate.hits} of {rate.count}, {100 * rate.share:.0f} % ({bound})"
