"""How far each mechanism reaches at the largest size that somebody would still use: measured, not judged."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

VISIBLE = 0.3
"""Structural residual over noise from which on a mechanism counts as visible: the lowest rung of the ladder."""
REACH: Mapping[str, float] = MappingProxyType(
    {
        "exponential_stiffening": 0.17,
        "diluted_permittivity": 0.23,
        "chain_damage": 0.54,
        "trap_conduction": 0.67,
        "crooked_optics": 0.13,
        "ageing_permittivity": 3.6,
        "hard_ceiling": 4.2,
        "power_law_creep": 5.4,
        "twin_modes": 5.4,
        "hardening_spring": 6.6,
        "space_charge": 7.8,
        "rounded_stop": 11,
        "slow_dipoles": 11,
        "warming_sensor": 11,
        "ladder_electrode": 12,
        "logarithmic_relaxation": 13,
        "hard_clip": 14,
        "cracked_electrode": 16,
        "turbulent_drag": 18,
        "stop_operators": 22,
        "rate_limit": 23,
        "ground_shift": 24,
        "bristle_friction": 28,
        "second_order_sensor": 31,
        "thermostat_swing": 32,
        "transport_delay": 46,
        "knocked_sensor": 49,
        "mains_hum": 79,
        "crossover_dead_zone": 9.9,
        "capacitive_crosstalk": 23,
        "one_way_damper": 32,
        "clock_skew": 38,
        "gain_wander": 45,
        "charging_heat": 51,
        "interference_bursts": 55,
    }
)
"""With a noise of 1 % of the motion and the best of three inputs: noise with holds, noise to 1 Hz, noise with a chirp;
both polarities for `ground_shift`, which reaches 0.2 with one. Of full refits to the fine film are the figures of
`exponential_stiffening`, `diluted_permittivity`, `chain_damage`, `ageing_permittivity`, `logarithmic_relaxation`,
`hard_clip` and `cracked_electrode` (noise with holds), `trap_conduction` and `crooked_optics` (noise to 1 Hz); the
others are of a refit to first order on the reduced one, the smaller of that at the largest size and ten times that at
a tenth of it."""

SHOWN_BY: Mapping[str, str] = MappingProxyType({"ground_shift": "both_polarities"})
"""The only commands under which a mechanism reaches so far."""


def reach(mechanism: str) -> float:
    """The largest ratio of structural residual and noise that a mechanism was seen to reach."""
    return REACH.get(mechanism, float("inf"))
