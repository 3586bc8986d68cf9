"""Requirements on a closed loop: limits with their sources."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import Enum
from math import inf, isfinite
from typing import Any

from deatwin.control.arguments import finite, instance, number, require_fields
from deatwin.control.errors import ControlError


class Verdict(Enum):
    """Verdict on a controller, or on one quantity of its loop.

    ``PASS`` if every requirement is met, ``FAIL`` if a requirement is not met even at its weaker limit, else
    ``MARGINAL``; see `Limit`.
    """

    PASS = "pass"
    MARGINAL = "marginal"
    FAIL = "fail"

    @property
    def severity(self) -> int:
        """Severity: 0 for pass, 1 for marginal, 2 for fail."""
        return list(Verdict).index(self)


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Requirement on a number: it passes if it reaches `good`, is marginal if it reaches `poor`, and otherwise fails.

    Parameters
    ----------
    good, poor : float
        Limits of `pass` and of `marginal`, in the unit of the number. Larger is better if ``good`` is above ``poor``.
    unit : str
        Unit shown to the user; ``%`` for a share.

    Raises
    ------
    ControlError
        If ``good`` and ``poor`` are not finite numbers, or are equal.
    """

    good: float
    poor: float
    unit: str = ""

    def __post_init__(self) -> None:
        require_fields(self, good=number, poor=number, unit=instance(str))
        if not (isfinite(self.good) and isfinite(self.poor) and self.good != self.poor):
            raise ControlError(
                "the good and the poor value of a limit must be finite and must differ, because their order states whether "
                f"more or less is better; they are {self.good} and {self.poor}"
            )

    def judge(self, value: float) -> Verdict:
        """Judge a `value` in the unit of the limit; NaN fails."""
        sign = 1.0 if self.more_is_better else -1.0
        if sign * value >= sign * self.good:
            return Verdict.PASS
        return Verdict.MARGINAL if sign * value >= sign * self.poor else Verdict.FAIL

    def room(self, value: float) -> float:
        """Return the room between a number and the limit of `pass`, as a share of the possible room.

        Parameters
        ----------
        value : float
            Number, in the unit of the limit.

        Returns
        -------
        float
            0 at the limit, 1 at the best possible value, negative outside. The best value is 1 (100 %) for a share if
            more is better, infinity for any other number if more is better, and 0 if less is better.

        Examples
        --------
        >>> Limit(good=2.0, poor=1.5).room(8.0), Limit(good=0.5, poor=0.75).room(0.125)
        (0.75, 0.75)
        >>> Limit(good=0.75, poor=0.5, unit="%").room(0.875)
        0.5
        """
        if self.more_is_better and self.unit != "%":
            return 1.0 - self.good / value if value > 0.0 else -inf
        best = 1.0 if self.more_is_better else 0.0
        if self.good == best:  # no distance between them in which to place the value
            return 1.0 if value == best else -inf
        return (value - self.good) / (best - self.good)

    @property
    def more_is_better(self) -> bool:
        """True if larger values are better: the good limit is above the poor one."""
        return self.good > self.poor

    @property
    def wanted(self) -> str:
        """The good value as text."""
        value, unit = (100.0 * self.good, " %") if self.unit == "%" else (self.good, self.unit)
        return f"at {'least' if self.more_is_better else 'most'} {value:.{4 if value >= 1000 else 3}g}{unit}"


