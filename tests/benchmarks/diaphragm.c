/* The base plant of the benchmark as one would write it by hand: the film of a diaphragm whose ball slides, Gent
   energy, one Maxwell branch, and Radau IIA with the transformed simplified Newton method of Hairer & Wanner (1996),
   section IV.8. Coefficients of the scheme come from outside. The Jacobian is that of differences: the method does not
   need it exact, and here it costs less than a sixth of a step.

   Unknowns of a stage: deflection, velocity, branch stretch (states); electrode stretch, outer drop,
   contact stretch (coordinates). */
#include <math.h>
#include <string.h>

#define N 6
#define NX 3
#define S 5
#define PAIRS 2
#define VACUUM 8.8541878128e-12
#define GRAVITY 9.80665

typedef struct {
    double shear_modulus, stretch_limit, branch_modulus, branch_time, permittivity, damping, zero;
} parameters; /* in the order of the plant's free ones */

typedef struct {
    double mass, gain, thickness, frame, frame_reference, electrode_reference, contact_reference;
    double radius_0[POINTS], radius_1[POINTS], area_0[POINTS], area_1[POINTS];
} constants;

typedef struct {
    double nodes[S], gamma, real_vector[S], real_row[S];
    double alpha[PAIRS], beta[PAIRS];
    double vector_re[PAIRS][S], vector_im[PAIRS][S], row_re[PAIRS][S], row_im[PAIRS][S];
} scheme;

static const double scale[N] = {1e-3, 0.05, 1.0, 1.0, 1e-3, 1.0};

/* Derivatives of the energy of a point by its two stretches, and of the branch by the relaxed stretches. */
static inline void point(const parameters *p, double volume, double a, double b, double c, double d,
                         double *by_a, double *by_b, double *branch_c, double *branch_d) {
    double thin = 1 / (a * b), third = thin * thin;
    double first = a * a + b * b + third - 3;
    double w = p->shear_modulus * volume / (1 - first / p->stretch_limit);
    double inverse_a = b * thin, inverse_b = a * thin;
    double inverse_cd = 1 / (c * d), inverse_c = d * inverse_cd, inverse_d = c * inverse_cd;
    double elastic_a = a * inverse_c, elastic_b = b * inverse_d, relaxed = c * d;
    double elastic_third = third * relaxed * relaxed;
    double m = p->branch_modulus * volume;
    double stress_a = elastic_a * elastic_a - elastic_third, stress_b = elastic_b * elastic_b - elastic_third;
    *by_a = w * (a - third * inverse_a) + m * stress_a * inverse_a;
    *by_b = w * (b - third * inverse_b) + m * stress_b * inverse_b;
    *branch_c = -volume * stress_a * inverse_c;
    *branch_d = -volume * stress_b * inverse_d;
}

/* A ring whose thickness is uniform while flat, r^2 = alpha rho^2 + beta, and that falls by a drop with its depth
   logarithmic in r. */
typedef struct {
    double alpha, beta, log_inverse; /* log_inverse: one over the logarithm of outer over inner radius */
    double alpha_by[2], beta_by[2], log_by[2]; /* by the stretches at the inner and at the outer edge */
} ring;

static ring shaped(double inner_reference, double inner, double outer_reference, double outer, int frame) {
    ring g;
    double width = 1 / (outer_reference * outer_reference - inner_reference * inner_reference);
    double square = inner_reference * inner_reference;
    g.alpha = (outer * outer - inner * inner) * width;
    g.beta = inner * inner - g.alpha * square;
    g.log_inverse = 1 / log(outer / inner);
    g.alpha_by[0] = -2 * inner * inner_reference * width;
    g.beta_by[0] = 2 * inner * inner_reference - g.alpha_by[0] * square;
    g.log_by[0] = -inner_reference / inner;
    g.alpha_by[1] = frame ? 0 : 2 * outer * outer_reference * width;
    g.beta_by[1] = -g.alpha_by[1] * square;
    g.log_by[1] = frame ? 0 : outer_reference / outer;
    return g;
}

