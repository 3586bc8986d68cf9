/* Polynomial models that are run along their own past.

   Every output c follows x_c(k) = base_c(k) + sum over its terms of theta * part(k) * monomial(x), where a part is a
   product of signals that are known beforehand and a monomial one of marched signals at earlier samples. Functions of
   marched signals are marched signals too, without equations: they are the last rows of x. Parts
   are computed for a block of samples at once, and terms with the same monomial share one coefficient: what is left to
   do sample by sample is short. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define BLOCK 256

typedef int64_t integer;

typedef struct {
    const double *known;           /* all signals that are known, one after another */
    const integer *known_start;    /* [n_terms + 1] into known_offset */
    const integer *known_offset;   /* a factor of a part is known[k + offset] */
    const integer *monomial;       /* [n_terms] the monomial of each term */
    const integer *equation;       /* [n_terms] the output that each term belongs to */
    const integer *marched_start;  /* [n_monomials + 1] into marched_offset */
    const integer *marched_offset; /* a factor of a monomial is x[k + offset] */
    const double *shapes;          /* [n_shapes][7] row of the argument, number, difference, gain, unit, p, q */
    const integer *ends;           /* [n_records] the sample after each record; records follow one another */
    integer n_outputs, n_shapes, n_records;
    integer first, n; /* the first sample to compute in each record; all samples */
} terms;

typedef struct {
    integer n_slots;
    integer *monomial, *slot, *stop; /* of each slot; the slot of each term; the end of each output's slots */
    double *coefficient;             /* [n_slots][BLOCK] */
} model;

/* Slots of a model: one for each monomial of an output. The terms come ordered by output. */
static model slots(const terms *t, integer n_terms, const integer *chosen, integer *places, double *coefficient) {
    model m = {0, places, places + n_terms, places + 2 * n_terms, coefficient};
    integer begin = 0, term = 0;
    for (integer c = 0; c < t->n_outputs; c++) {
        for (; term < n_terms && t->equation[chosen[term]] == c; term++) {
            integer s = begin, wanted = t->monomial[chosen[term]];
            while (s < m.n_slots && m.monomial[s] != wanted) s++;
            m.monomial[s] = wanted;
            m.slot[term] = s;
            if (s == m.n_slots) m.n_slots++;
        }
        begin = m.stop[c] = m.n_slots;
    }
    return m;
}

/* Coefficients of the samples [from, to). */
static void collect(const terms *t, const model *m, integer n_terms, const integer *chosen, const double *theta,
                    integer from, integer to) {
    double part[BLOCK];
    integer size = to - from;
    memset(m->coefficient, 0, sizeof(double) * (size_t)(m->n_slots * BLOCK));
    for (integer i = 0; i < n_terms; i++) {
        integer factor = t->known_start[chosen[i]], stop = t->known_start[chosen[i] + 1];
        double *into = m->coefficient + m->slot[i] * BLOCK;
        for (integer b = 0; b < size; b++) part[b] = theta[i];
        for (; factor < stop; factor++) {
            const double *signal = t->known + t->known_offset[factor] + from;
            for (integer b = 0; b < size; b++) part[b] *= signal[b];
        }
        for (integer b = 0; b < size; b++) into[b] += part[b];
    }
}

/* March over the samples [from, to); the sample whose value is not within the limit, or `to`. */
static integer march(const terms *t, const model *m, const double *base, double limit, integer from, integer to,
                     double *x) {
    for (integer k = from; k < to; k++) {
        integer s = 0;
        for (integer c = 0; c < t->n_outputs; c++) {
            double value = base ? base[c * t->n + k] : 0.0;
            for (; s < m->stop[c]; s++) {
                double product = m->coefficient[s * BLOCK + (k - from)];
                const integer *factor = t->marched_offset + t->marched_start[m->monomial[s]];
                const integer *stop = t->marched_offset + t->marched_start[m->monomial[s] + 1];
                for (; factor < stop; factor++) product *= x[k + *factor];
                value += product;
            }
            if (!(fabs(value) < limit)) return k;
            x[c * t->n + k] = value;
        }
        for (integer j = 0; j < t->n_shapes; j++) {
            const double *of = t->shapes + 7 * j, *argument = x + (integer)of[0] * t->n + k;
            double change = of[2] > 0 ? *argument - argument[-(integer)of[2]] : *argument;
            x[(t->n_outputs + j) * t->n + k] = shape((int)of[1], of[3] * change, of[5], of[6]) / of[4];
        }
    }
    return to;
}

/* Run one model over all samples of x; the sample of the first divergence, or n. limits[r] belongs to record r.
   places: 3 n_terms + n_outputs numbers of work; coefficient: n_terms * BLOCK. */
integer deatwin_run(const terms *t, integer n_terms, const integer *chosen, const double *theta, const double *base,
                    const double *limits, double *x, integer *places, double *coefficient) {
    model m = slots(t, n_terms, chosen, places, coefficient);
    for (integer r = 0, begin = 0; r < t->n_records; begin = t->ends[r++]) {
        for (integer from = begin + t->first; from < t->ends[r]; from += BLOCK) {
            integer to = from + BLOCK < t->ends[r] ? from + BLOCK : t->ends[r];
            collect(t, &m, n_terms, chosen, theta, from, to);
            integer reached = march(t, &m, base, limits[r], from, to, x);
            if (reached < to) return reached;
        }
    }
    return t->n;
}

/* Sums of squared simulation errors of model j = (chosen, theta)[j], of one output that was measured, over each section
   of the samples, from start[i] to before stop[i]. After a divergence they are infinite.
   x: (1 + n_shapes) n numbers of work, whose rows begin with the first measured ones. */
void deatwin_errors(const terms *t, integer n_models, integer n_terms, const integer *chosen, const double *theta,
                    integer n_sections, const integer *start, const integer *stop, const double *measured,
                    const double *limits, double *sums, double *x, integer *places, double *coefficient) {
    for (integer j = 0; j < n_models; j++, chosen += n_terms, theta += n_terms, sums += n_sections) {
        integer reached = deatwin_run(t, n_terms, chosen, theta, 0, limits, x, places, coefficient);
        for (integer i = 0; i < n_sections; i++) {
            sums[i] = reached < t->n ? INFINITY : 0;
            for (integer k = start[i]; k < stop[i]; k++) sums[i] += (measured[k] - x[k]) * (measured[k] - x[k]);
        }
    }
}
