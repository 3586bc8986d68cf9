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

    ``PASS`` if every requirement is met, ``FAIL`` if a requirement is not met even at its weaker limit
    (`Limit.poor`), else ``MARGINAL``.
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
    """Requirement on a number. The number passes if it reaches `good`, is marginal if it reaches `poor`, else fails.

    Parameters
    ----------
    good, poor : float
        Limits of the verdicts pass and marginal, in the unit of the number. If `good` is above `poor`, larger numbers
        are better; otherwise smaller ones are.
    unit : str
        Unit for texts; ``%`` if the number is a share from 0 to 1.

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
        """Return the verdict on a `value`, in the unit of the limit; NaN fails."""
        sign = 1.0 if self.more_is_better else -1.0
        if sign * value >= sign * self.good:
            return Verdict.PASS
        return Verdict.MARGINAL if sign * value >= sign * self.poor else Verdict.FAIL

    def room(self, value: float) -> float:
        """Return the distance from `good` to a value, divided by that from `good` to the best possible value.

        Parameters
        ----------
        value : float
            Value, in the unit of the limit.

        Returns
        -------
        float
            0 at `good`, 1 at the best possible value, negative if the value does not pass. If smaller values are
            better, the best value is 0. If larger ones are better, it is 1 (100 %) for a share, and otherwise infinity;
            in the last case the result is ``1 - good/value``.

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
        Symmetric disk margin, which covers simultaneous changes of gain and phase. Disk margins of 2/3 and 0.4 imply
        gain margins of 2 and 1.5.
    stable_share : Limit
        Share of the draws from the posterior for which the closed loop is stable.
    overshoot : Limit
        Overshoot of a step, as a share of the step. The defaults are approximately the overshoots at phase margins of
        45 and 30 degrees in a second-order loop (Åström & Murray, sections 6.3 and 9.3).
    steady_error : Limit
        Mean error in the last third of each constant stretch of a step reference, as a share of the step. Integral
        action brings this error to zero.
    ripple : Limit
        Standard deviation of the error in the last third of each constant stretch, as a share of the step. It is large
        if the loop rings or has a limit cycle.
    saturated : Limit
        Share of samples whose command is at a limit.
    tracking : Limit
        Rms error for a slow sine reference, divided by the rms error that the model predicts.
    diverged : Limit
        Share of the draws from the model's posterior whose simulated closed loop diverges.
    width : Limit
        Half width of the predicted band of the output, divided by the height of the step. If the band is too wide, the
        verdict is marginal, because nearly every run would lie inside the band.
    inside : Limit
        Share of the samples of a simulated run that lie inside the band that the model predicts.
    limit_cycle : Limit
        Amplitude of a predicted stable limit cycle, as a share of the step.
    safe_region : Limit
        Amplitude of a predicted unstable limit cycle, as a share of the step. From larger amplitudes the loop does not
        return to rest.
    reserve : float
        Share by which `check` lowers the ``good`` limits of overshoot, steady-state error, ripple and saturation,
        because it simulates a plant instead of measuring the actuator.

    Raises
    ------
    ControlError
        If a limit is not a `Limit`, if its `good` and `poor` are swapped, if a limit of the gain margin is below 1, or
        if the reserve is negative or at least 1.
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
        """Requirements for simulated runs on a plant: the same requirements, tightened by the reserve."""
        names = ("overshoot", "steady_error", "ripple", "saturated")
        limits: dict[str, Any] = {name: getattr(self, name) for name in names}
        kept = {n: replace(v, good=(1.0 - self.reserve) * v.good) for n, v in limits.items()}
        return replace(self, **kept, reserve=0.0)


def _defaults() -> dict[str, Limit]:
    """Return the default limits; they show which limits are upper and which are lower."""
    return {field.name: field.default for field in fields(Specification) if isinstance(field.default, Limit)}
