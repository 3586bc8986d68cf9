"""Plants as C source: CasADi's code of one implicit step per sample, with state, clock and shorter steps."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deatwin.plant.equations import KNOWN
from deatwin.plant.errors import ModelError
from deatwin.plant.export.sampled import SampledSource, Signal, comment, filled, require_identifier, table
from deatwin.plant.integrator.collocation import step_functions
from deatwin.plant.integrator.newton import SETTLED
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.readings import ROWS
from deatwin.plant.rest import RestState, rest_state
from deatwin.plant.sample import SHORTER_STEPS
from deatwin.plant.words import listed

Signals = tuple[Signal, ...]

_STATE = """
#define ${N}_INPUTS $inputs
#define ${N}_OUTPUTS $outputs
#define ${N}_SAMPLE_TIME $sample_time

typedef double ${n}_real;

typedef struct {
    double x[$x]; /* The states are: $states. */
    double z[$z]; /* The algebraic coordinates are: $coordinates. */
    double past[$past]; /* These are the commands of the previous samples. */
    double y[$outputs]; /* These are the outputs after the last solved sample. */
    double stored[$stored]; /* The further readings are rates of these quantities, which are given after that sample. */
    double start; /* The first sample begins at this clock time, s; set it after init if it is not 0. */
    long count; /* This counts the samples so far. */
} ${n}_state;

void ${n}_init(${n}_state *state); /* The plant starts at rest under a command of $rest_command$displaced. */
int ${n}_step(${n}_state *state, const double *u, double *y); /* Returns 0 if done, and 1 if the sample could not be solved; the state is then unchanged. */
"""

_BODY = """
void ${n}_init(${n}_state *state)
{
    int i;
    for (i = 0; i < $x; i++) state->x[i] = ${n}_x[i];
    for (i = 0; i < $z; i++) state->z[i] = ${n}_z[i];
    for (i = 0; i < $past; i++) state->past[i] = $rest_command;
    for (i = 0; i < $outputs; i++) state->y[i] = ${n}_y[i];
    for (i = 0; i < $further; i++) state->stored[i] = ${n}_stored[i];
    state->start = 0.0;
    state->count = 0;
}

/* This computes a sample in a number of steps of equal length, and returns 0 if each of them is solved. */
static int ${n}_in_steps(const ${n}_state *before, ${n}_state *after, const double *inputs, int number)
{
    const double width = ${N}_SAMPLE_TIME / number;
    const double begin = before->start + (double)before->count * ${N}_SAMPLE_TIME;
    double x[$x], z[$z], read[1 + 3 * $stored], error = 0.0, time; /* read: the reading, levels, stored, shares */
    const double *arg[$sz_arg];
    double *res[$sz_res];
    double w[$sz_w];
    casadi_int iw[$sz_iw];
    int i, k;
    *after = *before;
    for (k = 0; k < number; k++) {
        for (i = 0; i < $x; i++) x[i] = after->x[i];
        for (i = 0; i < $z; i++) z[i] = after->z[i];
        time = begin + width * k;
        arg[0] = x; arg[1] = z; arg[2] = ${n}_d; arg[3] = inputs; arg[4] = &time; arg[5] = &width;
        arg[6] = ${n}_p; arg[7] = ${n}_c;
        res[0] = after->x; res[1] = after->z; res[2] = read; res[3] = after->y + 1 + $further; res[4] = &error;
        if (${n}_sample(arg, res, iw, w, 0)) return 1;
        /* A value that is not a number fails, too. */
        if (!(error <= $settled) || !(read[0] - read[0] == 0.0)) return 1;
    }
    after->y[0] = read[0];
    for (i = 0; i < $further; i++) {
        after->stored[i] = read[1 + $further + i];
        after->y[1 + i] = read[1 + i]
            + read[1 + 2 * $further + i] * (after->stored[i] - before->stored[i]) / ${N}_SAMPLE_TIME;
    }
    return 0;
}

