"""The key: the catalogue names that are right for each concealed mechanism, and the range of its strength.

Written before any case was run. A mechanism is another form of the same physics as the effect that is named first.
Where two effects of the catalogue are the same physics seen from two sides, both are right, and the reason is given.
"""

from __future__ import annotations

from typing import Any

VISIBLE = 0.3
"""Structural residual over noise from which on a mechanism counts as visible: the lowest rung of the ladder."""

_INSIDE: dict[str, tuple[Any, ...]] = {
    "power_law_creep": (5.4, "creep"),
    "logarithmic_relaxation": (13, "prestretch_relaxation"),
    "chain_damage": (0.54, "mullins"),
    "exponential_stiffening": (0.17, "strain_stiffening"),
    "ageing_permittivity": (3.6, "permittivity_drift"),
    "diluted_permittivity": (0.23, "permittivity_stretch"),
    "slow_dipoles": (11, "dielectric_absorption"),
    "space_charge": (7.8, "charge_injection"),
    "trap_conduction": (0.67, "leakage"),
    "ladder_electrode": (12, "electrode_rc"),
    "cracked_electrode": (16, "electrode_loss"),
    "hard_clip": (14, "amplifier_saturation"),
    "rate_limit": (23, "amplifier_slew"),
    "ground_shift": (24, "amplifier_offset"),
    "transport_delay": (46, "delay"),
    "stop_operators": (22, "hysteresis", "coulomb_friction"),
    "bristle_friction": (28, "coulomb_friction", "hysteresis"),
    "turbulent_drag": (18, "quadratic_damping"),
    "rounded_stop": (11, "end_stop"),
    "hardening_spring": (6.6, "cubic_stiffness"),
    "twin_modes": (5.4, "resonance"),
    "second_order_sensor": (31, "sensor_lag"),
    "warming_sensor": (11, "sensor_drift"),
    "knocked_sensor": (49, "sensor_jump"),
    "crooked_optics": (0.13, "sensor_curvature"),
    "hard_ceiling": (4.2, "sensor_saturation"),
    "thermostat_swing": (32, "thermal_stiffness"),
    "mains_hum": (79, "periodic_disturbance"),
}
"""Reach and catalogue names of each mechanism, the canonical name first.

The reach is the largest ratio of structural residual to noise at the largest size that somebody would still use. It
was measured with a noise of 1 % of the motion and the best of three inputs: noise with holds, noise to 1 Hz, noise with
a chirp; both polarities for `ground_shift`, which reaches 0.2 with one. Full refits to the fine film gave the figures
of `exponential_stiffening`, `diluted_permittivity`, `chain_damage`, `ageing_permittivity`, `logarithmic_relaxation`,
`hard_clip` and `cracked_electrode` (noise with holds), `trap_conduction` and `crooked_optics` (noise to 1 Hz). All
others are of a refit to first order on the reduced film: the smaller of the ratio at the largest size and ten times
that at a tenth of it."""
_OUTSIDE: dict[str, tuple[float, str]] = {
    "crossover_dead_zone": (
        9.9,
        "a gap in the middle of a static curve: saturations act at its ends, curvatures not sharply",
    ),
    "charging_heat": (51, "softening by the square of the voltage's steps, which no effect describes"),
    "gain_wander": (45, "random; no effect of the catalogue is random"),
    "interference_bursts": (55, "random bursts: no tone, no step"),
    "one_way_damper": (32, "viscous drag in one direction only: the catalogue's damping is even"),
    "capacitive_crosstalk": (
        23,
        "the reading follows the command's changes; the catalogue's sensor sees the motion only",
    ),
    "clock_skew": (38, "a lag that grows with time: the catalogue's delay is constant"),
}
"""Reach of each mechanism outside the catalogue, and why no effect of the catalogue describes it."""

KEY: dict[str, tuple[str, ...]] = {name: tuple(names) for name, (_, *names) in _INSIDE.items()}
OUTSIDE = {name: why for name, (_, why) in _OUTSIDE.items()}
REACH: dict[str, float] = {name: values[0] for name, values in (_INSIDE | _OUTSIDE).items()}
SHOWN_BY = {"ground_shift": "both_polarities"}  # The only waveform under which a mechanism reaches so far
INVISIBLE = frozenset(names[0] for name, names in KEY.items() if REACH[name] < VISIBLE)
"""Effects of the catalogue whose mechanism reaches no visible ratio."""

