/* The Kalman filter with roots of covariances, and its adjoint: kalman_loops.py does the same and says why.

   A covariance is U'U with a root U of n_states rows; inner loops run along rows, so that they are vectorised without
   any sum being reordered. NaN marks a missing measurement. */
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef int64_t integer;

typedef struct {
    integer p, n, m, r;       /* outputs, samples, states, sources of process noise */
    const double *rows;       /* [p][n][m] */
    const double *noise;      /* [p] variances */
    const double *transition; /* [m][m], one for each step where the stride is not 0; or none: the identity */
    integer transition_stride;
    const double *process; /* [r][m] transposed root, likewise */
    integer process_stride;
    const double *added;     /* [n - 1][m] to the state, or none */
    const double *intervals; /* [n - 1] factors on the process covariance, or none */
    double fade;             /* on the root at each step */
} model;

/* Householder reflections of A [height][width] make its first `count` columns upper triangular; w: width of work. */
static void triangularise(integer height, integer width, integer count, double *A, double *w) {
    for (integer j = 0; j < count && j < height; j++) {
        double below = 0.0, head = A[j * width + j];
        for (integer c = j + 1; c < height; c++) below += A[c * width + j] * A[c * width + j];
        if (below < 1e-280) continue; /* of a state that has died away: its squares underflow, its inverse would not */
        double norm = sqrt(head * head + below), diagonal = head > 0.0 ? -norm : norm, first = head - diagonal;
        double factor = 2.0 / (first * first + below);
        for (integer i = j + 1; i < width; i++) w[i] = first * A[j * width + i];
        for (integer c = j + 1; c < height; c++) {
            double v = A[c * width + j];
            for (integer i = j + 1; i < width; i++) w[i] += v * A[c * width + i];
        }
        for (integer i = j + 1; i < width; i++) {
            w[i] *= factor;
            A[j * width + i] -= first * w[i];
        }
        for (integer c = j + 1; c < height; c++) {
            double v = A[c * width + j];
            for (integer i = j + 1; i < width; i++) A[c * width + i] -= v * w[i];
            A[c * width + j] = 0.0;
        }
        A[j * width + j] = diagonal;
    }
}

/* into [height][m] = U [height][m] F', or U where there is no transition; rows of `into` are `width` apart. */
static void moved(const model *s, integer k, integer height, const double *U, double *into, integer width) {
    integer m = s->m;
    const double *F = s->transition ? s->transition + k * s->transition_stride : 0;
    for (integer c = 0; c < height; c++) {
        double *row = into + c * width;
        if (!F) {
            memcpy(row, U + c * m, sizeof(double) * (size_t)m);
            continue;
        }
        for (integer i = 0; i < m; i++) {
            double sum = 0.0;
            for (integer j = 0; j < m; j++) sum += U[c * m + j] * F[i * m + j];
            row[i] = sum;
        }
    }
}

/* into [m] = the state after step k. */
static void ahead_of(const model *s, integer k, const double *x, double *into) {
    moved(s, k, 1, x, into, s->m);
    if (s->added)
        for (integer i = 0; i < s->m; i++) into[i] += s->added[k * s->m + i];
}

/* into [r][m] = the root of the process covariance of step k; rows are `width` apart. */
static void noise_of(const model *s, integer k, double *into, integer width) {
    double size = s->intervals ? sqrt(s->intervals[k]) : 1.0;
    const double *G = s->process + k * s->process_stride;
    for (integer c = 0; c < s->r; c++)
        for (integer i = 0; i < s->m; i++) into[c * width + i] = size * G[c * s->m + i];
}

/* Carry state x and root U over step k; A: (m + r) m, w: m numbers of work. */
static void advance(const model *s, integer k, double *x, double *U, double *A, double *w) {
    integer m = s->m;
    for (integer i = 0; i < m * m; i++) U[i] *= s->fade;
    ahead_of(s, k, x, w);
    memcpy(x, w, sizeof(double) * (size_t)m);
    moved(s, k, m, U, A, m);
    if (s->r) {
        noise_of(s, k, A + m * m, m);
        triangularise(m + s->r, m, m, A, w);
    }
    memcpy(U, A, sizeof(double) * (size_t)(m * m));
}

