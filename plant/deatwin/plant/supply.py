"""Voltage source of a film with known limits: largest source and sink current, and resistances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf
from typing import TYPE_CHECKING, Any

import casadi as ca

from deatwin.plant.effects.electrode_loss import rate_of
from deatwin.plant.errors import RigError
from deatwin.plant.rigs.stated import require_number

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder
    from deatwin.plant.film import AnyFilm

Symbol = Any

SHARPNESS = 8
"""Exponent of the corner between resistance and current limit: where both are equal, the current is 8 % below them."""
LEAST_SUNK = 1e-12
"""Current that is assumed for a converter that sinks none, A: a film of 1 nF falls by 1 mV per second, which is below
its own leakage."""


@dataclass(frozen=True, kw_only=True)
class Supply:
    r"""High-voltage source with limited current, and the circuit between it and the film.

    .. math:: \frac{d}{dt}\bigl[(C(q) + C_p)V\bigr] = I(V_a - V) - \frac{V}{R_b}, \qquad
              I(x) = \frac{x}{R}\Bigl(1 + \Bigl|\frac{x}{R\,I_\pm}\Bigr|^8\Bigr)^{-1/8}

    C(q) is the film's capacitance in the shape q, V the film's voltage and :math:`V_a` the voltage of the source
    without load. The source acts through a resistance R. The current that charges the film in the commanded polarity
    stays below :math:`I_+`, and the current that discharges it stays below :math:`I_-`.

    Parameters
    ----------
    current_limit : float, optional
        :math:`I_+`, A; None if it is never reached.
    sink_current : float, optional
        :math:`I_-`, A: 0 for a converter that cannot sink current, so that the film discharges through
        `bleed_resistance` alone. None if it equals `current_limit`.
    series_resistance : float
        R, ohm. The default has no noticeable influence on a film of a few nanofarads.
    bleed_resistance : float, optional
        :math:`R_b` across the film, ohm: a probe, a divider, a bleeder; None if there is none.
    parallel_capacitance : float
        :math:`C_p` across the film, F: cables, a probe, the converter's output filter.

    Raises
    ------
    RigError
        If a value is physically impossible.
    """

    current_limit: float | None = None
    sink_current: float | None = None
    series_resistance: float = 1e5
    bleed_resistance: float | None = None
    parallel_capacitance: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None or field.default is not None:
                from_zero = field.name in ("sink_current", "parallel_capacitance")
                require_number(f"{field.name} of the supply", value, least=0.0 if from_zero else None)

    def voltage(self, wanted: Symbol, film: AnyFilm, build: Builder) -> Symbol:
        """Return the voltage across the film, V.

        Parameters
        ----------
        wanted : casadi.SX
            Voltage that the source would give without a load, V.
        film : AnyFilm
            Film that the source charges.
        build : Builder
            Builder that gets a state and a coordinate.

        Returns
        -------
        casadi.SX
        """
        # Constants, so that films on sources of other sizes share their compiled equations.
        beside = build.constant("parallel_capacitance", self.parallel_capacitance)
        bleeder = build.constant(
            "bleed_conductance", 0.0 if self.bleed_resistance is None else 1 / self.bleed_resistance
        )
        resistance = build.constant("supply_resistance", self.series_resistance)
        left = build.signal("electrode_share", otherwise=1.0)
        whole, reached = film.capacitance / left, film.capacitance + beside
        size = build.at_rest("supplied_capacitance", whole + beside)
        charge = build.state("supplied_charge", scale=1e3)  # divided by the capacitance at rest: V
        voltage = charge * size / reached
        current = build.coordinate("supply_current", scale=1e-6)
        # A part of the electrode that loses contact takes its charge along, so that the voltage does not jump.
        gone = whole * rate_of(left, build.time)
        build.rate(charge, (current - bleeder * voltage + gone * voltage) / size)
        # Into the film, the balance is one of voltage drops, because a search for rest from afar would find the current
        # flat. Out of it, it is one of currents: a converter that sinks none has nearly no current at any drop.
        ahead = wanted - voltage
        into = ahead * wanted > 0
        excess, drop = self._excess(ahead, into, build), resistance * current
        build.balance(ca.if_else(into, ahead - drop * excess, ahead / excess - drop))
        return voltage

    def _excess(self, ahead: Symbol, into: Symbol, build: Builder) -> Symbol:
        """Return the current through the resistance divided by the source's largest, smoothly limited to at least 1."""
        source = inf if self.current_limit is None else self.current_limit
        sink = source if self.sink_current is None else max(self.sink_current, LEAST_SUNK)
        drops = [
            build.constant(name, 1 / (self.series_resistance * i)) for name, i in (("into", source), ("out_of", sink))
        ]
        return (1 + (ahead * ca.if_else(into, *drops)) ** SHARPNESS) ** (1 / SHARPNESS)


def supply_from(described: Mapping[str, Any]) -> Supply:
    """Return the supply from a rig's plain data."""
    try:
        return Supply(**described)
    except TypeError as error:
        raise RigError(f"malformed supply of a rig: {error}") from None
