"""Write a NARX model as C source, which simulates one sample per call."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import real_numbers
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.terms import Term, Variable
from deatwin.ident.narx.written import origins, written
from deatwin.plant.errors import ModelError
from deatwin.plant.export.sampled import SampledSource, Signal, comment, filled, number, require_identifier, table

_SOURCE = """
#ifndef ${N}_REAL
#define ${N}_REAL double /* compile with -D${N}_REAL=float for single precision */
#endif
typedef ${N}_REAL ${n}_real;

#define ${N}_INPUTS $inputs
#define ${N}_OUTPUTS $outputs
#define ${N}_SAMPLE_TIME $sample_time /* s */

typedef struct {
    ${n}_real y[$outputs][$y_lags]; /* y[i][l - 1] is output i, l samples ago. */
    ${n}_real u[$inputs][$u_lags]; /* u[i][l - 1] is input i, l samples ago. */
    ${n}_real last[$outputs]; /* These are the outputs of the last sample. */
    int diverged; /* This is 1 from the sample on whose outputs left the plausible range. */
} ${n}_state;

void ${n}_init(${n}_state *state); /* Before the first sample, inputs and outputs are ${n}_rest_u and ${n}_rest_y. */
int ${n}_step(${n}_state *state, const ${n}_real *u, ${n}_real *y); /* Returns 0 if done, and 1 if the run diverged; y then holds the last outputs. */

$tables
$functions

void ${n}_init(${n}_state *state)
{
    int i, l;
    for (i = 0; i < $outputs; i++) {
        for (l = 0; l < $y_lags; l++) state->y[i][l] = ${n}_rest_y[i];
        state->last[i] = ${n}_rest_y[i];
    }
    for (i = 0; i < $inputs; i++)
        for (l = 0; l < $u_lags; l++) state->u[i][l] = ${n}_rest_u[i];
    state->diverged = 0;
}

