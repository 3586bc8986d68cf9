"""A linear sampled control law of reference and reading, as a state space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import number, numbers, of_plain_data, positive, require_fields, taking
from deatwin.control.errors import ControlError
from deatwin.ident.arguments import keep_read_only
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Rebuilt

if TYPE_CHECKING:
    from control import StateSpace


Polynomials = tuple[Array, Array]  # Numerator and denominator, coefficients of z^0, z^-1, ..

REFERENCE, READING = 0, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Law(Rebuilt):
    """Linear control law ``x(k+1) = A x(k) + B w(k)``, ``u(k) = C x(k) + D w(k)`` with w = (reference, reading).

    x is the state of the controller and u its command.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        State matrix A.
    b : ndarray, shape (n, 2)
        Input matrix B, per unit of the reading.
    c : ndarray, shape (n,)
        Output vector C, in the command's unit.
    d : ndarray, shape (2,)
        Direct term D, in the command's unit per unit of the reading.

    Raises
    ------
    ControlError
        If the shapes do not match or a value is not finite.
    """

    a: Array
    b: Array
    c: Array
    d: Array

    def __post_init__(self) -> None:
        require_fields(self, a=numbers, b=numbers, c=numbers, d=numbers)
        keep_read_only(self, "a", "b", "c", "d")
        n = self.c.size
        shapes = {"a": (n, n), "b": (n, 2), "c": (n,), "d": (2,)}
        for name, shape in shapes.items():
            values = getattr(self, name)
            if values.shape != shape:
                raise ControlError(f"{name} of a control law has the shape {values.shape}: it must be {shape}")
            if not np.all(np.isfinite(values)):
                raise ControlError(f"{name} of a control law must be finite")

    @classmethod
    @taking(b=numbers, d=number)
    def of_error(cls, a: ArrayLike, b: ArrayLike, c: ArrayLike, d: float) -> Self:
        """Make a law that uses only the error, reference minus reading.

        Parameters
        ----------
        a : array_like, shape (n, n)
            State matrix A.
        b : array_like, shape (n,)
            Input vector from the error, per unit of the reading.
        c : array_like, shape (n,)
            Output vector C, in the command's unit.
        d : float
            Direct term from the error, in the command's unit per unit of the reading.
        """
        both = np.array([1.0, -1.0])
        return cls(a=np.asarray(a), b=np.multiply.outer(b, both), c=np.asarray(c), d=d * both)

    def scaled(self, factor: float) -> Law:
        """Return the law with its command multiplied by `factor`; the factor may have a unit."""
        return Law(a=self.a, b=self.b, c=factor * self.c, d=factor * self.d)

    def with_feedback(self, factor: float) -> Law:
        """Return the law with its gain on the error multiplied by `factor`; its feedforward does not change."""
        b, d = np.array(self.b), np.array(self.d)
        for column in (b.T, d):
            column[REFERENCE] += (1.0 - factor) * column[READING]
            column[READING] *= factor
        return Law(a=self.a, b=b, c=self.c, d=d)

    def feedforward(self, gain: float) -> Law:
        """Return the law with `gain` times the reference added to its command; the gain has the unit of `d`."""
        return Law(a=self.a, b=self.b, c=self.c, d=self.d + np.array([gain, 0.0]))

    @property
    def feedback(self) -> Polynomials:
        """Transfer function from minus the reading to the command: numerator and denominator in powers of z^-1."""
        return self._transfer(-self.b[:, READING], -self.d[READING])

    @taking(omega=numbers, sample_time=positive)
    def feedback_response(self, omega: ArrayLike, sample_time: float) -> NDArray[np.complex128]:
        """Return the frequency response (n,) of `feedback` at `omega` (n,), rad/s; `sample_time` in s."""
        numerator, denominator = self.feedback
        shift = np.exp(-1j * np.asarray(omega, dtype=np.float64) * sample_time)
        values = np.polyval(numerator[::-1], shift) / np.polyval(denominator[::-1], shift)
        return np.asarray(values, dtype=np.complex128)

    @taking(sample_time=positive)
    def lost_digits(self, sample_time: float) -> float:
        """Return the largest relative rounding error of `feedback`, compared with the state equations.

        Rounding affects the polynomials of `feedback` if their roots lie close together.

        Parameters
        ----------
        sample_time : float
            Sampling time, s.

        Returns
        -------
        float
            Largest relative difference at frequencies from 0.0001 to 1 times half the sampling rate.
        """
        angles = np.geomspace(1e-4, 1.0, 25) * np.pi
        z = np.exp(1j * angles)[:, None, None]
        moved = np.broadcast_to(-self.b[:, READING, None], (angles.size, self.c.size, 1))
        states = np.linalg.solve(z * np.eye(self.c.size) - self.a, moved)
        exact = states[:, :, 0] @ self.c - self.d[READING]
        written = self.feedback_response(angles / sample_time, sample_time)
        return float(np.max(np.abs(written - exact) / np.abs(exact)))

    @property
    def prefilter(self) -> Polynomials:
        """Transfer function from the reference to the command: numerator and denominator in powers of z^-1."""
        return self._transfer(self.b[:, REFERENCE], self.d[REFERENCE])

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A, in the z plane."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)

    @taking(sample_time=positive)
    def to_control(self, sample_time: float) -> StateSpace:
        """Return the law as a system of python-control, from reference and reading to command; `sample_time` in s."""
        import control

        return control.ss(
            self.a,
            self.b,
            self.c[None, :],
            self.d[None, :],
            sample_time,
            inputs=["reference", "reading"],
            outputs=["command"],
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `from_dict` rebuilds the law."""
        return {name: getattr(self, name).tolist() for name in ("a", "b", "c", "d")}

    @classmethod
    @of_plain_data(ControlError)
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild a law from the `data` that `to_dict` returned."""
        n = len(data["c"])
        return cls(
            a=np.reshape(data["a"], (n, n)),
            b=np.reshape(data["b"], (n, 2)),
            c=np.array(data["c"], dtype=float),
            d=np.array(data["d"], dtype=float),
        )

    def _transfer(self, b: Array, d: float) -> Polynomials:
        """Return ``C (z - A)^-1 b + d``, computed from the determinant of a matrix with a rank-one change."""
        denominator = _characteristic(self.a)
        # The change is scaled to the size of A, whatever the units, so that no digits cancel in the difference.
        size = float(np.linalg.norm(b) * np.linalg.norm(self.c)) or 1.0
        changed = _characteristic(self.a - np.outer(b, self.c) / size)
        return size * (changed - denominator) + d * denominator, denominator


def _characteristic(matrix: Array) -> Array:
    """Return the coefficients of ``det(z - A)``, highest power first."""
    return np.atleast_1d(np.real(np.poly(matrix))) if matrix.size else np.ones(1)
