"""The stated measures: what is demanded of the models, what they reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from deatwin.ident.frequency import equilibrium, remove_dc
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet.records import FILM, STEADY
from deatwin.ident.narx.predictive import one_step_band
from deatwin.plant.recording import Recording
from deatwin.scenarios.fleet_models.study import FRO, LINEAR, SEMP, SVB, Bench, Study
from deatwin.studies.report.story import Row

HALF = 0.5
"""Of the linear model's error: what a nonlinear one has to be better than."""
AS_GOOD = 1.1
"""Times the error of SEMP, that of SVB."""
RISE = 1e-9
"""Share of itself by which a lower bound may seem to fall, by rounding."""


def judge_semp(study: Study) -> list[Row]:
    """Hold the models of SEMP against what is demanded."""
    return [*_of_method(study, SEMP), _against_fro(study.recorded), _dc(study.recorded)]


def judge_svb(study: Study) -> list[Row]:
    """Hold the models of SVB, and their posteriors, against what is demanded."""
    return [*_of_method(study, SVB), _against_semp(study.recorded), _bounds(study.recorded), _band(study)]


def _of_method(study: Study, method: str) -> list[Row]:
    recorded = study.recorded
    return [
        _sound(recorded, method),
        _beats_linear(recorded, method),
        _tests(recorded, method),
        _history(study, method),
        _hysteresis(study, method),
    ]


def _sound(benches: Iterable[Bench], method: str) -> Row:
    status = [not bench.models[method].held_out.diverged for bench in benches]
    return Row(
        measure=f"{method}: free runs over the held-out sections that stay finite",
        demanded="6 of 6",
        reached=f"{sum(status)} of {len(status)}",
        passed=all(status),
    )


def _beats_linear(benches: Iterable[Bench], method: str) -> Row:
    shares, fits = [], []
    for bench in benches:
        linear, own = (float(bench.models[m].held_out.free_run.nrmse[0]) for m in (LINEAR, method))
        shares.append(own / linear)
        fits.append(bench.models[method].fit)
    return Row(
        measure=f"{method}: free-run error over the held-out section, over that of the linear model of the same lags",
        demanded=f"below {HALF:g} for each of the six",
        reached=f"{_range(shares, '.2f')}, fits of {_range(fits, '.1f')} %",
        passed=max(shares) < HALF,
    )


def _tests(benches: Iterable[Bench], method: str) -> Row:
    found = [bench.models[method] for bench in benches]
    whole = [one.passed == len(one.held_out.tests) for one in found]
    total = sum(len(one.held_out.tests) for one in found)
    return Row(
        measure=f"{method}: correlation tests of the one-step residual over the held-out sections",
        demanded="all five pass, for each of the six",
        reached=f"{sum(one.passed for one in found)} of {total} tests pass, all five of {sum(whole)} models",
        passed=all(whole),
    )


def _history(study: Study, method: str) -> Row:
    gains = [
        (without.name, without.models[method].fit - bench.models[method].fit)
        for bench, without in zip(study.recorded, study.benches[STEADY], strict=True)
    ]
    drifting = [gain for name, gain in gains if name != "DEA 6"]
    shown = ", ".join(f"{gain:+.1f}" for _, gain in gains)
    return Row(
        measure=f"{method}: held-out fit of the same actuators without histories, less that with them, DEA 1 to 6",
        demanded="median above 0 of DEA 1 to 5, which drift within their sections",
        reached=f"{shown} %",
        passed=float(np.median(drifting)) > 0,
    )


def _hysteresis(study: Study, method: str) -> Row:
    losses = [
        bench.models[method].error / film.models[method].error
        for bench, film in zip(study.benches[STEADY], study.benches[FILM], strict=True)
    ]
    return Row(
        measure=f"{method}: free-run error of the same actuators with hysteresis alone, over that with the bare film",
        demanded="median above 1: no polynomial of a few past values holds it",
        reached=f"{_range(losses, '.2f')}, median {np.median(losses):.2f}",
        passed=float(np.median(losses)) > 1,
    )


def _against_fro(benches: Iterable[Bench]) -> Row:
    pairs = [
        (float(bench.models[SEMP].training.free_run.rms[0]), float(bench.models[FRO].training.free_run.rms[0]))
        for bench in benches
    ]
    shown = ", ".join(f"{1e6 * own:.1f} and {1e6 * other:.1f}" for own, other in pairs)
    return Row(
        measure="free-run error over the training section, SEMP and FRO with as many terms, DEA 1 to 6",
        demanded="SEMP's below FRO's in most: it is what SEMP lowers step by step",
        reached=f"{shown} µm",
        passed=sum(own < other for own, other in pairs) > len(pairs) / 2,
    )


def _against_semp(benches: Iterable[Bench]) -> Row:
    shares = [bench.models[SVB].error / bench.models[SEMP].error for bench in benches]
    return Row(
        measure="SVB: free-run error over the held-out section, over that of SEMP, DEA 1 to 6",
        demanded=f"median at most {AS_GOOD:g}: as good without ever having run free",
        reached=f"{', '.join(f'{share:.2f}' for share in shares)}; median {np.median(shares):.2f}",
        passed=float(np.median(shares)) <= AS_GOOD,
    )


def _band(study: Study) -> Row:
    shares = [
        100 * float(one_step_band(bench.models[SVB].model, bench.sections[1]).coverage[0])
        for bench in study.benches[FILM]
    ]
    return Row(
        measure="SVB: readings of the bare film's held-out sections within the one-step 95 % band",
        demanded="median from 90 to 99 %: posterior and noise say how far off the next reading is",
        reached=f"{_range(shares, '.1f')} %, median {np.median(shares):.1f} %",
        passed=90 <= float(np.median(shares)) <= 99,
    )


def _bounds(benches: Iterable[Bench]) -> Row:
    falls = [
        max(float(np.max(-np.diff(step.bounds), initial=0.0)) / abs(step.lower_bound) for step in search.path_)
        for search in (bench.models[SVB].search for bench in benches)
    ]
    return Row(
        measure="SVB: largest fall of the lower bound during an update, over the bound",
        demanded=f"none beyond rounding, {RISE:g}",
        reached=f"{max(falls):.1e}",
        passed=max(falls) <= RISE,
    )


def _dc(benches: Iterable[Bench]) -> Row:
    worst = 0.0
    for bench in benches:
        model, section = bench.models[SEMP].model, bench.sections[1]
        shifted, moved = deviations(model, section)
        whole, part = model.simulate(section), shifted.simulate(moved)
        if whole.status.ok:
            size = float(np.ptp(whole.outputs))
            level = float(section.outputs[0, 0] - moved.outputs[0, 0])
            worst = max(worst, float(np.abs(part.outputs + level - whole.outputs).max()) / size)
    return Row(
        measure="free run of the model of deviations, put back on its operating point, less that of the model itself",
        demanded="below 1e-9 of the stroke, for the six SEMP models",
        reached=f"{worst:.0e}",
        passed=worst < 1e-9,
    )


def deviations(model: NarxModel, section: Recording) -> tuple[NarxModel, Recording]:
    """The model without its DC component, and the recording seen from the same operating point."""
    point = equilibrium(model)
    moved = replace(
        section, inputs=section.inputs - point.operating_input[:, None], outputs=section.outputs - point.output
    )
    return remove_dc(model), moved


def _range(values: Iterable[float], form: str) -> str:
    every = list(values)
    return f"{min(every):{form}} to {max(every):{form}}"