@dataclass(frozen=True, kw_only=True)
class Specification:
    """Requirements on a closed loop.

    The default margins follow textbooks: Åström & Murray, Feedback Systems (2008), section 9.3 (gain margin 2 to 5,
    phase margin 30 to 60 degrees); Skogestad & Postlethwaite, Multivariable Feedback Control (2005), section 2.4.3
    (gain margin above 2, phase margin above 30 degrees). The other defaults are our choice.

    Parameters
    ----------
    gain : Limit
        Gain margin, as a factor.
    phase_deg : Limit
        Phase margin, degrees.
    delay_samples : Limit
        Delay margin, samples: a command that comes one sample late must not make the loop unstable.
    disk : Limit
        Symmetric disk margin. Values of 2/3 and 0.4 correspond to gain margins of 2 and 1.5, but also allow
        simultaneous changes of the phase.
    stable_share : Limit
        Share of the posterior's draws with a stable closed loop.
    overshoot : Limit
        Overshoot of a step, as a share of the step. The defaults are approximately the overshoots at phase margins of
        45 and 30 degrees in a second-order loop (Åström & Murray, sections 6.3 and 9.3).
    steady_error : Limit
        Mean error in the last third of a level of a step reference, as a share of the step; integral action brings it
        to zero.
    ripple : Limit
        Rms motion in the last third of a level, as a share of the step; large values mean ringing or a limit cycle.
    saturated : Limit
        Share of samples whose command is at a limit.
    tracking : Limit
        Rms error on a slow sine, divided by the error that the model predicts.
    diverged : Limit
        Share of the model's draws whose own closed loop diverges.
    width : Limit
        Half width of the predicted band relative to the step; a band that reaches more than a step to either side is
        too uncertain to pass.
    inside : Limit
        Share of a run that lies inside the simultaneous band predicted by the model.
    limit_cycle : Limit
        Amplitude of a predicted stable limit cycle, as a share of a step.
    safe_region : Limit
        Amplitude of a predicted unstable limit cycle, as a share of a step; steps have to stay inside it.
    reserve : float
        Share by which a check tightens the limits of overshoot, steady-state error, ripple and saturation, because it
        tries the controller on a plant and not on the actuator itself (our choice).

    Raises
    ------
    ControlError
        If a limit is not a `Limit` or has its good and poor values swapped, if a gain margin is below 1, or if the
        reserve is not a share.
    """

    gain: Limit = Limit(good=2.0, poor=1.5)
    phase_deg: Limit = Limit(good=45.0, poor=30.0, unit="°")
    delay_samples: Limit = Limit(good=1.0, poor=0.5, unit=" samples")
    disk: Limit = Limit(good=2.0 / 3.0, poor=0.4)
    stable_share: Limit = Limit(good=0.975, poor=0.9, unit="%")
    overshoot: Limit = Limit(good=0.25, poor=0.5, unit="%")
    steady_error: Limit = Limit(good=0.05, poor=0.15, unit="%")
    ripple: Limit = Limit(good=0.1, poor=0.3, unit="%")
    saturated: Limit = Limit(good=0.05, poor=0.25, unit="%")
    tracking: Limit = Limit(good=1.5, poor=3.0)
    diverged: Limit = Limit(good=0.025, poor=0.1, unit="%")
    width: Limit = Limit(good=1.0, poor=1e9)
    inside: Limit = Limit(good=0.99, poor=0.0, unit="%")
    limit_cycle: Limit = Limit(good=0.05, poor=0.3, unit="%")
    safe_region: Limit = Limit(good=2.0, poor=1.0, unit="%")
    reserve: float = 0.2

    def __post_init__(self) -> None:
        a_limit = instance(Limit, hint=", with a good and a poor value")
        require_fields(self, **dict.fromkeys(_defaults(), a_limit), reserve=finite)
        for name, default in _defaults().items():
            limit = getattr(self, name)
            if limit.more_is_better is not default.more_is_better:
                sense, side = ("more", "above") if default.more_is_better else ("less", "below")
                raise ControlError(
                    f"{name}: {sense} is better, so good must be {side} poor, but good = {limit.good:g} and "
                    f"poor = {limit.poor:g}"
                )
        if not 0.0 <= self.reserve < 1.0:
            raise ControlError(f"reserve = {self.reserve:g}; it must be at least 0 and less than 1")
        if min(self.gain.good, self.gain.poor) < 1.0:
            raise ControlError(
                f"gain: a gain margin is at least 1, but good = {self.gain.good:g} and poor = {self.gain.poor:g}"
            )

    @property
    def on_a_stand_in(self) -> Specification:
        """Requirements for runs on a plant that replaces the actuator: tightened by the reserve."""
        names = ("overshoot", "steady_error", "ripple", "saturated")
        limits: dict[str, Any] = {name: getattr(self, name) for name in names}
        kept = {n: replace(v, good=(1.0 - self.reserve) * v.good) for n, v in limits.items()}
        return replace(self, **kept, reserve=0.0)


def _defaults() -> dict[str, Limit]:
    """Return the default limits; they show which limits are upper and which are lower."""
    return {field.name: field.default for field in fields(Specification) if isinstance(field.default, Limit)}
