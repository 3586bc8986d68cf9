"""A NARX model as a state space, whose states are the past outputs and inputs that its terms contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import instance, numbers, taking
from deatwin.ident.frequency import equilibrium
from deatwin.ident.narx import NarxModel, Variable
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, SimulationError

if TYPE_CHECKING:
    from control import NonlinearIOSystem


Params = Mapping[str, Any]
Lagged = tuple[str, int, int]  # Kind "y" or "u", row of the channel, lag in samples


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxSystem:
    """A NARX model in states: ``x(k+1) = (past of x(k), u(k), y(k))``, ``y(k) = sum_m theta_m term_m(x(k), u(k))``."""

    model: NarxModel  # Model without noise terms

    @cached_property
    def states(self) -> tuple[Lagged, ...]:
        """Signal and lag of each state: all lags from 1 to the largest of each channel, outputs first."""
        depth: dict[tuple[str, int], int] = {}
        for v in self.model.table.variables:
            depth[v.kind, v.index] = max(depth.get((v.kind, v.index), 0), v.reach)
        channels = sorted(depth, key=lambda channel: ("yu".index(channel[0]), channel[1]))
        return tuple((kind, row, lag) for kind, row in channels for lag in range(1, depth[kind, row] + 1))

    @property
    def labels(self) -> list[str]:
        """Names of the states."""
        names = {"y": self.model.output_names, "u": self.model.input_names}
        return [f"{names[kind][row]}(k-{lag})" for kind, row, lag in self.states]

    @cached_property
    def _places(self) -> dict[Lagged, int]:
        """Return the position of each lagged signal in (x, u, y)."""
        counts = {"u": len(self.model.input_names), "y": self.model.n_outputs}
        present = [(kind, row, 0) for kind, count in counts.items() for row in range(count)]
        return {lagged: place for place, lagged in enumerate([*self.states, *present])}

    @cached_property
    def _shift(self) -> NDArray[np.intp]:
        """Return the position of each next state in (x, u, y)."""
        return np.array([self._places[kind, row, lag - 1] for kind, row, lag in self.states], dtype=np.intp)

    @cached_property
    def _weights(self) -> Array:
        """Return the parameters by output and term."""
        weights = np.zeros((self.model.n_outputs, self.model.theta.size))
        weights[list(self.model.equations), np.arange(self.model.theta.size)] = self.model.theta
        return weights

    def _values(self, known: Array) -> Array:
        """Return the value of each variable of the terms. Shapes: `known` (n_states + n_inputs,)."""
        origins = {"u": self.model.input_origin, "y": self.model.output_origin}

        def lagged(v: Variable, lag: int) -> Array:
            return np.asarray(known[self._places[v.kind, v.index, lag]] - origins[v.kind][v.index])

        return np.array(self.model.table.of_signals(lagged))

    @cached_property
    def _limit(self) -> float:
        return self.model.divergence_limit(self.model.output_origin[:, None])

    def output(self, t: float, x: Array, u: Array, params: Params) -> Array:
        """Outputs of a sample. Shapes: `x` (n_states,); `u` (n_inputs,); returns (n_outputs,)."""
        # For a system without memory, python-control may pass one state and a bare number.
        known = np.concatenate([x[: len(self.states)], np.ravel(u)])
        if not np.isfinite(known).all():
            raise SimulationError(f"at {t:g} s an input or state of the model is not a finite number: {known.tolist()}")
        with np.errstate(over="ignore", invalid="ignore"):
            moved = self._weights @ self.model.table.at(self._values(known))
        if not np.all(np.abs(moved) < self._limit):
            raise SimulationError(
                f"the model diverges at {t:g} s (beyond {self._limit:.3g}): stay within its operating range, start "
                "from a state near it, or choose another structure"
            )
        return np.asarray(moved + self.model.output_origin, dtype=np.float64)

    def update(self, t: float, x: Array, u: Array, params: Params) -> Array:
        """The next state. Shapes: returns (n_states,)."""
        return np.concatenate([x, np.ravel(u), self.output(t, x, u, params)])[self._shift]

    def to_control(self, name: str | None) -> NonlinearIOSystem:
        """The discrete system of python-control."""
        import control

        return control.nlsys(
            self.update,
            self.output,
            name=name,
            dt=self.model.sample_time,
            inputs=list(self.model.input_names),
            outputs=list(self.model.output_names),
            states=self.labels,
        )

    def past(self, inputs: Array, outputs: Array) -> Array:
        """Return the state after some rows. Shapes: `inputs, outputs` (n_inputs, n); returns (n_states,)."""
        signals = {"y": outputs, "u": inputs}
        return np.array([signals[kind][row, -lag] for kind, row, lag in self.states])

    def rest(self, operating_input: ArrayLike) -> Array:
        """The state of rest under constant inputs. Shapes: `operating_input` (); returns (n_states,)."""
        found, rows = equilibrium(self.model, operating_input), max(self.model.table.max_lag, 1)
        return self.past(np.tile(found.operating_input[:, None], rows), np.full((1, rows), found.output))


@taking(model=instance(NarxModel), inputs=numbers, outputs=numbers)
def past_state(model: NarxModel, inputs: ArrayLike, outputs: ArrayLike) -> Array:
    """Return the state that the system `to_nlsys(model)` has after the given samples of a recording.

    Parameters
    ----------
    model : NarxModel
        Identified model; its noise terms, if any, are ignored.
    inputs : array_like, shape (n_inputs, n), or (n,) for one input
        Recorded inputs, in their units; n is at least the model's largest lag.
    outputs : array_like, shape (n_outputs, n), or (n,) for one output
        Recorded outputs of the same n samples, in their units.

    Returns
    -------
    ndarray, shape (n_states,)
        State in the order of the system's states. Each element has the unit of its signal.

    Raises
    ------
    ModelError
        If there are too few samples, a sample that the state needs is not finite, or the number of signals differs from
        that of the model.
    """
    system = NarxSystem(model=model.deterministic)
    given = [np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (inputs, outputs)]
    least = system.model.table.max_lag
    wanted = ((len(model.input_names), given[0].shape[-1]), (model.n_outputs, given[0].shape[-1]))
    if tuple(values.shape for values in given) != wanted or wanted[0][1] < least:
        raise ModelError(
            f"inputs of shape {given[0].shape} and outputs of shape {given[1].shape}: the model has {wanted[0][0]} "
            f"inputs and {wanted[1][0]} outputs, and needs at least {least} samples of each"
        )
    state = system.past(*given)
    if not np.isfinite(state).all():
        raise ModelError(f"the last {least} samples of the inputs and outputs must be finite")
    return state