static void equations(const parameters *p, const constants *c, double command, const double *w, double *f) {
    double z = w[0], v = w[1], xi = w[2], s = w[3], q = w[4], contact = w[5];
    double h = c->thickness, volts = c->gain * command, by_xi = 0, viscous, a_s, b_s, c_s, d_s;
    double disc = M_PI * c->contact_reference * c->contact_reference * h;
    double electric = p->permittivity * VACUUM / (h * h) * volts * volts;
    double by_drop[2] = {0, 0}, by_edge[2][2] = {{0, 0}, {0, 0}}, drop[2] = {z - q, q};
    double e = c->electrode_reference;
    ring zones[2] = {shaped(c->contact_reference, contact * c->contact_reference, e, s * e, 0),
                     shaped(e, s * e, c->frame_reference, c->frame, 1)};
    ring relaxed = shaped(e, xi * e, c->frame_reference, c->frame, 1);
    viscous = 12 * disc / (xi * xi); /* of the flow: 4 (a^2 + a b + b^2) per volume, with rates a and b of the logarithms */
    const double *radius[2] = {c->radius_0, c->radius_1}, *area[2] = {c->area_0, c->area_1};

    for (int zone = 0; zone < 2; ++zone)
        for (int k = 0; k < POINTS; ++k) {
            const ring *g = &zones[zone];
            double rho = radius[zone][k], square = rho * rho, rho_inverse = 1 / rho, volume = area[zone][k] * h;
            double r = sqrt(g->alpha * square + g->beta), r_inverse = 1 / r;
            double meridional = g->alpha * rho * r_inverse, hoop = r * rho_inverse;
            double lever = meridional * r_inverse * g->log_inverse, slope = drop[zone] * lever;
            double a = sqrt(meridional * meridional + slope * slope), c_1 = xi, c_2 = xi, c_1_by = 1, c_2_by = 1;
            if (zone == 1) { /* the relaxed electrode is uniform, the relaxed annulus is not */
                double x = sqrt(relaxed.alpha * square + relaxed.beta), x_inverse = 1 / x;
                double x_by = (relaxed.alpha_by[0] * square + relaxed.beta_by[0]) * x_inverse / 2;
                c_1 = relaxed.alpha * rho * x_inverse;
                c_2 = x * rho_inverse;
                c_1_by = relaxed.alpha_by[0] * rho * x_inverse - c_1 * x_by * x_inverse;
                c_2_by = x_by * rho_inverse;
            }
            point(p, volume, a, hoop, c_1, c_2, &a_s, &b_s, &c_s, &d_s);
            by_xi += c_s * c_1_by + d_s * c_2_by;
            double flow_1 = c_1_by / c_1, flow_2 = c_2_by / c_2;
            viscous += 4 * volume * (flow_1 * flow_1 + flow_1 * flow_2 + flow_2 * flow_2);
            if (zone == 0) {
                a_s -= electric * volume * a * hoop * hoop;
                b_s -= electric * volume * a * a * hoop;
            }
            double along = a_s / a, flat_inverse = 1 / meridional;
            by_drop[zone] += along * slope * lever;
            for (int i = 0; i < 2 - zone; ++i) {
                double r_by = (g->alpha_by[i] * square + g->beta_by[i]) * r_inverse / 2;
                double m_by = g->alpha_by[i] * rho * r_inverse - meridional * r_by * r_inverse;
                double s_by = slope * (m_by * flat_inverse - r_by * r_inverse - g->log_by[i] * g->log_inverse);
                by_edge[zone][i] += along * (meridional * m_by + slope * s_by) + b_s * r_by * rho_inverse;
            }
        }
    point(p, disc, contact, contact, xi, xi, &a_s, &b_s, &c_s, &d_s);
    by_xi += c_s + d_s;
    double by_contact = by_edge[0][0] + a_s + b_s - electric * disc * 2 * contact * contact * contact;

    f[0] = v;
    f[1] = (c->mass * GRAVITY - by_drop[0] - p->damping * v) / c->mass;
    f[2] = -by_xi / viscous;
    f[3] = (by_edge[0][1] + by_edge[1][0]) / c->mass;
    f[4] = (by_drop[1] - by_drop[0]) / c->mass;
    f[5] = by_contact / c->mass;
}

