"""The tables of the stories, after tables 4.1 to 4.3, 6.4, B.1, D.1 and D.2 of the thesis."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.ident.narx import NarxModel, Term
from deatwin.ident.narx.fleet.orders import Plan
from deatwin.ident.narx.fleet.records import VARIANTS, Prepared
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.scenarios.fleet_models.estimators import Estimated
from deatwin.scenarios.fleet_models.study import FRO, LINEAR, SEMP, SVB, Bench, Identified, Study
from deatwin.scenarios.fleet_models.verdicts import deviations
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import Table

SHOWN = 5
"""Of the actuators, the one whose model the thesis shows in full."""
TESTS = {"ee": "ee", "ue": "ue", "e(eu)": "e(eu)", "(u2)'e": "(u²)′e", "(u2)'e2": "(u²)′e²"}
UNITS = "SI: m, V"


def semp_tables(study: Study, estimated: Sequence[Estimated]) -> list[Table]:
    """Make the tables of chapter 4."""
    shown = study.recorded[SHOWN - 1]
    return [
        _preprocessing(study.prepared, study.plan),
        _validation(study.recorded, (SEMP, FRO, LINEAR)),
        _physics(study),
        _semp(study.recorded),
        _estimators(shown, estimated),
        _without_dc(shown),
    ]


def svb_tables(study: Study) -> list[Table]:
    """Make the tables of chapter 6 and of appendix D."""
    shown = study.recorded[SHOWN - 1]
    others = [bench for bench in study.recorded if bench is not shown]
    return [
        _validation(study.recorded, (*study.methods, LINEAR)),
        _physics(study),
        _svb(f"SVB model of {shown.name} with 95 % intervals (thesis table 6.4)", [shown]),
        _svb("SVB models of the others with 95 % intervals, 1 (thesis table D.1)", others[:3]),
        _svb("SVB models of the others with 95 % intervals, 2 (thesis table D.2)", others[3:]),
    ]


def _preprocessing(prepared: Sequence[Prepared], plan: Plan) -> Table:
    rows = []
    for one in prepared:
        training, held_out = one.split(VARIANTS[0], plan.factor)
        sampling = one.sampling
        minimum = "none" if sampling.first_minimum is None else f"{sampling.first_minimum * sampling.sample_time:.2f} s"
        rows.append(
            [
                one.name,
                f"{training.start:.0f} to {training.end:.0f} s, {training.n_samples}",
                f"{held_out.start:.0f} to {held_out.end:.0f} s, {held_out.n_samples}",
                quantity(training.sample_time, "s"),
                f"{minimum}; {quantity(sampling.factor * sampling.sample_time, 's')}",
                "; ".join(finding.text for finding in one.findings) or "nothing",
            ]
        )
    return Table(
        title="Preprocessing (thesis table B.1)",
        columns=[
            "actuator",
            "training, samples",
            "held out, samples",
            "sampling time taken",
            "first minimum of the correlations; sampling time for 15 samples to it",
            "named in the reading at the same input, and left as it is",
        ],
        rows=rows,
    )


def _validation(benches: Sequence[Bench], methods: Sequence[str]) -> Table:
    rows = []
    for bench in benches:
        for method in methods:
            one = bench.models[method]
            rows.append(
                [bench.name, method, str(len(one.model.terms)), *_fits(one), *(_verdict(one, name) for name in TESTS)]
            )
    return Table(
        title="Validation of the models on the held-out sections",
        columns=[
            "actuator",
            "method",
            "terms",
            "one-step error",
            "free-run fit, training",
            "free-run fit, held out",
            "free-run error, held out",
            *(f"φ {text}" for text in TESTS.values()),
        ],
        rows=rows,
    )


def _fits(one: Identified) -> list[str]:
    held_out = one.held_out
    free = "diverges" if held_out.diverged else f"{float(held_out.free_run.percent[0]):.1f} %"
    error = "–" if held_out.diverged else _micro(float(held_out.free_run.rms[0]))
    training = "diverges" if one.training.diverged else f"{float(one.training.free_run.percent[0]):.1f} %"
    return [_micro(float(held_out.one_step.rms[0])), training, free, error]


def _micro(metres: float) -> str:
    return f"{1e6 * metres:.1f} µm"


def _verdict(one: Identified, name: str) -> str:
    """Whether a test passes; where it does not, how far out the largest correlation is."""
    test = one.held_out.test(name)
    if test not in one.held_out.failed:
        return "passes"
    return f"fails, {abs(test.largest) / test.band:.1f} bands"


def _physics(study: Study) -> Table:
    """Fit and tests with less and less physics in the actuators."""
    rows = []
    for number, one in enumerate(study.prepared):
        for method in study.methods:
            cells = []
            for variant in VARIANTS:
                found = study.benches[variant][number].models[method]
                fit = "diverges" if found.held_out.diverged else f"{found.fit:.1f} %"
                cells.append(f"{fit}, {found.passed} of {len(found.held_out.tests)}")
            rows.append([one.name, method, *cells, one.actuator.story])
    columns = ["actuator", "method", *(f"{variant}: fit, tests passed" for variant in VARIANTS), "history"]
    return Table(title="What drift and hysteresis cost, on the held-out sections", columns=columns, rows=rows)


def _semp(benches: Sequence[Bench]) -> Table:
    rows = []
    for bench in benches:
        model = bench.models[SEMP].model
        for number, (term, value, (low, high)) in enumerate(_parameters(model)):
            rows.append([bench.name if number == 0 else "", str(term), value, f"{low} to {high}"])
    return Table(
        title="Models by SEMP (thesis table 4.1)",
        columns=["actuator", "term", f"parameter ({UNITS})", "95 % interval of least squares, were the residual white"],
        rows=rows,
    )


def _svb(title: str, benches: Sequence[Bench]) -> Table:
    rows = []
    for bench in benches:
        for number, (term, value, (low, high)) in enumerate(_parameters(bench.models[SVB].model)):
            rows.append([bench.name if number == 0 else "", str(term), value, low, high])
    return Table(title=title, columns=["actuator", "term", f"mean ({UNITS})", "from", "to"], rows=rows)


def _parameters(model: NarxModel) -> list[tuple[Term, str, tuple[str, str]]]:
    low, high = ThetaPosterior(model=model).interval().T
    return [
        (term, f"{value:.4g}", (f"{a:.4g}", f"{b:.4g}"))
        for term, value, a, b in zip(model.terms, model.theta, low, high, strict=True)
    ]


def _estimators(bench: Bench, estimated: Sequence[Estimated]) -> Table:
    """The same terms, estimated in several ways, and what the free run and the tests make of it."""
    terms = bench.models[SEMP].model.terms
    noise = sorted({t for e in estimated for t in e.model.terms} - set(terms), key=str)
    rows = []
    for term in (*terms, *noise):
        rows.append([str(term), *(_estimate(e.model, term) for e in estimated)])
    for label, section in (("training", "training"), ("held out", "held_out")):
        found = [getattr(e, section) for e in estimated]
        rows.append([f"one-step error, {label}", *(_micro(float(v.one_step.rms[0])) for v in found)])
        free = ["diverges" if v.diverged else f"{float(v.free_run.percent[0]):.1f} %" for v in found]
        rows.append([f"free-run fit, {label}", *free])
    for name, text in TESTS.items():
        cells = ["passes" if e.held_out.test(name) not in e.held_out.failed else "fails" for e in estimated]
        rows.append([f"φ {text}, held out", *cells])
    return Table(
        title=f"Estimators of one structure, the SEMP model of {bench.name} (thesis table 4.2)",
        columns=[f"term ({UNITS})", *(e.name for e in estimated)],
        rows=rows,
    )


def _estimate(model: NarxModel, term: Term) -> str:
    if term not in model.terms:
        return "–"
    place = model.terms.index(term)
    return f"{model.theta[place]:.4g} ± {model.theta_cov[place, place] ** 0.5:.1g}"


def _without_dc(bench: Bench) -> Table:
    model = bench.models[SEMP].model
    shifted, moved = deviations(model, bench.sections[0])
    before, after = (dict(zip(m.terms, m.theta, strict=True)) for m in (model, shifted))
    every = sorted({*before, *after}, key=lambda term: (term.degree, term.factors))
    rows = [
        [str(term), *(f"{values[term]:.4g}" if term in values else "–" for values in (before, after))] for term in every
    ]
    level = float(bench.sections[0].inputs[0, 0] - moved.inputs[0, 0])
    rest = float(bench.sections[0].outputs[0, 0] - moved.outputs[0, 0])
    return Table(
        title=f"Removal of the DC component, the SEMP model of {bench.name} (thesis table 4.3)",
        columns=["term", f"parameter ({UNITS})", f"of deviations from {level:.3f} V and {1e3 * rest:.3f} mm"],
        rows=rows,
    )
