"""The stated measures: what is demanded of design and check, what they reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.control.checking.specification import Verdict
from deatwin.scenarios.control_check.concealed import Concealed, Designed
from deatwin.scenarios.control_check.rates import caught, in_words, inside
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import FleetRun, Tracked, Tracking
from deatwin.scenarios.control_check.trials import Outcome
from deatwin.scenarios.svb_benchmark.trials import Rate
from deatwin.studies.report.story import Row

LOWER = 5.0
"""Times that the error behind the inverse is below that of PI alone."""
NEAR = 2.0
"""Times the error of a design on the true plant."""
KEPT = 0.9
"""Share of the passed designs that keep inside the predicted band."""
CAUGHT = 0.9
"""Share of the unsound designs that the check does not pass."""
INVERSES = ("inverse", "inverse with dynamics")
EQUAL = 1e-6
"""Relative difference of margins that are equal: they are of one loop, computed twice."""


def judge(study: Study) -> list[Row]:
    """Hold the study against what is demanded."""
    nominal, electrode = study.tracking[0], named(study.concealed, "electrode_rc")
    base, amended = electrode.designs
    return [
        _pays(nominal),
        _near(nominal),
        _scheduled(study.fleet),
        _not_passed(base),
        _passed(amended),
        _kept(study.outcomes),
        _caught(study.outcomes),
    ]


def named(concealed: Sequence[Concealed], effect: str) -> Concealed:
    """What was found of an effect."""
    return next(one for one in concealed if one.effect == effect)


def _pays(tracking: Tracking) -> Row:
    alone = tracking.tracked["PI"]
    factors = {name: tracking.ratio("PI", name) for name in INVERSES}
    same = all(_alike(alone, tracking.tracked[name]) for name in INVERSES)
    margins = (
        f"gain margin {float(alone.margins.gain[0]):.3g}, phase margin {float(alone.margins.phase_deg[0]):.0f}° "
        + ("of all three" if same else "of PI alone, others of the other two")
    )
    return Row(
        measure="tones of 0.1 to 0.8 Hz on the nominal rig: rms error of PI alone over that of PI behind the inverse, "
        "bare and with dynamics, at equal margins",
        demanded=f"at least {LOWER:g} times, margins equal",
        reached=f"{', '.join(f'{name} {factor:.1f} times' for name, factor in factors.items())}; {margins}",
        passed=same and min(factors.values()) >= LOWER,
    )


def _alike(one: Tracked, other: Tracked) -> bool:
    pairs = ((getattr(one.margins, name), getattr(other.margins, name)) for name in ("gain", "phase_deg", "delay"))
    return all(bool(np.allclose(a, b, rtol=EQUAL, atol=0.0)) for a, b in pairs)


def _near(tracking: Tracking) -> Row:
    factors = {name: tracking.ratio(name, f"oracle: {name}") for name in INVERSES}
    return Row(
        measure="the same, rms error over that of the oracle: the same design on the true plant's own static curve and "
        "linear model",
        demanded=f"at most {NEAR:g} times",
        reached=", ".join(f"{name} {factor:.2f} times" for name, factor in factors.items()),
        passed=max(factors.values()) <= NEAR,
    )


def _scheduled(fleet: Sequence[FleetRun]) -> Row:
    unstable = [run.actuator.name for run in fleet if not run.stable]
    ripple = max((run.steps.ripple for run in fleet), default=0.0)
    calm = f"; late after a step at most {100 * ripple:.2g} % of it moves"
    return Row(
        measure="the scheduled design, made on a model of their specification, on the six actuators: steps and tones",
        demanded="no instability: all runs reach their end, and nothing rings late after a step",
        reached=f"{len(fleet) - len(unstable)} of {len(fleet)} stable"
        + (f" (not {', '.join(unstable)})" if unstable else calm),
        passed=bool(fleet) and not unstable,
    )


def _not_passed(base: Designed) -> Row:
    return Row(
        measure="electrode_rc concealed: verdict on the design from the base model",
        demanded="not pass",
        reached=_both(base),
        passed=base.check.verdict is not Verdict.PASS,
    )


def _passed(amended: Designed) -> Row:
    return Row(
        measure="the same: verdict on the design from the model that the diagnosis amended",
        demanded="pass",
        reached=_both(amended),
        passed=amended.check.verdict is Verdict.PASS,
    )


def _both(designed: Designed) -> str:
    """What the check said, and what the true rig did."""
    return f"{designed.check.verdict.value}; on the true rig {designed.truth.verdict.value}: {_true(designed)}"


def _true(designed: Designed) -> str:
    return designed.truth.text.replace(" on the physics plant", "").replace("the physics plant", "it")


def _kept(outcomes: Sequence[Outcome]) -> Row:
    rate = inside(outcomes)
    return Row(
        measure="random rigs and designs with the verdict pass: true steps wholly inside the predicted simultaneous "
        "95 % band",
        demanded=f"at least {100 * KEPT:.0f} %",
        reached=in_words(rate),
        passed=_reaches(rate, KEPT),
    )


def _caught(outcomes: Sequence[Outcome]) -> Row:
    rate = caught(outcomes)
    return Row(
        measure="random rigs and designs that are unstable or break a limit on the true rig: the verdict was not pass",
        demanded=f"at least {100 * CAUGHT:.0f} %",
        reached=in_words(rate),
        passed=_reaches(rate, CAUGHT),
    )


def _reaches(rate: Rate, share: float) -> bool:
    return rate.count > 0 and rate.share >= share
