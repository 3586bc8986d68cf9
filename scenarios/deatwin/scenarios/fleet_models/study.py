"""From six recordings to their models, and to those of the same actuators with less physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from deatwin.ident.narx import Fixed, Frols, NarxModel, SvbNarx
from deatwin.ident.narx.fleet.orders import FACTORS, RULE, Plan, Prepared, make_plan, order_errors, prepare
from deatwin.ident.narx.fleet.records import RECORDED, VARIANTS
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.ident.narx.validate import Validation, validate
from deatwin.ident.parallel import run_jobs
from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording
from deatwin.studies.voice import Progress

SEMP, SVB, FRO, LINEAR, FREE = "SEMP", "SVB", "FRO", "linear", "SVB, all products"
SHARES = (0.4, 0.5, 0.9)
"""Of all work that are done when the recordings, the orders and the models are."""


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Which methods identify the actuators; a linear model of the same lags stands beside them everywhere."""

    methods: tuple[str, ...]
    beside: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A model, how it was found, and what two sections say of it."""

    search: Any
    model: NarxModel  # What came of it
    training: Validation
    held_out: Validation

    @property
    def fit(self) -> float:
        """Of the free run over the held-out section, %; minus infinity where it diverges."""
        return float(self.held_out.free_run.percent[0])

    @property
    def error(self) -> float:
        """Of the free run over the held-out section, rms, m; infinite where it diverges."""
        return math.inf if self.held_out.diverged else float(self.held_out.free_run.rms[0])

    @property
    def passed(self) -> int:
        """How many of the five correlation tests pass on the held-out section."""
        return len(self.held_out.tests) - len(self.held_out.failed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """An actuator, or the same with less physics, and its models."""

    name: str
    variant: str  # One of `VARIANTS`
    sections: tuple[Recording, Recording]  # Training and held-out
    models: Mapping[str, Identified]


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All of it."""

    prepared: tuple[Prepared, ...]  # The six
    plan: Plan  # Sampling time, lags and degree
    benches: Mapping[str, tuple[Bench, ...]]
    methods: tuple[str, ...]

    @property
    def recorded(self) -> tuple[Bench, ...]:
        """The six as they are."""
        return self.benches[RECORDED]

    def models(self, variant: str, methods: Iterable[str] | None = None) -> list[Identified]:
        """Models of the six."""
        wanted = tuple(methods or self.methods)
        return [bench.models[method] for bench in self.benches[variant] for method in wanted]


def carry_out(seed: int, programme: Programme, *, jobs: int, progress: Progress) -> Study:
    """Record, prepare, identify and validate."""
    recorded, ordered, done = SHARES
    prepared = _all(prepare, [(one,) for one in fleet(seed)], jobs, progress, 0.0, recorded, "recording six actuators")
    sections = [(one.split(RECORDED, factor)[0],) for factor in FACTORS for one in prepared]
    errors = _all(order_errors, sections, jobs, progress, recorded, ordered, "choosing sampling time and orders")
    n = len(prepared)
    plan = make_plan({factor: errors[i * n : (i + 1) * n] for i, factor in enumerate(FACTORS)})
    tasks = [
        (one.name, variant, one.split(variant, plan.factor), plan, programme)
        for variant in VARIANTS
        for one in prepared
    ]
    found = _all(identify, tasks, jobs, progress, ordered, done, "choosing terms")
    benches = {variant: tuple(found[i * n : (i + 1) * n]) for i, variant in enumerate(VARIANTS)}
    return Study(prepared=tuple(prepared), plan=plan, benches=benches, methods=programme.methods)


def identify(name: str, variant: str, sections: tuple[Recording, Recording], plan: Plan, programme: Programme) -> Bench:
    """Identify an actuator by each method."""
    beside = programme.beside if variant == RECORDED else ()
    models: dict[str, Identified] = {}
    for method in (LINEAR, *programme.methods, *beside):
        models[method] = _identified(_search(method, plan, models), sections)
    return Bench(name=name, variant=variant, sections=sections, models=models)


def _search(method: str, plan: Plan, found: Mapping[str, Identified]) -> NarxIdentifier:
    """The search for a structure; that of FRO ends with as many terms as SEMP has."""
    candidates = _candidates(plan)
    if method == LINEAR:
        lagged = 1 + plan.output_lags + len(plan.input_lags)
        return Frols(**{**candidates, "degree": 1}, max_terms=lagged, criterion="none")
    if method == SEMP:
        return Semp(**candidates)
    if method == SVB:
        return SvbNarx(**candidates, clean_up="none")
    if method == FRO:
        return Frols(**candidates, max_terms=len(found[SEMP].model.terms), criterion="none")
    return SvbNarx(**{**candidates, "rule": None}, clean_up="none")


def _candidates(plan: Plan) -> dict[str, Any]:
    lags: tuple[Lags, Lags] = plan.output_lags, plan.input_lags
    rule: Rule = RULE
    return {"output_lags": lags[0], "input_lags": lags[1], "degree": plan.degree, "rule": rule}


def _identified(search: NarxIdentifier, sections: tuple[Recording, Recording]) -> Identified:
    model = search.fit(sections[0]).model_
    if isinstance(search, Semp):
        # The search may end at a model that a test calls as good as the best on its way: here the best is taken.
        best = min(search.path_, key=lambda step: step.msse)
        model = Fixed(terms=best.terms).fit(sections[0]).model_
    training, held_out = (validate(model, section) for section in sections)
    return Identified(search=search, model=model, training=training, held_out=held_out)


def _all(
    function: Callable[..., Any],
    tasks: Iterable[tuple[Any, ...]],
    jobs: int,
    progress: Progress,
    first: float,
    last: float,
    doing: str,
) -> list[Any]:
    """Run jobs, telling what share of all work they are."""
    every = list(tasks)
    progress(first, doing)
    return run_jobs(
        function, every, workers=jobs, finished=lambda n: progress(first + (last - first) * n / len(every), doing)
    )