int ${n}_step(${n}_state *state, const double *u, double *y)
{
    static const int numbers[$tries] = {$numbers};
    double inputs[$n_u];
    ${n}_state after;
    int i, k, failed = 1;
    inputs[0] = u[0];
    for (i = 0; i < $history; i++) inputs[1 + i] = state->past[i];
$channels
    for (k = 0; k < $tries && failed; k++) failed = ${n}_in_steps(state, &after, inputs, numbers[k]);
    if (!failed) {
        *state = after;
        state->count += 1;
        for (i = $history - 1; i > 0; i--) state->past[i] = state->past[i - 1];
        state->past[0] = u[0];
    }
    for (i = 0; i < $outputs; i++) y[i] = state->y[i];
    return failed;
}
"""


def plant_source(plant: Plant, *, name: str = "plant") -> SampledSource:
    """Return the C source of a plant, with the present values of the plant's parameters as constants.

    Parameters
    ----------
    plant : Plant
        Plant with any rig and effects.
    name : str
        Prefix of all names in the source; a valid C identifier.

    Returns
    -------
    SampledSource
        C source. The input array ``u`` of the step function holds the command, followed by the measured channels on
        which the plant depends, such as a temperature. The output array ``y`` holds the noise-free readings at the end
        of the sample, followed by other signals of the plant, such as the film voltage. All are in SI units except the
        command.

    Raises
    ------
    ModelError
        If the name is not a C identifier, or the plant has no state of rest.
    """
    require_plant(plant, "an export")
    require_identifier(name)
    rest = rest_of(plant)
    inputs, outputs = plant_signals(plant, rest)
    description = describe(plant)
    head = comment(
        [
            f"{description}, sample by sample.",
            f"One call is one sample of {plant.rig.sample_time:g} s, over which the inputs are held.",
            *(f"u[{k}]: {signal}" for k, signal in enumerate(inputs)),
            *(f"y[{k}]: {signal}, at the end of the sample" for k, signal in enumerate(outputs)),
        ]
    )
    step = _sample_function(plant, name)
    text = head + _casadi_code(step) + _shim(plant, rest, step, name, inputs, outputs)
    return SampledSource(
        name=name,
        text=text,
        sample_time=plant.rig.sample_time,
        inputs=inputs,
        outputs=outputs,
        description=description,
        has_clock=True,
    )


def describe(plant: Plant) -> str:
    """Describe a plant in a few words."""
    return f"{plant.rig.kind} with {', '.join(plant.effect_names) or 'no effects'}"


def rest_of(plant: Plant) -> RestState:
    """Return the state of rest in which an export starts."""
    rest = rest_state(plant.equations, plant.rig.start.rest_command, plant.free_values)
    if not rest.found:
        raise ModelError(f"the plant cannot be exported: {rest.fault}")
    return rest


def plant_signals(plant: Plant, rest: RestState) -> tuple[Signals, Signals]:
    """Return inputs and outputs of a plant with their values at rest."""
    rig, equations = plant.rig, plant.equations
    inputs = [Signal(name=rig.input_name, unit=rig.input_unit, start=rig.start.rest_command)]
    inputs += [Signal(name=c, start=v) for c, v in equations.channels.items() if c not in KNOWN]
    held = equations.held_inputs(rig.start.rest_command)
    point = (rest.x, rest.z, rest.d, held, 0.0, plant.free_values, equations.constants)
    seen = np.asarray(ca.densify(equations.watched(*point))).ravel()
    outputs = [Signal(name=rig.output_name, unit=rig.output_unit, start=float(equations.output(*point)))]
    levels = _further_at_rest(plant, rest)[0]
    outputs += [Signal(name=one.name, unit=one.unit, start=v) for one, v in zip(rig.further, levels, strict=True)]
    outputs += [Signal(name=f"signal.{s}", start=float(v)) for s, v in zip(equations.signals, seen, strict=True)]
    return tuple(inputs), tuple(outputs)


def _further_at_rest(plant: Plant, rest: RestState) -> np.ndarray:
    """Return levels, stored quantities and shares of the m further readings at rest, shape (3, m)."""
    equations = plant.equations
    if equations.further is None:
        return np.empty((ROWS, 0))
    held = equations.held_inputs(plant.rig.start.rest_command)
    rows = equations.further(rest.x, rest.z, rest.d, held, 0.0, plant.free_values, equations.constants)
    return np.asarray(ca.densify(rows)).reshape(ROWS, -1)


def _sample_function(plant: Plant, name: str) -> ca.Function:
    """Return the step function under its name in C."""
    plain = step_functions(plant.equations).plain
    arguments = plain.mx_in()
    return ca.Function(f"{name}_sample", arguments, plain.call(arguments))


def _casadi_code(step: ca.Function) -> str:
    generator = ca.CodeGenerator("plant.c")
    generator.add(step)
    code: str = generator.dump()
    return code


def _shim(plant: Plant, rest: RestState, step: ca.Function, name: str, inputs: Signals, outputs: Signals) -> str:
    """Return C code that calls the step, with state, start and clock."""
    equations = plant.equations
    channels, k = [], 1
    for position, channel in enumerate(equations.channels, start=1 + equations.history):
        clock = f"state->start + (double)state->count * {name.upper()}_SAMPLE_TIME"
        # A known input gets the sample's start; the step itself replaces that by its middle.
        channels.append(f"    inputs[{position}] = {clock if channel in KNOWN else f'u[{k}]'};")
        k += channel not in KNOWN
    values: dict[str, ArrayLike] = {
        "x": rest.x,
        "z": rest.z,
        "d": rest.d,
        "p": plant.free_values,
        "c": equations.constants,
        "y": [signal.start for signal in outputs],
        "stored": _further_at_rest(plant, rest)[1],
    }
    fitted = [key for key, one in plant.parameters.items() if key.endswith("at_start") and one.value != 0.0]
    fields = {
        "n": name,
        "N": name.upper(),
        "inputs": len(inputs),
        "outputs": len(outputs),
        "further": len(plant.rig.further),
        "stored": max(len(plant.rig.further), 1),
        "x": max(rest.x.size, 1),
        "z": max(rest.z.size, 1),
        "past": max(equations.history, 1),
        "history": equations.history,
        "n_u": equations.held_inputs(0.0).size,
        "sample_time": float(plant.rig.sample_time),
        "rest_command": float(plant.rig.start.rest_command),
        "displaced": f", apart from {listed(fitted)}" if fitted else "",
        "settled": SETTLED,
        "states": ", ".join(equations.states) or "none",
        "coordinates": ", ".join(equations.coordinates) or "none",
        "tries": 1 + len(SHORTER_STEPS),
        "numbers": ", ".join(map(str, (1, *SHORTER_STEPS))),
        "sz_arg": step.sz_arg(),
        "sz_res": step.sz_res(),
        "sz_iw": max(step.sz_iw(), 1),
        "sz_w": max(step.sz_w(), 1),
        "channels": "\n".join(channels),
    }
    tables = "\n".join(table(f"double {name}_{key}", value) for key, value in values.items())
    return f"{filled(_STATE, **fields)}\n{tables}\n{filled(_BODY, **fields)}"
