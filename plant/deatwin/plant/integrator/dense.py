"""C code that solves the linear system of all stages for many right sides at once, row by row in vectors.

Without the coordinates z of each stage, which are eliminated first, the system is
(A^-1_ij M - delta_ij h (J_xx - J_xz J_zz^-1 J_zx)_i) x_j = r_x - h (J_xz J_zz^-1)_i r_z.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from deatwin.plant.integrator.lanes import LANES

MOST = 160  # Number of states of all stages up to which whole rows cost at most a quarter of a sparse method
GIVEN = 1e-16
"""Square of the least product of the pivots' shares in their rows for which a stage's coordinates are solved. The
remaining entries grow by the inverse of each share; a smaller product would cost more than half of the digits."""
HEAD = """\
  typedef double lanes __attribute__((vector_size({bytes}), may_alias));
  enum {{ N = {n}, NX = {n_x}, NZ = N - NX, S = {s}, P = {columns}, E = {entries}, L = {lanes}, M = NX * S }};
  enum {{ F = S - {kept}, V = (NX + P + L - 1) / L, B = (M + L - 1) / L, W = B + (P + L - 1) / L, R = B * L }};
  static const double inverse[S][S] = {{{inverse}}};
  static const int row[E] = {{{rows}}}, column[E] = {{{places}}};
  static const double square[N] = {{{squares}}};
  static const lanes zero = {{0}};
  static const double given = {given!r};
  lanes local[S][N][V], a[M][W];
  double z[N][NZ + 1], *of[M], weight[M];
  const double *mass = arg[1], h = arg[2][0];
  int i, j, k, e, s, best;
  for (i = 0; i < M; ++i) {{
    of[i] = (double*) a[i];
    for (j = 0; j < W; ++j) a[i][j] = zero;
  }}"""
STAGE = """\
  for (s = 0; s < S; ++s) {
    double (*const x)[V * L] = (double (*)[V * L]) local[s];
    double shares = 1.0;
    for (i = 0; i < N; ++i) {
      for (j = 0; j < V; ++j) local[s][i][j] = zero;
      for (j = 0; j <= NZ; ++j) z[i][j] = 0.0;
      for (j = 0; j < P; ++j) x[i][NX + j] = arg[3][j * N * S + s * N + i];
    }
    for (e = 0; e < E; ++e) {
      const double value = -(row[e] < NX ? h : 1.0) * arg[0][s * E + e];
      if (column[e] < NX) x[row[e]][column[e]] = value; else z[row[e]][column[e] - NX] = value;
      z[row[e]][NZ] += value * value * square[column[e]];
    }
    for (k = 0; k < NZ; ++k) {
      double *const own = z[NX + k], largest = 0.0, share;
      for (best = NX + k, i = best; i < N; ++i) {
        const double size = z[i][k] * z[i][k] * square[NX + k] / z[i][NZ];
        if (size > largest) { largest = size; best = i; }
      }
      shares *= largest;
      if (!(shares > given)) return 1;
      share = 1.0 / z[best][k];
      for (j = 0; j <= NZ; ++j) { const double other = z[best][j]; z[best][j] = own[j]; own[j] = other; }
      for (j = 0; j < V; ++j) {
        const lanes other = local[s][best][j];
        local[s][best][j] = local[s][NX + k][j];
        local[s][NX + k][j] = other * share;
      }
      for (j = k; j < NZ; ++j) own[j] *= share;
      for (i = 0; i < N; ++i) if (i != NX + k) {
        const double factor = z[i][k];
        for (j = k; j < NZ; ++j) z[i][j] -= factor * own[j];
        for (j = 0; j < V; ++j) local[s][i][j] -= factor * local[s][NX + k][j];
      }
    }
    for (i = 0; i < NX; ++i) {
      double *const whole = of[s * NX + i];
      for (j = 0; j < S; ++j) whole[j * NX + i] = inverse[s][j] * mass[i];
      for (j = 0; j < NX; ++j) whole[s * NX + j] += x[i][j];
      for (j = 0; j < P; ++j) whole[R + j] = x[i][NX + j];
    }
  }
  for (i = 0; i < M; ++i) {
    lanes squares = zero;
    double sum = 0.0;
    for (j = 0; j < B; ++j) squares += a[i][j] * a[i][j];
    for (j = 0; j < L; ++j) sum += squares[j];
    weight[i] = 1.0 / sum;
  }"""
"""Equations of each stage, solved for its coordinates. The first rows of `z` belong to the states. Each row ends with
the sum of squares of its entries times the unknowns' scales, so that pivots are compared independently of units. The
remaining equations of the states become rows, with the right sides from column R on; the weights normalise each row."""
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
"""Elimination of the columns of one vector. The rest of each row is a fixed number of vectors."""
BACK = """\
  for (k = M - 1; k >= F * NX; --k) {
    lanes *const found = (lanes*) of[k] + B;
    const lanes share = zero + 1.0 / of[k][k];
    for (i = k + 1; i < M; ++i) for (j = 0; j < W - B; ++j) found[j] -= of[k][i] * ((lanes*) of[i])[B + j];
    for (j = 0; j < W - B; ++j) found[j] *= share;
  }
  for (s = F; s < S; ++s) for (j = 0; j < P; ++j) {
    double *const stage = res[0] + (j * (S - F) + s - F) * N;
    for (k = 0; k < NX; ++k) stage[k] = of[s * NX + k][R + j];
    for (i = NX; i < N; ++i) {
      const double *const x = (const double*) local[s][i];
      stage[i] = x[NX + j];
      for (k = 0; k < NX; ++k) stage[i] -= x[k] * stage[k];
    }
  }
  return 0;"""


def solved_in_lanes(
    pattern: ca.Sparsity, inverse: np.ndarray, n_x: int, columns: int, kept: int, scale: np.ndarray
) -> str | None:
    """Body of a C function for `Stages.solution` (Golub & Van Loan 2013, 3.4); `inverse` (s, s), `scale` (n,)."""
    n, count = pattern.size1(), len(inverse)
    coordinates = list(range(n_x, n))
    within = pattern.sub(coordinates, coordinates)[0]
    if not (columns and n_x) or n_x * count > MOST or ca.sprank(within) < n - n_x:
        return None
    rows, places = pattern.get_triplet()
    vectors = -(-n_x * count // LANES) + -(-columns // LANES)
    head = HEAD.format(
        bytes=8 * LANES,
        lanes=LANES,
        n=n,
        s=count,
        n_x=n_x,
        columns=columns,
        kept=kept,
        entries=pattern.nnz(),
        given=GIVEN,
        squares=", ".join(f"{float(v)!r}" for v in scale**2),
        inverse=", ".join("{" + ", ".join(f"{float(v)!r}" for v in row) + "}" for row in inverse),
        rows=", ".join(map(str, rows)),
        places=", ".join(map(str, places)),
    )
    blocks = [
        BLOCK.format(
            first=first,
            last=min(first + LANES, n_x * count),
            updates="\n".join(f"        other[{j}] -= factor * pivot[{j}];" for j in range(first // LANES, vectors)),
        )
        for first in range(0, n_x * count, LANES)
    ]
    return "\n".join([head, STAGE, *blocks, BACK])
