"""From six recordings to twelve models, and to those of the same actuators with less physics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from deatwin.ident.narx import Fixed, Frols, NarxModel, SvbNarx
from deatwin.ident.narx.identifier import NarxIdentifier
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.terms import Lags, Rule
from deatwin.ident.narx.validate import Validation, validate
from deatwin.ident.parallel import run_jobs
from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording
from deatwin.scenarios.fleet_models.estimators import Estimated, estimate_all
from deatwin.scenarios.fleet_models.preparation import (
    FACTORS,
    RULE,
    Plan,
    Prepared,
    make_plan,
    order_errors,
    prepare,
)
from deatwin.scenarios.fleet_models.variants import RECORDED, VARIANTS
from deatwin.scenarios.voice import Progress

__all__ = ["FREE", "FRO", "LINEAR", "METHODS", "SEMP", "SVB", "Bench", "Identified", "Study", "carry_out", "identify"]

SEMP, SVB, FRO, LINEAR, FREE = "SEMP", "SVB", "FRO", "linear", "SVB, all products"
METHODS = (SEMP, SVB)
"""Those of the twelve models."""
SHARES = (0.4, 0.5, 0.9)
"""Of all work that are done when the recordings, the orders and the models are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A model, how it was found, and what two sections say of it.

    Parameters
    ----------
    search : NarxIdentifier
        Fitted.
    model : NarxModel
        What came of it.
    training, held_out : Validation
        On the section that it was fitted to, and on the other.
    """

    search: Any
    model: NarxModel
    training: Validation
    held_out: Validation

    @property
    def fit(self) -> float:
        """Of the free run over the held-out section, %; minus infinity where it diverges."""
        return float(self.held_out.free_run.percent[0])

    @property
    def passed(self) -> int:
        """How many of the five correlation tests pass on the held-out section."""
        return len(self.held_out.tests) - len(self.held_out.failed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """An actuator, or the same with less physics, and its models.

    Parameters
    ----------
    name : str
        Of the actuator.
    variant : str
        One of `VARIANTS`.
    sections : tuple of Recording
        Training and held-out.
    models : mapping of str to Identified
        By method.
    estimated : tuple of Estimated
        The structure of SEMP with each estimator; empty for the variants.
    """

    name: str
    variant: str
    sections: tuple[Recording, Recording]
    models: Mapping[str, Identified]
    estimated: tuple[Estimated, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All of it.

    Parameters
    ----------
    prepared : tuple of Prepared
        The six.
    plan : Plan
        Sampling time, lags and degree.
    benches : mapping of str to tuple of Bench
        For each of `VARIANTS` the six.
    """

    prepared: tuple[Prepared, ...]
    plan: Plan
    benches: Mapping[str, tuple[Bench, ...]]

    @property
    def recorded(self) -> tuple[Bench, ...]:
        """The six as they are."""
        return self.benches[RECORDED]


def carry_out(seed: int, *, jobs: int, progress: Progress) -> Study:
    """Record, prepare, identify and validate.

    Parameters
    ----------
    seed : int
        Of the fleet.
    jobs : int
        Worker processes; -1 takes all cores.
    progress : callable
        Takes the share that is done and what is being done.

    Returns
    -------
    Study

    Raises
    ------
    SimulationError
        If a film pulls in.
    """
    recorded, ordered, done = SHARES
    prepared = _all(prepare, [(one,) for one in fleet(seed)], jobs, progress, 0.0, recorded, "recording six actuators")
    sections = [(one.split(RECORDED, factor)[0],) for factor in FACTORS for one in prepared]
    errors = _all(order_errors, sections, jobs, progress, recorded, ordered, "choosing sampling time and orders")
    n = len(prepared)
    plan = make_plan({factor: errors[i * n : (i + 1) * n] for i, factor in enumerate(FACTORS)})
    tasks = [(one.name, variant, one.split(variant, plan.factor), plan) for variant in VARIANTS for one in prepared]
    found = _all(identify, tasks, jobs, progress, ordered, done, "choosing terms")
    benches = {variant: tuple(found[i * n : (i + 1) * n]) for i, variant in enumerate(VARIANTS)}
    return Study(prepared=tuple(prepared), plan=plan, benches=benches)


def identify(name: str, variant: str, sections: tuple[Recording, Recording], plan: Plan) -> Bench:
    """Identify an actuator by each method.

    Parameters
    ----------
    name : str
        Of the actuator.
    variant : str
        One of `VARIANTS`.
    sections : tuple of Recording
        Training and held-out.
    plan : Plan
        Lags and degree.

    Returns
    -------
    Bench
        Of the recording as it is with estimators, with FRO as long as SEMP, and with SVB on all products.
    """
    models = {method: _identified(search, sections) for method, search in _searches(plan).items()}
    if variant != RECORDED:
        return Bench(name=name, variant=variant, sections=sections, models=models)
    terms = models[SEMP].model.terms
    more: dict[str, NarxIdentifier] = {
        FRO: Frols(**_candidates(plan), max_terms=len(terms), criterion="none"),
        FREE: SvbNarx(**{**_candidates(plan), "rule": None}, clean_up="none"),
    }
    models |= {method: _identified(search, sections) for method, search in more.items()}
    return Bench(
        name=name, variant=variant, sections=sections, models=models, estimated=estimate_all(terms, *sections)
    )


def _searches(plan: Plan) -> dict[str, NarxIdentifier]:
    candidates = _candidates(plan)
    return {
        LINEAR: Frols(**{**candidates, "degree": 1}, max_terms=1 + plan.output_lags + len(plan.input_lags),
                      criterion="none"),
        SEMP: Semp(**candidates),
        SVB: SvbNarx(**candidates, clean_up="none"),
    }


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
    function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]], jobs: int, progress: Progress,
    first: float, last: float, doing: str,
) -> list[Any]:  # fmt: skip
    """Run jobs, telling what share of all work they are."""
    every = list(tasks)
    progress(first, doing)
    return run_jobs(
        function, every, workers=jobs, finished=lambda n: progress(first + (last - first) * n / len(every), doing)
    )
