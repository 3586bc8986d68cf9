/* The march of a Rosenbrock method; see rosenbrock.py, which writes the constants and functions above this.

   N unknowns, NX of them states, ND held quantities, NU inputs, NNZ entries of the derivative by the unknowns.
   VALUE, SLOPES and OUTPUT are the plant's functions, *_W and *_IW their working memory.
   Elimination runs in the order ORDER without pivoting, over the entries that LOWER and UPPER list. */

#include <math.h>
#include <string.h>

typedef struct {
    const double *held, *parameters, *constants, *mass, *scale, *rows;
    double tolerance, shortest, safety, shrink, grow, consistent;
} plant_t;

static double w[N], stage[6][N], value[N], slope[N], jacobian[NNZ], matrix[N][N], inputs[NU], real[N], trial[N];
static double work[WORK_W];
static long long int_work[WORK_IW];
static double now, step;

static void evaluate(const plant_t *q, const double *at, double time, double *result)
{
    const double *arg[ARGUMENTS] = {real, q->held, inputs, &time, q->parameters, q->constants};
    double *res[RESULTS] = {result};
    for (int i = 0; i < N; i++) real[i] = at[i] * q->scale[i];
    VALUE(arg, res, int_work, work, 0);
    for (int i = 0; i < N; i++) result[i] *= q->rows[i];
}

static void linearise(const plant_t *q)
{
    const double *arg[ARGUMENTS] = {real, q->held, inputs, &now, q->parameters, q->constants};
    double *res[RESULTS] = {value, jacobian, slope};
    for (int i = 0; i < N; i++) real[i] = w[i] * q->scale[i];
    SLOPES(arg, res, int_work, work, 0);
    for (int i = 0; i < N; i++) { value[i] *= q->rows[i]; slope[i] *= q->rows[i]; }
    for (int k = 0; k < NNZ; k++) jacobian[k] *= q->rows[ROW[k]] * q->scale[COLUMN[k]];
}

static double output(const plant_t *q)
{
    double result;
    const double *arg[ARGUMENTS] = {real, q->held, inputs, &now, q->parameters, q->constants};
    double *res[RESULTS] = {&result};
    for (int i = 0; i < N; i++) real[i] = w[i] * q->scale[i];
    OUTPUT(arg, res, int_work, work, 0);
    return result;
}

/* Factorise M/(gamma h) - F_w; return 0 if a pivot vanishes. */
static int factor(const plant_t *q, double h)
{
    memset(matrix, 0, sizeof matrix);
    for (int k = 0; k < NNZ; k++) matrix[PLACE[ROW[k]]][PLACE[COLUMN[k]]] = -jacobian[k];
    for (int i = 0; i < N; i++) matrix[PLACE[i]][PLACE[i]] += q->mass[i] / (GAMMA * h);
    for (int k = 0; k < N; k++) {
        double pivot = matrix[k][k];
        if (!(fabs(pivot) > 1e-200)) return 0;
        for (int a = LOWER_AT[k]; a < LOWER_AT[k + 1]; a++) {
            double *row = matrix[LOWER[a]], share = row[k] / pivot;
            row[k] = share;
            for (int b = UPPER_AT[k]; b < UPPER_AT[k + 1]; b++) row[UPPER[b]] -= share * matrix[k][UPPER[b]];
        }
    }
    return 1;
}

static void solve(const double *right, double *x)
{
    double y[N];
    for (int i = 0; i < N; i++) y[PLACE[i]] = right[i];
    for (int k = 0; k < N; k++)
        for (int a = LOWER_AT[k]; a < LOWER_AT[k + 1]; a++) y[LOWER[a]] -= matrix[LOWER[a]][k] * y[k];
    for (int k = N - 1; k >= 0; k--) {
        for (int b = UPPER_AT[k]; b < UPPER_AT[k + 1]; b++) y[k] -= matrix[k][UPPER[b]] * y[UPPER[b]];
        y[k] /= matrix[k][k];
    }
    for (int i = 0; i < N; i++) x[i] = y[PLACE[i]];
}

/* Make the coordinates consistent by the simplified Newton method, with a step so short that no state moves. Return 0
   if one would jump far, because it has then found another equilibrium, beyond pull-in. */
