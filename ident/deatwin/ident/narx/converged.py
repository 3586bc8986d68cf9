"""The gradient condition at the end of a nonlinear least-squares search."""

from __future__ import annotations

import numpy as np

from deatwin.plant.arrays import Array

_OFFSET = 0.05  # Distance from the linearised minimum, in standard deviations, that counts as none
_EXACT = 1e-9  # Share of the outputs below which errors are rounding and have no gradient
_NULL = 1e-9  # Share of the largest singular value below which a direction moves no output


def converged(slopes: Array, errors: Array, samples: int, size: float) -> bool:
    """Return True if a further Gauss-Newton step is short beside the parameters' deviations.

    The measure is the relative offset of Bates and Watts, Technometrics 23 (1981) 179-183: the root mean square of the
    errors along the tangent plane by that of those across it. `slopes` (n, n_theta) and `errors` (n,) may be the
    triangle of a QR decomposition; `samples` is how many errors there are, and `size` the norm of the outputs.
    """
    norms = np.linalg.norm(slopes, axis=0)
    left, values, _ = np.linalg.svd(slopes / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
    along = left[:, values > _NULL * values[0]].T @ errors
    total, gain, n = float(errors @ errors), float(along @ along), max(along.size, 1)
    return total <= (_EXACT * size) ** 2 or gain * (samples - n) <= _OFFSET**2 * n * (total - gain)
