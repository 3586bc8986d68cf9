"""Templates of the C code of controllers; `deatwin.plant.export.sampled.filled` fills them in."""

from __future__ import annotations

HEAD = """
#ifndef ${N}_REAL
#define ${N}_REAL double /* compile with -D${N}_REAL=float for single precision */
#endif
typedef ${N}_REAL ${n}_real;

#define ${N}_INPUTS 2 /* reference, reading */
#define ${N}_OUTPUTS 1 /* command */
#define ${N}_SAMPLE_TIME $sample_time /* s */

typedef struct {
    ${n}_real x[$size]; /* These are the states of the law. */
    ${n}_real smooth; /* This is the smoothed command, which selects the law. */
    ${n}_real command; /* This is the command of the last sample. */
} ${n}_state;

void ${n}_init(${n}_state *state); /* Call this when the loop is closed: the actuator rests at $operating_input. */
int ${n}_step(${n}_state *state, const ${n}_real *u, ${n}_real *y);
/* u[0] is the reference, u[1] the reading, y[0] the command. Returns 0 if done, and 1 if u is not finite; the state and
 * the command are then unchanged. */

$tables

void ${n}_init(${n}_state *state)
{
    int i;
    for (i = 0; i < $size; i++) state->x[i] = 0;
    state->smooth = (${n}_real)$operating_input;
    state->command = (${n}_real)$operating_input;
}

static ${n}_real ${n}_limited(${n}_real value, ${n}_real low, ${n}_real high)
{
    return value < low ? low : value > high ? high : value;
}
"""

LAW = """
/* The command is v = u0 + C x + D w within the limits; x = A x + B w + L (limited v - v) prevents windup at a limit. */
static ${n}_real ${n}_law(${n}_real *x, ${n}_real asked, ${n}_real seen)
{
    ${n}_real next[$size];
    ${n}_real wanted = (${n}_real)$centre + ${n}_d[0] * asked + ${n}_d[1] * seen, applied;
    int i, j;
    for (i = 0; i < $states; i++) wanted += ${n}_c[i] * x[i];
    applied = ${n}_limited(wanted, (${n}_real)$low, (${n}_real)$high);
    for (i = 0; i < $states; i++) {
        next[i] = ${n}_b[i][0] * asked + ${n}_b[i][1] * seen + ${n}_l[i] * (applied - wanted);
        for (j = 0; j < $states; j++) next[i] += ${n}_a[i][j] * x[j];
    }
    for (i = 0; i < $states; i++) x[i] = next[i];
    return applied;
}
"""

_STEP_BEGINS = """
int ${n}_step(${n}_state *state, const ${n}_real *u, ${n}_real *y)
{
    const ${n}_real asked = u[0] - (${n}_real)$operating_output, seen = u[1] - (${n}_real)$operating_output;
    const int finite = asked - asked == 0 && seen - seen == 0; /* This is 0 if a value is infinite or not a number. */
"""

_STEP_ENDS = """    y[0] = state->command;
    return !finite;
}
"""

LINEAR_STEP = f"""{_STEP_BEGINS}    if (finite) state->command = ${{n}}_law(state->x, asked, seen);
{_STEP_ENDS}"""

CURVE = """
/* This returns the constant input that holds an output: monotone cubics between the points are inverted by Newton's
 * method in a bracket. */
static ${n}_real ${n}_inverse(${n}_real wanted)
{
    const ${n}_real unit = (${n}_real)$largest * (${n}_real)(sizeof(${n}_real) > 4 ? 4.44e-16 : 2.4e-7);
    ${n}_real left = 0, right, found, moved, gap, slope;
    int low = 0, high = $pieces, k;
    if ($rising * (wanted - ${n}_outputs[0]) <= 0) return ${n}_inputs[0];
    if ($rising * (wanted - ${n}_outputs[$pieces]) >= 0) return ${n}_inputs[$pieces];
    while (high - low > 1) {
        k = (low + high) / 2;
        if ($rising * (wanted - ${n}_outputs[k]) >= 0) low = k; else high = k;
    }
    right = ${n}_inputs[high] - ${n}_inputs[low];
    found = right * (wanted - ${n}_outputs[low]) / (${n}_outputs[high] - ${n}_outputs[low]);
    for (k = 0; k < 60; k++) {
        const ${n}_real *c = ${n}_cubic[low];
        gap = wanted - (((c[0] * found + c[1]) * found + c[2]) * found + c[3]);
        slope = (3 * c[0] * found + 2 * c[1]) * found + c[2];
        if ($rising * gap > 0) left = found; else right = found;
        moved = slope != 0 ? found + gap / slope : (left + right) / 2;
        if (!(moved >= left && moved <= right)) moved = (left + right) / 2;
        slope = moved > found ? moved - found : found - moved;
        found = moved;
        if (slope <= unit) break;
    }
    return ${n}_inputs[low] + found;
}
"""

INVERSE_STEP = f"""{_STEP_BEGINS}    if (finite)
        state->command = ${{n}}_limited(
            ${{n}}_inverse(${{n}}_law(state->x, asked, seen)), (${{n}}_real)$command_min, (${{n}}_real)$command_max);
{_STEP_ENDS}"""

SCHEDULE = """
/* These macros interpolate the entries of the laws between two points of the schedule. */
#define ${N}_AMONG(t, i) (${n}_##t[k][i] + share * (${n}_##t[k + 1][i] - ${n}_##t[k][i]))
#define ${N}_WITHIN(t, i, j) (${n}_##t[k][i][j] + share * (${n}_##t[k + 1][i][j] - ${n}_##t[k][i][j]))
"""

SCHEDULED_STEP = f"""{_STEP_BEGINS}    const ${{n}}_real at = ${{n}}_limited(
        state->smooth, ${{n}}_points[0], ${{n}}_points[$last]);
    ${{n}}_real next[$size];
    ${{n}}_real share, wanted, applied;
    int i, j, k = 0;
    if (finite) {{
        while (k < $last - 1 && at >= ${{n}}_points[k + 1]) k++;
        share = (at - ${{n}}_points[k]) / (${{n}}_points[k + 1] - ${{n}}_points[k]);
        wanted = (${{n}}_real)$operating_input + ${{N}}_AMONG(d, 0) * asked + ${{N}}_AMONG(d, 1) * seen;
        for (i = 0; i < $states; i++) wanted += ${{N}}_AMONG(c, i) * state->x[i];
        applied = ${{n}}_limited(wanted, (${{n}}_real)$command_min, (${{n}}_real)$command_max);
        for (i = 0; i < $states; i++) {{
            next[i] = ${{N}}_WITHIN(b, i, 0) * asked + ${{N}}_WITHIN(b, i, 1) * seen;
            next[i] += ${{N}}_AMONG(l, i) * (applied - wanted);
            for (j = 0; j < $states; j++) next[i] += ${{N}}_WITHIN(a, i, j) * state->x[j];
        }}
        for (i = 0; i < $states; i++) state->x[i] = next[i];
        state->smooth += (${{n}}_real)$follow * (applied - state->smooth);
        state->command = applied;
    }}
{_STEP_ENDS}"""