static void jacobian(const parameters *p, const constants *c, double command, const double *w, const double *f, double j[N][N]) {
    for (int k = 0; k < N; ++k) {
        double there[N], value[N], step = 1e-7 * scale[k];
        if (k == 1) { /* the velocity enters in two places */
            for (int i = 0; i < N; ++i) j[i][k] = 0;
            j[0][k] = 1;
            j[1][k] = -p->damping / c->mass;
            continue;
        }
        memcpy(there, w, sizeof there);
        there[k] += step;
        equations(p, c, command, there, value);
        for (int i = 0; i < N; ++i) j[i][k] = (value[i] - f[i]) / step;
    }
}

/* Elimination without pivoting, real and complex; reciprocals of the pivots on the diagonal. */
static void factor(double a[N][N]) {
    for (int k = 0; k < N; ++k) {
        a[k][k] = 1 / a[k][k];
        for (int i = k + 1; i < N; ++i) {
            a[i][k] *= a[k][k];
            for (int j = k + 1; j < N; ++j) a[i][j] -= a[i][k] * a[k][j];
        }
    }
}

static void solve(double a[N][N], double *b) {
    for (int i = 1; i < N; ++i) for (int j = 0; j < i; ++j) b[i] -= a[i][j] * b[j];
    for (int i = N - 1; i >= 0; --i) {
        for (int j = i + 1; j < N; ++j) b[i] -= a[i][j] * b[j];
        b[i] *= a[i][i];
    }
}

static void factor_complex(double a[N][N], double b[N][N]) {
    for (int k = 0; k < N; ++k) {
        double size = 1 / (a[k][k] * a[k][k] + b[k][k] * b[k][k]);
        double re = a[k][k] * size, im = -b[k][k] * size;
        a[k][k] = re;
        b[k][k] = im;
        for (int i = k + 1; i < N; ++i) {
            double x = a[i][k] * re - b[i][k] * im, y = a[i][k] * im + b[i][k] * re;
            a[i][k] = x;
            b[i][k] = y;
            for (int j = k + 1; j < N; ++j) {
                a[i][j] -= x * a[k][j] - y * b[k][j];
                b[i][j] -= x * b[k][j] + y * a[k][j];
            }
        }
    }
}

static void solve_complex(double a[N][N], double b[N][N], double *re, double *im) {
    for (int i = 1; i < N; ++i)
        for (int j = 0; j < i; ++j) {
            re[i] -= a[i][j] * re[j] - b[i][j] * im[j];
            im[i] -= a[i][j] * im[j] + b[i][j] * re[j];
        }
    for (int i = N - 1; i >= 0; --i) {
        for (int j = i + 1; j < N; ++j) {
            re[i] -= a[i][j] * re[j] - b[i][j] * im[j];
            im[i] -= a[i][j] * im[j] + b[i][j] * re[j];
        }
        double x = re[i] * a[i][i] - im[i] * b[i][i], y = re[i] * b[i][i] + im[i] * a[i][i];
        re[i] = x;
        im[i] = y;
    }
}

typedef struct {
    double real[N][N], re[PAIRS][N][N], im[PAIRS][N][N];
} factors;

static void prepare(const scheme *q, const double *mass, double h, double j[N][N], factors *g) {
    for (int i = 0; i < N; ++i) {
        double weight = i < NX ? h : 1;
        for (int k = 0; k < N; ++k) {
            g->real[i][k] = -weight * j[i][k];
            for (int m = 0; m < PAIRS; ++m) {
                g->re[m][i][k] = -weight * j[i][k];
                g->im[m][i][k] = 0;
            }
        }
        if (i < NX) {
            g->real[i][i] += q->gamma * mass[i];
            for (int m = 0; m < PAIRS; ++m) {
                g->re[m][i][i] += q->alpha[m] * mass[i];
                g->im[m][i][i] += q->beta[m] * mass[i];
            }
        }
    }
    factor(g->real);
    for (int m = 0; m < PAIRS; ++m) factor_complex(g->re[m], g->im[m]);
}

