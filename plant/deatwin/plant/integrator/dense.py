"""C code that solves the linear system of all stages for many right sides at once, row by row in vectors.

CasADi's sparse QR follows lists of indices, number by number; for the few dozen unknowns of a step, elimination of
whole rows costs a tenth of it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

__all__ = ["solved_in_lanes"]

LANES = 8
"""Numbers in a vector; a processor whose vectors are shorter takes two for one."""
MOST = 100
"""Unknowns of all stages up to which whole rows cost less than the lists of a sparse method."""
HEAD = """\
  typedef double lanes __attribute__((vector_size({bytes}), may_alias));
  enum {{ N = {n}, S = {s}, NX = {n_x}, P = {columns}, M = N * S, F = M - N * {kept}, E = {entries}, L = {lanes} }};
  enum {{ B = (M + L - 1) / L, W = B + (P + L - 1) / L, R = B * L }};
  static const double inverse[S][S] = {{{inverse}}};
  static const int row[E] = {{{rows}}}, column[E] = {{{places}}};
  static const lanes zero = {{0}};
  lanes a[M][W];
  double *of[M], weight[M];
  const double *mass = arg[1], h = arg[2][0];
  int i, j, k, e, best;
  for (i = 0; i < M; ++i) {{
    of[i] = (double*) a[i];
    for (j = 0; j < W; ++j) a[i][j] = zero;
    for (j = 0; j < P; ++j) of[i][R + j] = arg[3][j * M + i];
  }}
  for (i = 0; i < S; ++i) {{
    for (j = 0; j < S; ++j) for (k = 0; k < NX; ++k) of[i * N + k][j * N + k] = inverse[i][j] * mass[k];
    for (e = 0; e < E; ++e) of[i * N + row[e]][i * N + column[e]] -= (row[e] < NX ? h : 1.0) * arg[0][i * E + e];
  }}
  for (i = 0; i < M; ++i) {{
    lanes squares = zero;
    double sum = 0.0;
    for (j = 0; j < B; ++j) squares += a[i][j] * a[i][j];
    for (j = 0; j < L; ++j) sum += squares[j];
    weight[i] = 1.0 / sum;
  }}"""
"""The system and its right sides, which begin at column R, in rows; the weights make each row one of length one."""
BLOCK = """\
  for (k = {first}; k < {last}; ++k) {{
    double largest = of[k][k] * of[k][k] * weight[k];
    for (best = k, i = k + 1; i < M; ++i) {{
      const double size = of[i][k] * of[i][k] * weight[i];
      if (size > largest) {{ largest = size; best = i; }}
    }}
    if (best != k) {{
      double *const row_k = of[k], weight_k = weight[k];
      of[k] = of[best]; of[best] = row_k; weight[k] = weight[best]; weight[best] = weight_k;
    }}
    {{
      const lanes *const pivot = (const lanes*) of[k];
      const double share = 1.0 / of[k][k];
      for (i = k + 1; i < M; ++i) if (of[i][k] != 0.0) {{
        lanes *const other = (lanes*) of[i];
        const lanes factor = zero + of[i][k] * share;
{updates}
      }}
    }}
  }}"""
"""Elimination of the columns of one vector: what is left of a row is a fixed number of vectors."""
BACK = """\
  for (k = M - 1; k >= F; --k) {{
    lanes *const found = (lanes*) of[k] + B;
    const lanes share = zero + 1.0 / of[k][k];
    for (i = k + 1; i < M; ++i) for (j = 0; j < W - B; ++j) found[j] -= of[k][i] * ((lanes*) of[i])[B + j];
    for (j = 0; j < W - B; ++j) found[j] *= share;
    for (j = 0; j < P; ++j) res[0][j * (M - F) + k - F] = of[k][R + j];
  }}
  return 0;"""


def solved_in_lanes(
    pattern: ca.Sparsity, inverse: np.ndarray, n_x: int, columns: int, kept: int
) -> str | None:
    """Body of a C function in CasADi's calling convention for `Stages.solution`.

    Elimination by rows with partial pivoting, where each row counts against its own length.

    Parameters
    ----------
    pattern : casadi.Sparsity
        Of the Jacobian of one stage, n by n.
    inverse : ndarray, shape (s, s)
        Inverse of the Butcher matrix.
    n_x : int
        Number of states.
    columns : int
        Number of right sides.
    kept : int
        Number of stages, the last ones, whose unknowns are wanted.

    Returns
    -------
    str or None
        None where there is nothing to solve for, or too much.

    References
    ----------
    Golub & Van Loan, Matrix Computations (2013), section 3.4, ISBN 978-1-4214-0794-4.
    """
    unknowns = pattern.size1() * len(inverse)
    if not columns or not pattern.nnz() or unknowns > MOST:
        return None
    rows, places = pattern.get_triplet()
    vectors = -(-unknowns // LANES) + -(-columns // LANES)
    head = HEAD.format(
        bytes=8 * LANES, lanes=LANES, n=pattern.size1(), s=len(inverse), n_x=n_x, columns=columns, kept=kept,
        entries=pattern.nnz(),
        inverse=", ".join("{" + ", ".join(f"{float(v)!r}" for v in row) + "}" for row in inverse),
        rows=", ".join(map(str, rows)), places=", ".join(map(str, places)),
    )  # fmt: skip
    blocks = [
        BLOCK.format(
            first=first, last=min(first + LANES, unknowns),
            updates="\n".join(f"        other[{j}] -= factor * pivot[{j}];" for j in range(first // LANES, vectors)),
        ) for first in range(0, unknowns, LANES)
    ]  # fmt: skip
    return "\n".join([head, *blocks, BACK.format()])
