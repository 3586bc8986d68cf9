"""Voltage source of a film with known limits: largest source and sink current, and resistances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf
from typing import Any

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.effects.electrode_loss import rate_of
from deatwin.plant.errors import RigError
from deatwin.plant.film import AnyFilm
from deatwin.plant.rigs.stated import require_number

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

    C(q) is the capacitance of the film, which depends on the film's shape q, and V is the voltage across the film.
    :math:`V_a` is the voltage of the source without load. I is the current that the source supplies through the
    resistance R. While this current charges the film in the polarity of :math:`V_a`, it is limited to :math:`I_+`;
    while it discharges the film, it is limited to :math:`I_-`.

    Parameters
    ----------
    current_limit : float, optional
        :math:`I_+`, the largest charging current, A; None for no limit.
    sink_current : float, optional
        :math:`I_-`, the largest discharging current, A; None for the value of `current_limit`. It is 0 for a converter
        that cannot sink current: the film then discharges only through `bleed_resistance`.
    series_resistance : float
        R, the resistance in series with the source, ohm. The default has no noticeable influence on a film of a few
        nanofarads.
    bleed_resistance : float, optional
        :math:`R_b`, the resistance in parallel with the film, such as a probe or a voltage divider, ohm; None for no
        such resistance.
    parallel_capacitance : float
        :math:`C_p`, the capacitance in parallel with the film, such as that of cables, F.

    Raises
    ------
    RigError
        If a given value is not a number above 0; `sink_current` and `parallel_capacitance` may also be 0.
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
        """Return the voltage across the film, and add the equations of the circuit to a builder.

        Parameters
        ----------
        wanted : casadi.SX
            :math:`V_a`, the voltage of the source without load, V.
        film : AnyFilm
            Film that the source charges.
        build : Builder
            Builder to which the equations are added.

        Returns
        -------
        casadi.SX
            V, the voltage across the film, V.
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
