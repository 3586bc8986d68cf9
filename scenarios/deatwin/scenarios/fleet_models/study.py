"""Identify models from six recordings, and from those of the same actuators with less physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from deatwin.ident.narx import Fixed, Frols, NarxIdentifier, NarxModel, Semp, SvbNarx, Validation, validate
from deatwin.ident.narx.fleet import RECORDED, RULE, VARIANTS, Plan, Prepared, prepare_fleet
from deatwin.plant import Recording
from deatwin.studies.parallel import between, run_told
from deatwin.studies.report.drawing import key_of
from deatwin.studies.report.story import StoryPage, finish
from deatwin.studies.stories import Setting
from deatwin.studies.voice import Progress

SEMP, SVB, FROLS, LINEAR, FREE = "SEMP", "SVB", "FROLS", "linear", "SVB, all products"
SHOWN = 5  # Number of the actuator whose model the thesis shows in full
THRESHOLDS = (1e-2, 1e-3, 1e-4, 1e-5)  # Error reduction ratios below which a term is no longer added


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Methods that identify the actuators; a linear model with the same lags is always added."""

    methods: tuple[str, ...]
    beside: tuple[str, ...]  # Only on the actuators as recorded


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A model with its search, and its results on two sections."""

    search: Any  # None for terms that were given
    model: NarxModel
    training: Validation
    held_out: Validation

    @classmethod
    def of(cls, search: Any, model: NarxModel, sections: tuple[Recording, Recording]) -> Identified:
        """Validate a model on both sections."""
        training, held_out = (validate(model, section) for section in sections)
        return cls(search=search, model=model, training=training, held_out=held_out)

    @property
    def fit(self) -> float:
        """Fit of the free run over the held-out section, %; minus infinity if it diverges."""
        return float(self.held_out.free_run.percent[0])

    @property
    def error(self) -> float:
        """Error of the free run over the held-out section, rms, m; infinite if it diverges."""
        return math.inf if self.held_out.diverged else float(self.held_out.free_run.rms[0])

    @property
    def passed(self) -> int:
        """Number of the five correlation tests that pass on the held-out section."""
        return len(self.held_out.tests) - len(self.held_out.failed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """An actuator, possibly with less physics, and its models."""

    name: str
    sections: tuple[Recording, Recording]  # Training and held-out
    models: Mapping[str, Identified]


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """All records and models."""

    prepared: tuple[Prepared, ...]
    plan: Plan
    benches: Mapping[str, tuple[Bench, ...]]  # By variant
    methods: tuple[str, ...]

    @property
    def sample_time(self) -> float:
        """Sample time of the recordings, s."""
        return self.prepared[0].recordings[RECORDED].sample_time

    @property
    def recorded(self) -> tuple[Bench, ...]:
        """The six as they are."""
        return self.benches[RECORDED]

    @property
    def shown(self) -> Bench:
        """The actuator that is shown in full."""
        return self.recorded[SHOWN - 1]

    def models(self, variant: str) -> list[Identified]:
        """Models of the six by the programme's methods."""
        return [bench.models[method] for bench in self.benches[variant] for method in self.methods]


def carry_out(seed: int, programme: Programme, *, jobs: int, progress: Progress) -> Study:
    """Record, prepare, identify and validate."""
    prepared, plan = prepare_fleet(seed, jobs=jobs, progress=between(progress, 0.0, 0.5))
    tasks = [(one.name, v, one.split(v, plan.factor), plan, programme) for v in VARIANTS for one in prepared]
    found = run_told(identify, tasks, jobs, between(progress, 0.5, 0.9), "choosing terms")
    n = len(prepared)
    benches = {variant: tuple(found[i * n : (i + 1) * n]) for i, variant in enumerate(VARIANTS)}
    return Study(prepared=prepared, plan=plan, benches=benches, methods=programme.methods)


def identify(name: str, variant: str, sections: tuple[Recording, Recording], plan: Plan, programme: Programme) -> Bench:
    """Identify an actuator by each method."""
    beside = programme.beside if variant == RECORDED else ()
    models: dict[str, Identified] = {}
    for method in (LINEAR, *programme.methods, *beside):
        models[method] = _identified(_search(method, plan, models), sections)
    return Bench(name=name, sections=sections, models=models)


def candidates(plan: Plan) -> dict[str, Any]:
    """Arguments of a search among the candidates of the plan."""
    return {"output_lags": plan.output_lags, "input_lags": plan.input_lags, "degree": plan.degree, "rule": RULE}


def save(setting: Setting, record: Any, page: StoryPage, study: Study, method: str) -> Mapping[str, Any]:
    """Write the models of a method, the page, and the validation of all models as plain data."""
    for bench in study.recorded:
        name = f"models/{key_of(bench.name).lower()}_{method.lower()}.json"
        setting.folder.save(name, bench.models[method].model.save)
    models = [
        {
            "actuator": bench.name,
            "recording": variant,
            "method": method,
            "terms": [str(term) for term in found.model.terms],
            "theta": found.model.theta.tolist(),
            "validation": found.held_out.to_json(),
        }
        for variant, benches in study.benches.items()
        for bench in benches
        for method, found in bench.models.items()
    ]
    return finish(setting.folder, record, page, models=models)


def _search(method: str, plan: Plan, found: Mapping[str, Identified]) -> NarxIdentifier:
    """Run the search for a structure; FROLS stops at as many terms as SEMP has."""
    among = candidates(plan)
    if method == LINEAR:
        lagged = 1 + plan.output_lags + len(plan.input_lags)
        return Frols(**{**among, "degree": 1}, max_terms=lagged, criterion="none")
    if method == SEMP:
        return Semp(**among)
    if method == FROLS:
        return Frols(**among, max_terms=len(found[SEMP].model.terms), criterion="none")
    return SvbNarx(**{**among, "rule": RULE if method == SVB else None}, clean_up="none")


def _identified(search: NarxIdentifier, sections: tuple[Recording, Recording]) -> Identified:
    model = search.fit(sections[0]).model_
    if isinstance(search, Semp):
        # The search may end at a model that a test calls as good as the best on its way: here the best is taken.
        best = min(search.path_, key=lambda step: step.msse)
        model = Fixed(terms=best.terms).fit(sections[0]).model_
    return Identified.of(search, model, sections)
