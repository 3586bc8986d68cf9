/* The run of a nonlinear state space and its sensitivities: march.py does the same and says why.

   static double shape(int number, double x, double p, double q) is written before this file. */
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef int64_t integer;

typedef struct {
    integer n, m, k, p, r;               /* states, inputs, directions, outputs, regressors */
    integer inner, rates, readings;      /* free weights of directions, transition and output */
    const integer *start;                /* [r + 1] first factor of each regressor */
    const integer *factors;              /* [][3] variable, power, number of a function or -1 */
    const double *numbers;               /* [][2] of the function */
    const integer *level;                /* [r] number of the last direction that a regressor holds, or 0 */
    const double *P, *W, *V;             /* [k][r], [n][r], [p][r] */
    const integer *atP, *atW, *atV;      /* places of the free weights */
    double limit;                        /* of an output */
} model;

static double raised(double x, integer power) {
    double value = 1.0;
    for (; power > 0; power--) value *= x;
    return value;
}

/* The regressors of a level at z, and their derivatives d [r][n + m + k], which are zero before. */
static void regressors(const model *o, integer level, const double *z, double *phi, double *d) {
    integer width = o->n + o->m + o->k;
    for (integer j = 0; j < o->r; j++) {
        double product = 1.0;
        if (o->level[j] != level) continue;
        for (integer f = o->start[j]; f < o->start[j + 1]; f++) {
            const integer *is = o->factors + 3 * f;
            const double *with = o->numbers + 2 * f;
            double x = z[is[0]];
            double value = is[2] < 0 ? raised(x, is[1]) : shape((int)is[2], x, with[0], with[1]);
            if (d) {
                double slope = is[2] < 0 ? (double)is[1] * raised(x, is[1] - 1)
                                         : shape_slope((int)is[2], x, with[0], with[1]);
                for (integer g = o->start[j]; g < o->start[j + 1]; g++) {
                    if (g == f) continue;
                    const integer *other = o->factors + 3 * g;
                    const double *by = o->numbers + 2 * g;
                    slope *= other[2] < 0 ? raised(z[other[0]], other[1])
                                          : shape((int)other[2], z[other[0]], by[0], by[1]);
                }
                d[j * width + is[0]] += slope;
            }
            product *= value;
        }
        phi[j] = product;
    }
}

/* Run from the state x [n] over u [N][m]; write y [N][p] and, where J is given, its derivatives J [N][p][all] by the
   weights of directions, transition and output, and by the first state. Return the samples that stay within the limit.
   work: r (1 + width + n) + (n + p) (n + k) + k k + k + width + n + 2 n columns, with width = n + m + k. */
integer deatwin_states(const model *o, integer N, const double *u, double *x, double *y, double *J, double *work) {
    integer n = o->n, m = o->m, k = o->k, r = o->r, p = o->p, width = n + m + k, at = n + m;
    integer moved = o->inner + o->rates, columns = moved + n, all = moved + o->readings + n;
    double *phi = work, *d = phi + r, *g = d + r * width, *M = g + r * n, *by = M + (n + p) * n;
    double *chain = by + (n + p) * k, *direct = chain + k * k, *z = direct + k, *next = z + width, *S = next + n, *T = S + n * columns;
    if (J) {
        memset(S, 0, (size_t)(n * columns) * sizeof(double));
        for (integer a = 0; a < n; a++) S[a * columns + moved + a] = 1.0;
    }
    for (integer t = 0; t < N; t++) {
        memcpy(z, x, (size_t)n * sizeof(double));
        memcpy(z + n, u + t * m, (size_t)m * sizeof(double));
        if (J) memset(d, 0, (size_t)(r * width) * sizeof(double));
        regressors(o, 0, z, phi, J ? d : 0);
        for (integer h = 0; h < k; h++) {
            double sum = 0.0;
            for (integer j = 0; j < r; j++)
                if (o->level[j] <= h) sum += o->P[h * r + j] * phi[j];
            z[at + h] = sum;
            regressors(o, h + 1, z, phi, J ? d : 0);
        }
        for (integer i = 0; i < p; i++) {
            double sum = 0.0;
            for (integer j = 0; j < r; j++) sum += o->V[i * r + j] * phi[j];
            if (!(fabs(sum) < o->limit)) return t;
            y[t * p + i] = sum;
        }
        for (integer i = 0; i < n; i++) {
            double sum = 0.0;
            for (integer j = 0; j < r; j++) sum += o->W[i * r + j] * phi[j];
            next[i] = sum;
        }
        memcpy(x, next, (size_t)n * sizeof(double));
        if (!J) continue;
        /* chain [h][i]: how direction h moves with what is added to direction i; g: total derivatives by the state. */
        for (integer h = 0; h < k; h++)
            for (integer i = 0; i < k; i++) {
                double sum = h == i ? 1.0 : 0.0;
                for (integer between = i; between < h; between++)
                    for (integer j = 0; j < r; j++)
                        if (o->level[j] <= h)
                            sum += o->P[h * r + j] * d[j * width + at + between] * chain[between * k + i];
                chain[h * k + i] = sum;
            }
        for (integer a = 0; a < n; a++) {
            for (integer h = 0; h < k; h++) {
                direct[h] = 0.0;
                for (integer j = 0; j < r; j++)
                    if (o->level[j] <= h) direct[h] += o->P[h * r + j] * d[j * width + a];
            }
            for (integer j = 0; j < r; j++) {
                double sum = d[j * width + a];
                for (integer h = 0; h < k && h < o->level[j]; h++) {
                    double turned = 0.0;
                    for (integer i = 0; i <= h; i++) turned += chain[h * k + i] * direct[i];
                    sum += d[j * width + at + h] * turned;
                }
                g[j * n + a] = sum;
            }
        }
        for (integer i = 0; i < n + p; i++) {
            const double *weights = i < n ? o->W + i * r : o->V + (i - n) * r;
            for (integer a = 0; a < n; a++) {
                double sum = 0.0;
                for (integer j = 0; j < r; j++) sum += weights[j] * g[j * n + a];
                M[i * n + a] = sum;
            }
            for (integer h = 0; h < k; h++) {
                double sum = 0.0;
                for (integer j = 0; j < r; j++) sum += weights[j] * d[j * width + at + h];
                direct[h] = sum;
            }
            for (integer h = 0; h < k; h++) {
                by[i * k + h] = 0.0;
                for (integer later = h; later < k; later++) by[i * k + h] += direct[later] * chain[later * k + h];
            }
        }
        for (integer i = 0; i < n + p; i++) {
            double *to = i < n ? T + i * columns : J + (t * p + i - n) * all, *last = to;
            memset(to, 0, (size_t)(i < n ? columns : all) * sizeof(double));
            for (integer a = 0; a < n; a++) {
                double factor = M[i * n + a];
                const double *from = S + a * columns;
                for (integer c = 0; c < moved; c++) to[c] += factor * from[c];
                last = i < n ? to + moved : to + moved + o->readings;
                for (integer c = 0; c < n; c++) last[c] += factor * from[moved + c];
            }
            for (integer f = 0; f < o->inner; f++) {
                integer h = o->atP[f] / r, j = o->atP[f] % r;
                to[f] += by[i * k + h] * phi[j];
            }
        }
        for (integer f = 0; f < o->rates; f++) T[(o->atW[f] / r) * columns + o->inner + f] += phi[o->atW[f] % r];
        for (integer f = 0; f < o->readings; f++) J[(t * p + o->atV[f] / r) * all + moved + f] += phi[o->atV[f] % r];
        double *swap = S;
        S = T;
        T = swap;
    }
    return N;
}
