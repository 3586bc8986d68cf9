"""H-infinity mixed sensitivity on the sampled model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from deatwin.control.arguments import number, pair, taking
from deatwin.control.controllers.law import Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.design.pid import Limits, with_law
from deatwin.control.design.states import States, integrating
from deatwin.control.errors import ControlError, MissingPackageError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.control.stability.loops import loop_margins
from deatwin.plant.arrays import Array

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction


_LEAK = 1e-4  # Pole of the first weight, as a share of the bandwidth; the theory requires a stable weight
_ROLL_OFF = 2.0  # Frequency from which the bound on the command falls, in bandwidths
_LAST = 100.0  # Frequency up to which that bound falls, in units of the frequency from which it falls
_HALVINGS = 12


@dataclass(frozen=True, kw_only=True)
class MixedSensitivity:
    """Weights on the sensitivity S and on C S; a design keeps the norm of both weighted functions below one."""

    # The bounds are |S| <= |(w + b l)/(w/M + b)| and |C S G(1)| <= effort / |1 + w/(2 b)|, where b is the bandwidth,
    # |w| = tan(omega h / 2), and l = 1e-4 replaces the integrator.

    bandwidth_Hz: float  # Frequency up to which the sensitivity is below one, Hz
    max_sensitivity: float  # Largest sensitivity, M
    effort: float  # Largest command for a reference, divided by the command that holds it at rest
    sample_time: float  # s

    def __post_init__(self) -> None:
        nyquist = 0.5 / self.sample_time
        if not 0.0 < self.bandwidth_Hz < nyquist:
            raise ControlError(
                f"bandwidth_Hz is {self.bandwidth_Hz:g}: it must lie between 0 and half the sampling rate, {nyquist:g}"
            )
        for name in ("max_sensitivity", "effort"):
            if not 1.0 < getattr(self, name) < np.inf:
                raise ControlError(f"{name} is {getattr(self, name):g}: it must be above 1 (1.2 to 2 is usual)")

    def weights(self) -> tuple[TransferFunction, TransferFunction]:
        """Return both weights in the w plane, as continuous systems of python-control."""
        import control

        b = float(np.tan(np.pi * self.bandwidth_Hz * self.sample_time))
        corner = _ROLL_OFF * b
        first = [1.0 / self.max_sensitivity, b], [1.0, b * _LEAK]
        second = [1.0 / (corner * self.effort), 1.0 / self.effort], [1.0 / (corner * _LAST), 1.0]
        return control.tf(*first), control.tf(*second)


@taking(linear=linear_model, command_limits=pair, bandwidth_Hz=number, max_sensitivity=number, effort=number)
def hinf(
    linear: LinearModel,
    *,
    command_limits: Limits,
    bandwidth_Hz: float,
    max_sensitivity: float = 1.5,
    effort: float = 2.0,
) -> LinearController:
    """Design a sampled H-infinity mixed-sensitivity controller with integral action.

    The controller is designed in the w plane. The bilinear transform preserves norms, so the bounds hold for the
    sampled loop as well. For integral action, the slowest pole of the controller, which lies at 1e-4 times the
    bandwidth, is finally moved to z = 1.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`).
    command_limits : (float, float)
        Least and largest command, in its unit.
    bandwidth_Hz : float
        Frequency up to which the sensitivity stays below one, Hz. Choose the bandwidth well inside the band that the
        model's recording excited; the model is not reliable outside this band.
    max_sensitivity : float
        Upper bound on the sensitivity |1/(1 + L)| of the loop L at any frequency.
    effort : float
        Upper bound on the gain from reference to command, divided by the value of this gain at 0 Hz. Above twice the
        bandwidth the bound falls with frequency.

    Returns
    -------
    LinearController
        Controller that acts on the error alone, with the sampling time of the model. Its closed-loop time is the
        inverse of the bandwidth in rad/s.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    MissingPackageError
        If slycot is not installed.
    ControlError
        If a bound is invalid, or if the bounds cannot be met together. In that case the message gives the largest
        bandwidth at which the other bounds can be met.

    References
    ----------
    S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (2nd ed. 2005), sections 2.8.3 and 9.3.6: weights
    and mixed sensitivity. R. Hanus, M. Kinnaert and J.-L. Henrotte, "Conditioning technique, a general anti-windup and
    bumpless transfer method", Automatica 23 (1987) 729-739: states that follow the applied command.
    """
    _require_slycot()
    states, h = States.of(linear), linear.sample_time
    plant = _to_w(states.balanced())
    bounds = MixedSensitivity(bandwidth_Hz=bandwidth_Hz, max_sensitivity=max_sensitivity, effort=effort, sample_time=h)
    found = _synthesis(plant, bounds)
    if found is None:
        raise ControlError(_why_not(plant, bounds))
    law = integrating(_from_w(found)).scaled(1.0 / states.gain)
    if not loop_margins(linear, law).stable[0]:
        raise ControlError("the H-infinity controller lost stability to rounding: choose another bandwidth")
    return with_law("H-infinity", linear, command_limits, 1.0 / (2 * np.pi * bandwidth_Hz), law, _follower(law))


def _require_slycot() -> None:
    if find_spec("slycot") is None:
        raise MissingPackageError('an H-infinity design needs slycot: install it with pip install "slycot>=0.6"')


def _to_w(states: States) -> StateSpace:
    """Transform the model to the w plane, with a static gain of one."""
    import control

    inverse = np.linalg.inv(states.a + np.eye(states.b.size))
    b, c = (inverse @ states.b)[:, None], (states.c @ inverse)[None, :]
    a = inverse @ (states.a - np.eye(states.b.size))
    return control.ss(a, np.sqrt(2.0) * b, np.sqrt(2.0) * c, -states.c @ b)


def _from_w(system: StateSpace) -> Law:
    """Transform a law of the error back from the w plane."""
    a, b, c, d = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
    identity = np.eye(len(a))
    inverse = np.linalg.inv(identity - a)
    through = float((d + c @ inverse @ b)[0, 0])
    return Law.of_error(
        (identity + a) @ inverse, np.sqrt(2.0) * (inverse @ b)[:, 0], np.sqrt(2.0) * (c @ inverse)[0], through
    )


def _synthesis(plant: StateSpace, bounds: MixedSensitivity) -> StateSpace | None:
    """Return a controller, in the w plane, that keeps the weighted norm below one; None if there is none."""
    import control

    p = _weighted(plant, bounds)
    n, inputs, outputs = p.nstates, p.ninputs, p.noutputs
    try:
        # Job 4 solves for this norm. python-control's hinfsyn searches for the least norm, sometimes without end.
        found = import_module("slycot").sb10ad(n, inputs, outputs, 1, 1, 1.0, p.A, p.B, p.C, p.D, job=4)
    except ArithmeticError:  # slycot found no admissible controller
        return None
    return control.ss(*found[1:5])


def _weighted(plant: StateSpace, bounds: MixedSensitivity) -> StateSpace:
    """Return the generalised plant in w, from (reference, command) to (weighted error, weighted command, error)."""
    import control

    first, second = (control.ss(weight) for weight in bounds.weights())
    n, through = plant.nstates, float(np.asarray(plant.D)[0, 0])
    a, b, c, d = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 2)), np.zeros((3, n + 2)), np.zeros((3, 2))
    a[:n, :n], b[:n, 1:] = plant.A, plant.B
    c[2, :n], d[2] = -np.asarray(plant.C)[0], [1.0, -through]
    a[n, n], a[n + 1, n + 1] = first.A[0, 0], second.A[0, 0]
    a[n, :n], b[n], b[n + 1, 1] = first.B[0, 0] * c[2, :n], first.B[0, 0] * d[2], second.B[0, 0]
    c[0, :n], c[0, n], d[0] = first.D[0, 0] * c[2, :n], first.C[0, 0], first.D[0, 0] * d[2]
    c[1, n + 1], d[1, 1] = second.C[0, 0], second.D[0, 0]
    return control.ss(a, b, c, d)


def _why_not(plant: StateSpace, bounds: MixedSensitivity) -> str:
    """Explain up to which bandwidth the other bounds can be met."""
    low, high = 0.0, bounds.bandwidth_Hz
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        reached = _synthesis(plant, replace(bounds, bandwidth_Hz=middle)) is not None
        low, high = (middle, high) if reached else (low, middle)
    up_to = f"with these bounds {low:.3g} Hz can be reached" if low > 0.0 else "no bandwidth can be reached with them"
    return (
        f"a bandwidth of {bounds.bandwidth_Hz:g} Hz with a sensitivity of at most {bounds.max_sensitivity:g} and "
        f"commands of at most {bounds.effort:g} times those at rest cannot be met; {up_to}"
    )


def _follower(law: Law) -> Array:
    """Return the gain by which the law's states follow the applied command, by a Kalman filter."""
    from scipy.linalg import solve_discrete_are

    b, size = law.b[:, 0], float(law.c @ law.b[:, 0])
    p = solve_discrete_are(law.a.T, law.c[:, None], np.outer(b, b), np.array([[law.d[0] ** 2 + size**2]]))
    return np.asarray(law.a @ p @ law.c / (law.d[0] ** 2 + size**2 + law.c @ p @ law.c))