int ${n}_step(${n}_state *state, const ${n}_real *u, ${n}_real *y)
{
    const ${n}_real limit = (${n}_real)$limit;
    ${n}_real next[$outputs];
    int i, l;
    if (!state->diverged) {
$sums
        for (i = 0; i < $outputs; i++) /* A value that is not a number is beyond the limit, too. */
            if (!($distance > -limit && $distance < limit)) state->diverged = 1;
    }
    if (!state->diverged) {
        for (i = 0; i < $outputs; i++) {
            for (l = $y_lags - 1; l > 0; l--) state->y[i][l] = state->y[i][l - 1];
            state->y[i][0] = state->last[i] = next[i];
        }
        for (i = 0; i < $inputs; i++) {
            for (l = $u_lags - 1; l > 0; l--) state->u[i][l] = state->u[i][l - 1];
            state->u[i][0] = u[i];
        }
    }
    for (i = 0; i < $outputs; i++) y[i] = state->last[i];
    return state->diverged;
}
"""


def narx_source(
    model: NarxModel, *, name: str = "narx", rest_input: ArrayLike | None = None, rest_output: ArrayLike | None = None
) -> SampledSource:
    """Write a model as C source that computes one sample of `NarxModel.simulate` per call.

    The C function ``narx_step`` takes the input u(k) and computes the output y(k). To start the run from measured
    values, write these into ``state.y`` and ``state.u`` after the call of ``narx_init``.

    Parameters
    ----------
    model : NarxModel
        Model with any number of inputs and outputs; its noise terms are ignored.
    name : str
        Prefix of all names in the source.
    rest_input : array_like, shape (n_inputs,), optional
        Inputs before the first sample, in their units; by default the model's ``input_origin``.
    rest_output : array_like, shape (n_outputs,), optional
        Outputs before the first sample, in their units; by default the model's ``output_origin``.

    Raises
    ------
    ModelError
        If `name` is not a C identifier, `rest_input` or `rest_output` has the wrong shape, or the model has only noise
        terms.
    """
    require_identifier(name)
    quiet = require_model(model).deterministic
    rest_u = _rest(rest_input, model.input_origin, "inputs")
    rest_y = _rest(rest_output, model.output_origin, "outputs")
    inputs, outputs = (
        tuple(Signal(name=n, unit=unit, start=float(v)) for n, unit, v in zip(names, units, rest, strict=True))
        for names, units, rest in (
            (model.input_names, model.input_units, rest_u),
            (model.output_names, model.output_units, rest_y),
        )
    )
    tables = [(f"{name}_theta", quiet.theta), (f"{name}_rest_u", rest_u), (f"{name}_rest_y", rest_y)]
    if model.output_origin.any():
        tables.append((f"{name}_origin_y", model.output_origin))
    text = _head(quiet, inputs, outputs) + filled(
        _SOURCE,
        n=name,
        N=name.upper(),
        inputs=len(inputs),
        outputs=len(outputs),
        distance=f"(next[i] - {name}_origin_y[i])" if model.output_origin.any() else "next[i]",
        y_lags=_depth(quiet, "y"),
        u_lags=_depth(quiet, "u"),
        sample_time=float(model.sample_time),
        limit=model.divergence_limit(model.output_origin[:, None]),
        functions=_functions(quiet, name),
        sums="\n".join(_sums(quiet, name)),
        tables="\n".join(table(f"{name}_real {key}", values) for key, values in tables),
    )
    return SampledSource(
        name=name,
        text=text,
        sample_time=model.sample_time,
        inputs=inputs,
        outputs=outputs,
        description=f"NARX model of {len(quiet.terms)} terms from {_listed(inputs)} to {_listed(outputs)}",
    )


def _rest(values: ArrayLike | None, origin: np.ndarray, what: str) -> np.ndarray:
    found = origin if values is None else np.atleast_1d(real_numbers(values, f"the rest of {what}"))
    if found.shape != origin.shape:
        raise ModelError(f"the rest of {what} has the shape {found.shape}; the model has {origin.size} {what}")
    return found


def _listed(signals: tuple[Signal, ...]) -> str:
    return ", ".join(map(str, signals))


def _head(model: NarxModel, inputs: tuple[Signal, ...], outputs: tuple[Signal, ...]) -> str:
    trained = model.operating
    known = () if trained is None else zip(inputs, trained.input_min.tolist(), trained.input_max.tolist(), strict=True)
    names = model.input_names, model.output_names
    return comment(
        [
            f"NARX model, with one sample of {model.sample_time:g} s a call.",
            *(written(model.terms, model.theta, model.equations, *names) + origins(model)).splitlines(),
            *(f"u[{k}]: {signal}" for k, signal in enumerate(inputs)),
            *(f"y[{k}]: {signal}" for k, signal in enumerate(outputs)),
            *(
                f"Trained on {signal} from {number(low)} to {number(high)}; beyond it extrapolates."
                for signal, low, high in known
            ),
        ]
    )


def _depth(model: NarxModel, kind: str) -> int:
    """Return how many past samples are kept, at least one, because a C array cannot be empty."""
    return max((v.reach for v in model.table.variables if v.kind == kind), default=0) or 1


def _sums(model: NarxModel, name: str) -> list[str]:
    """Write a sum of terms for each output, in the model's order, so that rounding is the same."""
    lines = []
    for row in range(model.n_outputs):
        products = [
            " * ".join([f"{name}_theta[{m}]", *_factors(term, model, name)])
            for m, (term, equation) in enumerate(zip(model.terms, model.equations, strict=True))
            if equation == row
        ]
        if model.output_origin[row]:
            products.append(f"({name}_real){number(float(model.output_origin[row]))}")
        lines.append(f"        next[{row}] = " + "\n            + ".join(products or [f"({name}_real)0"]) + ";")
    return lines


def _factors(term: Term, model: NarxModel, name: str) -> list[str]:
    origins = {"u": model.input_origin, "y": model.output_origin}

    def signal(v: Variable, lag: int) -> str:
        place, origin = (
            f"u[{v.index}]" if lag == 0 else f"state->{v.kind}[{v.index}][{lag - 1}]",
            origins[v.kind][v.index],
        )
        return f"({place} - ({name}_real){number(float(origin))})" if origin else place

    def factor(v: Variable) -> str:
        argument = signal(v, v.lag) + (f" - {signal(v, v.reach)}" if v.reach > v.lag else "")
        if v.shape is None:
            return argument
        numbers = ", ".join(f"({name}_real){number(p)}" for p in (*v.shape.parameters, 0.0, 0.0)[:2])
        return f"{name}_{v.shape.name}({argument}, {numbers})"

    return [factor(v) for v in term.expanded]


def _functions(model: NarxModel, name: str) -> str:
    """Return the functions of signals in the terms."""
    shapes = {v.shape.name: v.shape for v in model.table.functions if v.shape is not None}
    for shape in shapes.values():
        if not shape.source:
            raise ModelError(f"the function {shape.name} is known to Python alone, so that no C source can be written")
    real = f"{name}_real"
    bodies = (
        f"static {real} {name}_{key}({real} x, {real} p, {real} q)\n{{\n    (void)p, (void)q;\n"
        f"    return ({real})({shape.source});\n}}\n"
        for key, shape in shapes.items()
    )
    return ("#include <math.h>\n" if shapes else "") + "\n".join(bodies)