/* Filter; x and U hold the start. states [n][m], roots [n][m][m] (U' at each sample), innovations and variances [p][n],
   gains [p][n][m]; work: (m + r + 1) m. Returns n, or the sample whose measurement was certain beforehand. */
integer deatwin_filter(const model *s, const double *outputs, double *x, double *U, double *states, double *roots,
                       double *innovations, double *variances, double *gains, double *work) {
    integer m = s->m, n = s->n;
    double *A = work, *w = work + (m + s->r) * m;
    for (integer k = 0; k < n; k++) {
        if (k) advance(s, k - 1, x, U, A, w);
        for (integer i = 0; i < s->p; i++) {
            const double *h = s->rows + (i * n + k) * m;
            double *gain = gains + (i * n + k) * m, value = outputs[i * n + k], variance = s->noise[i], seen = 0.0;
            memset(gain, 0, sizeof(double) * (size_t)m);
            for (integer c = 0; c < m; c++) { /* w = U h, gain = U'U h */
                double sum = 0.0;
                for (integer j = 0; j < m; j++) sum += U[c * m + j] * h[j];
                w[c] = sum;
                variance += sum * sum;
                for (integer j = 0; j < m; j++) gain[j] += sum * U[c * m + j];
            }
            variances[i * n + k] = variance;
            if (isnan(value)) {
                memset(gain, 0, sizeof(double) * (size_t)m);
                continue;
            }
            if (!(variance > 0.0)) return k;
            for (integer j = 0; j < m; j++) seen += h[j] * x[j];
            double innovation = value - seen, shrink = 1.0 / (variance + sqrt(s->noise[i] * variance));
            innovations[i * n + k] = innovation;
            for (integer c = 0; c < m; c++) {
                double factor = shrink * w[c];
                for (integer j = 0; j < m; j++) U[c * m + j] -= factor * gain[j];
            }
            for (integer j = 0; j < m; j++) {
                gain[j] /= variance;
                x[j] += gain[j] * innovation;
            }
        }
        memcpy(states + k * m, x, sizeof(double) * (size_t)m);
        for (integer c = 0; c < m; c++)
            for (integer j = 0; j < m; j++) roots[(k * m + j) * m + c] = U[c * m + j];
    }
    return n;
}

/* The adjoint; vectors [n][m], matrices [n][m][m]; work: (2 m + 3) m. */
void deatwin_adjoint(const model *s, const double *innovations, const double *variances, const double *gains,
                     double *vectors, double *matrices, double *work) {
    integer m = s->m, n = s->n;
    double *x = work, *w = x + m, *N = w + 2 * m, *A = N + m * m;
    memset(x, 0, sizeof(double) * (size_t)m);
    memset(N, 0, sizeof(double) * (size_t)(m * m));
    for (integer k = n - 1; k >= 0; k--) {
        if (k < n - 1 && s->transition) { /* x = F'x, N = F'N F */
            const double *F = s->transition + k * s->transition_stride;
            memset(w, 0, sizeof(double) * (size_t)m);
            memset(A, 0, sizeof(double) * (size_t)(m * m));
            for (integer i = 0; i < m; i++)
                for (integer j = 0; j < m; j++) {
                    w[j] += F[i * m + j] * x[i];
                    for (integer c = 0; c < m; c++) A[i * m + c] += N[i * m + j] * F[j * m + c];
                }
            memcpy(x, w, sizeof(double) * (size_t)m);
            memset(N, 0, sizeof(double) * (size_t)(m * m));
            for (integer i = 0; i < m; i++)
                for (integer j = 0; j < m; j++)
                    for (integer c = 0; c < m; c++) N[j * m + c] += F[i * m + j] * A[i * m + c];
        }
        for (integer i = s->p - 1; i >= 0; i--) {
            double innovation = innovations[i * n + k], variance = variances[i * n + k];
            if (isnan(innovation)) continue;
            const double *h = s->rows + (i * n + k) * m, *gain = gains + (i * n + k) * m;
            double weight = 1.0 / variance, error = innovation / variance;
            memset(w, 0, sizeof(double) * (size_t)m);
            for (integer j = 0; j < m; j++) /* w = N gain */
                for (integer c = 0; c < m; c++) w[c] += gain[j] * N[j * m + c];
            for (integer j = 0; j < m; j++) {
                weight += gain[j] * w[j];
                error -= gain[j] * x[j];
            }
            for (integer j = 0; j < m; j++) {
                x[j] += error * h[j];
                w[j] -= 0.5 * weight * h[j];
            }
            for (integer j = 0; j < m; j++)
                for (integer c = 0; c < m; c++) N[j * m + c] -= w[j] * h[c] + h[j] * w[c];
        }
        memcpy(vectors + k * m, x, sizeof(double) * (size_t)m);
        memcpy(matrices + k * m * m, N, sizeof(double) * (size_t)(m * m));
    }
}

