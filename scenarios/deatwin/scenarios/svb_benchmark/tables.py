"""The tables of the page."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from deatwin.scenarios.svb_benchmark.methods import METHODS
from deatwin.scenarios.svb_benchmark.study import SWEPT, Study
from deatwin.scenarios.svb_benchmark.trials import Rate, Trial, system_of
from deatwin.scenarios.svb_benchmark.verdicts import exact, kept, oracles
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.story import Table


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    made = [_method(study, method) for method in study.plan.methods]
    made.append(_oracles(study))
    if SWEPT in study.plan.systems:
        made += [_chosen(study), _intervals(study)]
    made += [_coverage(study), _sweep(study)]
    if study.comparisons:
        made.append(_sampler(study))
    return [*made, _systems(study)]


def _method(study: Study, method: str) -> Table:
    rows = []
    for system in study.plan.systems:
        trials = study.of(system, method)
        rows.append(
            [
                system,
                str(kept(study, system, method)),
                str(exact(study, system, method)),
                f"{np.mean([t.missed for t in trials]):.2f}",
                f"{np.mean([t.false for t in trials]):.2f}",
                three_digits(float(np.median([t.seconds for t in trials]))),
            ]
        )
    columns = ["system", "every true term kept", "exact structure", "missed", "false", "median processor time (s)"]
    return Table(title=f"{METHODS[method].label}: {METHODS[method].line}", columns=columns, rows=rows)


def _oracles(study: Study) -> Table:
    rows = []
    for system in study.plan.systems:
        cells = [system]
        for oracle in oracles(study, system):
            cells += [str(oracle.kept), str(oracle.exact), three_digits(oracle.threshold)]
        rows.append(cells)
    columns = ["system"]
    for name in ("on all candidates", "from the true terms"):
        columns += [f"{name}: every true term", "exact structure", "best threshold on |t|"]
    return Table(title="Oracles, who know the truth and choose the threshold by it", columns=columns, rows=rows)


def _chosen(study: Study) -> Table:
    """Terms of the first draw of E1, and how often each true one is kept over all."""
    system = system_of(SWEPT)
    first = {method: study.of(SWEPT, method)[0] for method in study.plan.methods}
    true = list(map(str, system.terms))
    false = [term for term in _all_terms(first.values()) if term not in true]
    rows = []
    for term, value in [*zip(true, system.theta, strict=True), *((term, None) for term in false)]:
        cells = [term, "–" if value is None else f"{value:g}"]
        for method, trial in first.items():
            cell = f"{trial.theta[trial.terms.index(term)]:.3f}" if term in trial.terms else "–"
            if value is not None:
                share = Rate.of(term in other.terms for other in study.of(SWEPT, method)).share
                cell += f" ({100 * share:.0f} %)"
            cells.append(cell)
        rows.append(cells)
    return Table(
        title=f"{SWEPT}: parameters of the first draw, and in how many of all draws a true term is kept "
        "(thesis table 6.1)",
        columns=["term", "true", *(METHODS[method].label for method in first)],
        rows=rows,
    )


def _intervals(study: Study) -> Table:
    """Intervals of the first draw of E1 whose structure is right, as far as there is one."""
    system, rows = system_of(SWEPT), []
    for method in study.plan.bayesian:
        right = [trial for trial in study.of(SWEPT, method) if trial.exact]
        if not right:
            continue
        trial = right[0]
        for term, value in zip(map(str, system.terms), system.theta, strict=True):
            at = trial.terms.index(term)
            low, high = trial.low[at], trial.high[at]
            inside = Rate.of(_holds(other, term, value) for other in right)
            rows.append(
                [
                    METHODS[method].label,
                    term,
                    f"{value:g}",
                    f"{trial.theta[at]:.4f}",
                    f"{low:.4f} to {high:.4f}",
                    "yes" if low <= value <= high else "no",
                    str(inside),
                ]
            )
    columns = ["method", "term", "true", "mean", "95 % interval", "holds it", "in all draws with the right structure"]
    return Table(
        title=f"{SWEPT}: intervals of the first draw whose structure is found (thesis table 6.2)",
        columns=columns,
        rows=rows,
    )


def _coverage(study: Study) -> Table:
    rows = []
    for (system, estimator), flags in study.covered.items():
        rate = Rate.of(flags.ravel().tolist())
        rows.append([system, estimator, str(rate.count), str(rate)])
    columns = ["system", "estimator", "parameters", "covered"]
    return Table(title="95 % intervals, given the right structure", columns=columns, rows=rows)


def _sweep(study: Study) -> Table:
    rows = []
    for level in study.levels:
        cells = [f"{level.variance:g}"]
        for method in study.plan.bayesian:
            trials = [trial for trial in level.trials if trial.method == method]
            cells += [str(Rate.of(t.kept for t in trials)), str(Rate.of(t.exact for t in trials))]
        redraws = sum(trial.redraws for trial in trials)
        cells += [str(Rate.of(level.covered.ravel().tolist())), f"{redraws} of {redraws + len(trials)}"]
        rows.append(cells)
    columns = ["variance"]
    for method in study.plan.bayesian:
        columns += [f"{METHODS[method].label}: every true term kept", "exact structure"]
    return Table(
        title=f"{SWEPT} at five noise levels", columns=[*columns, "intervals that cover", "diverged"], rows=rows
    )


def _sampler(study: Study) -> Table:
    rows = [
        [
            str(draw.number + 1),
            "yes" if draw.agrees else "no",
            f"{np.sort(draw.inclusion)[-len(draw.sampled)]:.3f}",
            f"{np.sort(draw.inclusion)[-len(draw.sampled) - 1]:.3f}",
            f"{draw.unsettled:.4f}",
            f"{100 * draw.mass_given.mean():.1f} %",
            f"{100 * draw.mass.mean():.1f} %",
            three_digits(draw.seconds),
            three_digits(draw.sampled_seconds),
        ]
        for draw in study.comparisons
    ]
    columns = [
        "draw",
        "same terms",
        "least likely kept",
        "most likely other",
        "two chains differ by",
        "mass of SVB's intervals, same structure",
        "over all structures",
        "SVB, processor time (s)",
        "one chain, processor time (s)",
    ]
    return Table(title="S4: a spike-and-slab sampler beside SVB", columns=columns, rows=rows)


def _systems(study: Study) -> Table:
    rows = []
    for name in study.plan.systems:
        system, draws = system_of(name), study.contrasts[name]
        redraws = sum(draw.redraws for draw in draws)
        rows.append(
            [
                name,
                str(system.model),
                str(system.n_samples),
                f"{np.median([draw.snr_db for draw in draws]):.1f} dB",
                f"{redraws} of {redraws + len(draws)}",
                f"{np.median([draw.condition for draw in draws]):.1e}",
                system.source,
            ]
        )
    columns = [
        "system",
        "equation",
        "samples",
        "output over noise, median",
        "diverged",
        "condition of the candidates, median",
        "source",
    ]
    return Table(title="Systems", columns=columns, rows=rows)


def _all_terms(trials: Iterable[Trial]) -> list[str]:
    """Return all terms that occur, each once, in order."""
    return list(dict.fromkeys(term for trial in trials for term in trial.terms))


def _holds(trial: Trial, term: str, value: float) -> bool:
    at = trial.terms.index(term)
    return trial.low[at] <= value <= trial.high[at]
