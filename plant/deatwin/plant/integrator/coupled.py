"""Linear systems of several stages, put together from tables of indices: little code, however large they are."""

from __future__ import annotations

import casadi as ca
import numpy as np


def coupled(pattern: ca.Sparsity, n_x: int, coupling: np.ndarray) -> ca.Function:
    r"""Matrix of k stages that are coupled by the inertia of their states.

    .. math:: c_{ij}\,\mathrm{diag}(M, 0) - \delta_{ij}\,\mathrm{diag}(h, 1)\,J_i

    Shapes: `coupling` (k, k).
    """
    n, nnz, count = pattern.size1(), pattern.nnz(), len(coupling)
    rows, columns = (np.array(places, dtype=int) for places in pattern.get_triplet())
    size, stage = n * count, np.arange(count)[:, None]
    driven = ((stage * n + columns) * size + stage * n + rows).ravel()
    i, j = np.nonzero(coupling)
    state = np.arange(n_x)[:, None]
    inert = ((j * n + state) * size + i * n + state).ravel()

    places = np.unique(np.concatenate([driven, inert]))  # column by column
    # Places without a number look up the zero behind the last number.
    of_jacobian, of_mass, weight = np.full(places.size, nnz * count), np.full(places.size, n_x), np.zeros(places.size)
    of_jacobian[np.searchsorted(places, driven)] = np.arange(nnz * count)
    of_mass[np.searchsorted(places, inert)] = np.repeat(state, i.size)
    weight[np.searchsorted(places, inert)] = np.tile(coupling[i, j], n_x)

    entries, mass, h = ca.MX.sym("J", nnz, count), ca.MX.sym("mass", n_x), ca.MX.sym("h")
    moving = np.tile(rows < n_x, count)
    drive = ca.vec(entries) * (ca.DM(moving) * h + ca.DM(~moving))
    numbers = ca.DM(weight) * _looked_up(mass, of_mass) - _looked_up(drive, of_jacobian)
    matrix = ca.MX(ca.Sparsity.triplet(size, size, (places % size).tolist(), (places // size).tolist()), numbers)
    return ca.Function("coupled", [entries, mass, h], [matrix])


def _looked_up(numbers: ca.MX, places: np.ndarray) -> ca.MX:
    """Look up entries of a column with a zero appended."""
    return ca.reshape(ca.vertcat(numbers, 0).nz[places.tolist()], places.size, 1)