static int make_consistent(const plant_t *q)
{
    double change[N], before[N];
    if (N == NX) return 1;
    memcpy(before, w, sizeof before);
    linearise(q);
    if (!factor(q, 1e-15)) return 0;
    for (int number = 0; number < 15; number++) {
        double size = 0.0;
        if (number) evaluate(q, w, now, value);
        solve(value, change);
        for (int i = NX; i < N; i++) {
            w[i] += change[i];
            size = fmax(size, fabs(change[i]));
            if (!(fabs(w[i] - before[i]) < FURTHEST)) return 0;
        }
        if (size < q->consistent) return 1;
    }
    return 0;
}

/* Compute the six stages; return the error of the step in units of the tolerance. */
static double staged(const plant_t *q, double h)
{
    double right[N], here[N], sum = 0.0;
    for (int i = 0; i < 6; i++) {
        if (i) {
            for (int k = 0; k < N; k++) {
                trial[k] = w[k];
                for (int j = 0; j < i; j++) trial[k] += MIX[i][j] * stage[j][k];
            }
            evaluate(q, trial, now + AT[i] * h, here);
            for (int k = 0; k < N; k++) {
                double passed = 0.0;
                for (int j = 0; j < i; j++) passed += PASSED[i][j] * stage[j][k];
                right[k] = here[k] + q->mass[k] * passed / h;
            }
        } else
            memcpy(right, value, sizeof right);
        for (int k = 0; k < N; k++) right[k] += SLOPES_AT[i] * h * slope[k];
        solve(right, stage[i]);
    }
    for (int k = 0; k < NX; k++) sum += stage[5][k] * stage[5][k];
    return sqrt(sum / NX) / q->tolerance;
}

static int advance(const plant_t *q, double until, long long *steps)
{
    while (until - now > q->shortest / 2) {
        double left = until - now, count = ceil(left / step - 1e-9), h = count < 3 ? left / count : step;
        linearise(q);
        for (;;) {
            double error, factor_of_step, wished;
            ++*steps;
            error = factor(q, h) ? staged(q, h) : INFINITY;
            factor_of_step = error > 0 ? q->safety * pow(error, -0.25) : q->grow;
            wished = isfinite(error) ? h * fmin(fmax(factor_of_step, q->shrink), q->grow) : q->shrink * h;
            if (error <= 1.0) {
                for (int k = 0; k < N; k++) {
                    for (int j = 0; j < 5; j++) w[k] += MIX[5][j] * stage[j][k];
                    w[k] += stage[5][k];
                }
                now += h;
                /* A step that was cut short to end at an event must not shorten the next one. */
                step = h < step ? fmax(wished, step) : wished;
                break;
            }
            if (wished < q->shortest) return 0;
            h = step = wished;
        }
    }
    now = until;
    return 1;
}

/* March from the scaled unknowns `start` through m inputs; return 0, or 1 if the march ends early, at *ended. */
int march(const double *start, const plant_t *q, long long m, const double *switches, const double *held_inputs,
          const double *rest_inputs, long long n_reads, const double *reads, double *outputs, double *at_rest,
          long long *steps, double *ended)
{
    long long next = 0;
    memcpy(w, start, sizeof w);
    memcpy(inputs, rest_inputs, sizeof inputs);
    now = switches[0];
    step = 1e-3;
    *steps = 0;
    *at_rest = output(q);
    while (next < n_reads && reads[next] <= now) outputs[next++] = *at_rest;
    for (long long k = 0; k < m; k++) {
        double until = k + 1 < m ? switches[k + 1] : fmax(now, n_reads ? reads[n_reads - 1] : now);
        memcpy(inputs, held_inputs + k * NU, sizeof inputs);
        if (!make_consistent(q)) { *ended = now; return 1; }
        while (next < n_reads && reads[next] <= until + 1e-9) {
            if (!advance(q, fmin(reads[next], until), steps)) { *ended = now; return 1; }
            outputs[next++] = output(q);
        }
        if (!advance(q, until, steps)) { *ended = now; return 1; }
    }
    return 0;
}