static double correct(const scheme *q, factors *g, const double *mass, double h, const double *x, double w[S][N], double f[S][N]) {
    double change[S][N], size = 0, b[N], re[N], im[N];
    for (int i = 0; i < N; ++i) {
        double moved = 0, drive = 0;
        for (int s = 0; s < S; ++s) {
            if (i < NX) moved += q->real_row[s] * (w[s][i] - x[i]);
            drive += q->real_row[s] * f[s][i];
        }
        b[i] = i < NX ? q->gamma * mass[i] * moved - h * drive : -drive;
    }
    solve(g->real, b);
    for (int s = 0; s < S; ++s) for (int i = 0; i < N; ++i) change[s][i] = q->real_vector[s] * b[i];
    for (int m = 0; m < PAIRS; ++m) {
        for (int i = 0; i < N; ++i) {
            double moved_re = 0, moved_im = 0, drive_re = 0, drive_im = 0;
            for (int s = 0; s < S; ++s) {
                if (i < NX) {
                    moved_re += q->row_re[m][s] * (w[s][i] - x[i]);
                    moved_im += q->row_im[m][s] * (w[s][i] - x[i]);
                }
                drive_re += q->row_re[m][s] * f[s][i];
                drive_im += q->row_im[m][s] * f[s][i];
            }
            if (i < NX) {
                re[i] = mass[i] * (q->alpha[m] * moved_re - q->beta[m] * moved_im) - h * drive_re;
                im[i] = mass[i] * (q->alpha[m] * moved_im + q->beta[m] * moved_re) - h * drive_im;
            } else {
                re[i] = -drive_re;
                im[i] = -drive_im;
            }
        }
        solve_complex(g->re[m], g->im[m], re, im);
        for (int s = 0; s < S; ++s)
            for (int i = 0; i < N; ++i)
                change[s][i] += 2 * (q->vector_re[m][s] * re[i] - q->vector_im[m][s] * im[i]);
    }
    for (int s = 0; s < S; ++s)
        for (int i = 0; i < N; ++i) {
            w[s][i] -= change[s][i];
            size += change[s][i] * change[s][i] / (scale[i] * scale[i]);
        }
    return sqrt(size);
}

/* Readings at the end of n samples; returns how many were solved. */
long march(const parameters *p, const constants *c, const scheme *q, const double *start, double rest_deflection,
           double h, double settled, const double *commands, long n, double *readings) {
    double at[N], mass[NX] = {1, 1, p->branch_time};
    memcpy(at, start, sizeof at);
    for (long sample = 0; sample < n; ++sample) {
        double here[N], j[N][N], w[S][N], f[S][N], last, size, error;
        factors g;
        equations(p, c, commands[sample], at, here);
        jacobian(p, c, commands[sample], at, here, j);
        prepare(q, mass, h, j, &g);
        for (int s = 0; s < S; ++s) {
            memcpy(w[s], at, sizeof at);
            memcpy(f[s], here, sizeof here);
        }
        size = correct(q, &g, mass, h, at, w, f);
        for (int k = 0;; ++k) {
            for (int s = 0; s < S; ++s) equations(p, c, commands[sample], w[s], f[s]);
            last = size;
            size = correct(q, &g, mass, h, at, w, f);
            error = size < last ? size * size / last : size;
            if (k > 0 && error <= settled) break;
            if (k == 18 || error != error) return sample;
        }
        memcpy(at, w[S - 1], sizeof at);
        readings[sample] = at[0] - rest_deflection + p->zero;
    }
    return n;
}
