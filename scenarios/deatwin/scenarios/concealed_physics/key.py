"""The key: which catalogue names are right for a concealed mechanism. Written before any case was run.

A mechanism is another form of the same physics as the effect that is named first. Where two effects of the catalogue
are the same physics seen from two sides, both are right, and the reason is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from deatwin.scenarios.concealed_physics.reach import REACH, VISIBLE

KEY: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "power_law_creep": ("creep",),
        "logarithmic_relaxation": ("prestretch_relaxation",),
        "chain_damage": ("mullins",),
        "exponential_stiffening": ("strain_stiffening",),
        "ageing_permittivity": ("permittivity_drift",),
        "diluted_permittivity": ("permittivity_stretch",),
        "slow_dipoles": ("dielectric_absorption",),
        "space_charge": ("charge_injection",),
        "trap_conduction": ("leakage",),
        "ladder_electrode": ("electrode_rc",),
        "cracked_electrode": ("electrode_loss",),
        "hard_clip": ("amplifier_saturation",),
        "rate_limit": ("amplifier_slew",),
        "ground_shift": ("amplifier_offset",),
        "transport_delay": ("delay",),
        "stop_operators": ("hysteresis", "coulomb_friction"),
        "bristle_friction": ("coulomb_friction", "hysteresis"),
        "turbulent_drag": ("quadratic_damping",),
        "rounded_stop": ("end_stop",),
        "hardening_spring": ("cubic_stiffness",),
        "twin_modes": ("resonance",),
        "second_order_sensor": ("sensor_lag",),
        "warming_sensor": ("sensor_drift",),
        "knocked_sensor": ("sensor_jump",),
        "crooked_optics": ("sensor_curvature",),
        "hard_ceiling": ("sensor_saturation",),
        "thermostat_swing": ("thermal_stiffness",),
        "mains_hum": ("periodic_disturbance",),
    }
)
"""Catalogue names by concealed mechanism, the canonical one first."""

REASONS: Mapping[str, str] = MappingProxyType(
    {
        "stop_operators": "stop operators are elastic-plastic elements: with small thresholds they are dry friction, with "
        "wide ones the hysteresis of Bouc and Wen; the catalogue has both limits and nothing between",
        "bristle_friction": "bristles that bend before they slip are Dahl's solid friction, which the catalogue's "
        "hysteresis is, and slip as the catalogue's dry friction does",
    }
)
"""Why a second name is right."""

OUTSIDE: Mapping[str, str] = MappingProxyType(
    {
        "crossover_dead_zone": "a gap in the middle of a static curve: saturations act at its ends, curvatures not sharply",
        "charging_heat": "softening by the square of the voltage's steps, not by voltage, stretch or time",
        "gain_wander": "random: no effect of the catalogue is",
        "interference_bursts": "random bursts: no tone, no step",
        "one_way_damper": "viscous drag in one direction only: the catalogue's damping is even",
        "capacitive_crosstalk": "the reading follows the command's changes; the catalogue's sensor sees the motion only",
        "clock_skew": "a lag that grows with time: the catalogue's delay is constant",
    }
)
"""Mechanisms outside the catalogue, and why none of its effects describes them."""

_SLOW = (
    "charge_injection",
    "creep",
    "dielectric_absorption",
    "permittivity_drift",
    "prestretch_relaxation",
    "sensor_drift",
)
_ONCE = (
    "one level with a small sine: what shifts the zero, changes the gain or lags moves the mean once, and the sine is "
    "too small to show a gain that changes by a few per cent"
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
        "one level: whether the film's modulus swings or the reading, it is one slow tone",
    ),
)
"""Input, names that it cannot tell apart (the truth among them), the mechanism, and why; the cases go round these.

A single slow sine makes no tie of lags, delays or curves that anybody would see: the base plant's own damping, branch
and stiffening take all but hundredths of a micrometre of them."""


def accepted(mechanism: str) -> frozenset[str]:
    """The catalogue names that are right for a mechanism.

    Examples
    --------
    >>> sorted(accepted("bristle_friction"))
    ['coulomb_friction', 'hysteresis']
    """
    return frozenset(KEY.get(mechanism, ()))


def canonical(mechanism: str) -> str | None:
    """The one catalogue name under which a mechanism is counted."""
    names = KEY.get(mechanism)
    return names[0] if names else None


def invisible() -> frozenset[str]:
    """Effects of the catalogue whose mechanism reached no visible ratio at its largest size, where it was measured."""
    return frozenset(KEY[name][0] for name, value in REACH.items() if name in KEY and value < VISIBLE)


def to_dict() -> dict[str, Any]:
    """The whole key as plain data, for a hash of it."""
    return {
        "key": {name: list(names) for name, names in KEY.items()},
        "reasons": dict(REASONS),
        "outside": dict(OUTSIDE),
        "reach": dict(REACH),
        "ties": [[waveform, list(names), mechanism, why] for waveform, names, mechanism, why in TIES],
    }