REASONS = {
    "stop_operators": "stop operators are elastic-plastic elements: with small thresholds they are dry friction, with "
    "wide ones the hysteresis of Bouc and Wen; the catalogue has both limits and nothing between",
    "bristle_friction": "bristles that bend before they slip are Dahl's solid friction, which the catalogue's "
    "hysteresis is, and slip as the catalogue's dry friction does",
}
"""Why a second name is right."""

_SLOW = (
    "charge_injection",
    "creep",
    "dielectric_absorption",
    "permittivity_drift",
    "prestretch_relaxation",
    "sensor_drift",
)
_ONCE = (
    "one level with a small sine: changes of zero, of gain or by a lag shift the mean once, and the sine is too small "
    "to show a gain that changes by a few per cent"
)
TIES: tuple[tuple[str, tuple[str, ...], str, str], ...] = (
    ("one_level", _SLOW, "warming_sensor", _ONCE),
    ("one_level", _SLOW, "ageing_permittivity", _ONCE),
    ("one_level", _SLOW, "logarithmic_relaxation", _ONCE),
    ("one_level", _SLOW, "slow_dipoles", _ONCE),
    ("one_level", _SLOW, "power_law_creep", _ONCE),
    ("one_level", _SLOW, "space_charge", _ONCE),
    (
        "one_level",
        ("periodic_disturbance", "thermal_stiffness"),
        "thermostat_swing",
        "one level: an oscillating modulus and an oscillating reading both give one slow tone",
    ),
)
"""Input, names that it cannot tell apart (the truth among them), the mechanism, and why; the cases go round these.

A single slow sine makes no tie of lags, delays or curves that anybody would see: the base plant's own damping, branch
and stiffening take all but hundredths of a micrometre of them."""


def key_dict() -> dict[str, Any]:
    """Return the whole key as plain data, which is hashed."""
    return {
        "key": {name: list(names) for name, names in KEY.items()},
        "reasons": dict(REASONS),
        "outside": dict(OUTSIDE),
        "reach": dict(REACH),
        "ties": [[waveform, list(names), mechanism, why] for waveform, names, mechanism, why in TIES],
    }


def _names(*groups: str) -> frozenset[str]:
    return frozenset(name for group in groups for name in group.split())


_MEMORY = "creep dielectric_absorption charge_injection sensor_lag mullins"
_SLOWLY = "sensor_drift sensor_jump prestretch_relaxation permittivity_drift thermal_stiffness periodic_disturbance"
_BEND = "cubic_stiffness strain_stiffening sensor_curvature sensor_saturation end_stop"
_LATE = "delay electrode_rc sensor_lag amplifier_slew resonance"
_RUB = "coulomb_friction hysteresis"
_FIELD = (
    "permittivity_stretch electrode_rc electrode_loss amplifier_offset permittivity_drift delay amplifier_slew "
    "dielectric_absorption"
)
_CLIP = "amplifier_saturation leakage permittivity_stretch strain_stiffening"
TERM_NAMES = {
    "1": _names(_SLOWLY),
    "e": _names(_MEMORY, _SLOWLY),
    "x": _names(_MEMORY, _SLOWLY),
    "v": _names(_LATE),
    "w": _names(_FIELD, _MEMORY),
    "s": _names(_RUB),
    "e^2": _names(_BEND),
    "x^2": _names(_BEND),
    "v^2": _names("quadratic_damping"),
    "w^2": _names(_CLIP),
    "s^2": _names(_RUB),
    "e x": _names(_MEMORY, _BEND),
    "e v": _names(_RUB, _LATE),
    "e w": _names(_MEMORY, _FIELD),
    "e s": _names(_RUB),
    "x v": _names("quadratic_damping hysteresis resonance electrode_rc"),
    "x w": _names(_FIELD, _CLIP),
    "x s": _names(_RUB),
    "v w": _names(_LATE),
    "v s": _names("quadratic_damping", _RUB),
    "w s": _names(_RUB, "amplifier_slew"),
}
"""For each term of the sparse dynamics of a residual, every effect that it may stand for: its best case,
since the term counts as right if any of them is."""