/* The smoother, from the filter's states and roots; smoothed [n][m], covariances [n][m][m], gains [n - 1][m][m] of x(k)
   by x(k + 1); work: (2 m + 2 r + 4) m. The root of the joint law of x(k + 1) and x(k) before both is triangularised:
   (U F', U; G', 0) becomes (R, B; 0, D), so that x(k) given x(k + 1) has the gain (R^-1 B)' and the covariance D'D. */
void deatwin_smoother(const model *s, const double *states, const double *roots, double *smoothed, double *covariances,
                      double *gains, double *work) {
    integer m = s->m, n = s->n, width = 2 * m, height = m + s->r;
    size_t vector = sizeof(double) * (size_t)m, square = vector * (size_t)m;
    double *A = work, *w = A + height * width, *U = w + width, *T = U; /* T is used after U */
    memcpy(smoothed + (n - 1) * m, states + (n - 1) * m, vector);
    for (integer k = n - 1; k >= 0; k--) {
        const double *S = roots + k * m * m, *later = covariances + (k + 1) * m * m;
        double *P = covariances + k * m * m, *x = smoothed + k * m;
        memset(P, 0, square);
        if (k == n - 1) {
            for (integer i = 0; i < m; i++)
                for (integer c = 0; c < m; c++)
                    for (integer j = 0; j < m; j++) P[i * m + c] += S[i * m + j] * S[c * m + j];
            continue;
        }
        for (integer c = 0; c < m; c++)
            for (integer j = 0; j < m; j++) U[c * m + j] = S[j * m + c];
        memset(A, 0, sizeof(double) * (size_t)(height * width));
        moved(s, k, m, U, A, width);
        for (integer c = 0; c < m; c++) memcpy(A + c * width + m, U + c * m, vector);
        if (s->r) noise_of(s, k, A + m * width, width);
        triangularise(height, width, m, A, w);
        for (integer j = m - 1; j >= 0; j--) { /* B becomes R^-1 B, the transposed gain */
            double *row = A + j * width + m, pivot = A[j * width + j];
            for (integer i = j + 1; i < m; i++)
                for (integer c = 0; c < m; c++) row[c] -= A[j * width + i] * A[i * width + m + c];
            for (integer c = 0; c < m; c++) row[c] = pivot == 0.0 ? 0.0 : row[c] / pivot;
        }
        ahead_of(s, k, states + k * m, w);
        memcpy(x, states + k * m, vector);
        for (integer j = 0; j < m; j++) {
            const double *column = A + j * width + m;
            double *t = T + j * m, ahead = smoothed[(k + 1) * m + j] - w[j];
            memset(t, 0, vector);
            for (integer i = 0; i < m; i++)
                for (integer c = 0; c < m; c++) t[c] += later[j * m + i] * A[i * width + m + c];
            for (integer i = 0; i < m; i++) {
                x[i] += ahead * column[i];
                gains[(k * m + i) * m + j] = column[i];
                for (integer c = 0; c < m; c++) P[i * m + c] += column[i] * t[c];
            }
        }
        for (integer e = m; e < height; e++) {
            const double *d = A + e * width + m;
            for (integer i = 0; i < m; i++)
                for (integer c = 0; c < m; c++) P[i * m + c] += d[i] * d[c];
        }
        for (integer i = 0; i < m; i++)
            for (integer c = 0; c < i; c++) P[i * m + c] = P[c * m + i] = 0.5 * (P[i * m + c] + P[c * m + i]);
    }
}
