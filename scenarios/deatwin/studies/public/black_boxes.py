"""Black-box methods, each a function from a data set to a model, with their errors; and estimators of other packages."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Self

import numpy as np

from deatwin.ident.narx import NarxIdentifier
from deatwin.ident.narx.frols import Frols
from deatwin.ident.narx.grow import Grow
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.linear import Arx, LinearModel, OutputError
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.refine import refine
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.svb import SvbNarx
from deatwin.ident.nss import NonlinearStateSpace, StateSpaceIdentifier
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording
from deatwin.plant.records import finite
from deatwin.studies.public.records import Candidates, DataSet, Learner

SYSIDENTPY, FASTCAN = "SysIdentPy, FROLS", "fastcan, multi-step"


@dataclass(kw_only=True)
class SysIdentPy:
    """SysIdentPy's forward regression, as its examples call it."""

    lags: int
    degree: int
    terms: int  # Largest number of terms
    tolerance: float | None = None  # Sum of the error reduction ratios that ends the search
    model_: NarxModel = field(init=False)

    def fit(self, recordings: Recording, /) -> Self:
        """Learn, and keep the model."""
        selection, basis, estimation = _installed(
            "sysidentpy", "model_structure_selection", "basis_function", "parameter_estimation"
        )
        peer = selection.FROLS(
            ylag=self.lags,
            xlag=self.lags,
            n_terms=self.terms,
            err_tol=self.tolerance,
            order_selection=False,
            basis_function=basis.Polynomial(degree=self.degree),
            estimator=estimation.LeastSquares(),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about dependent regressors; the model's error shows them
            peer.fit(X=recordings.inputs[0][:, None].copy(), y=recordings.outputs[0][:, None].copy())
        self.model_ = _model(recordings, map(_product, peer.final_model), peer.theta.ravel())
        return self


@dataclass(kw_only=True)
class Fastcan:
    """fastcan's selection by canonical correlation, then the free-run fit, as in its multi-step example."""

    lags: int
    degree: int
    terms: int
    model_: NarxModel = field(init=False)

    def fit(self, recordings: Recording, /) -> Self:
        """Learn, and keep the model."""
        (narx,) = _installed("fastcan", "narx")
        u, y = recordings.inputs[0][:, None].copy(), recordings.outputs[0].copy()
        peer = narx.make_narx(
            X=u,
            y=y,
            n_terms_to_select=self.terms,
            max_delay=self.lags,
            poly_degree=self.degree,
            verbose=0,
            refine_verbose=0,
        ).fit(u, y, coef_init="one_step_ahead")
        terms = (
            "".join(f"{'uy'[signal]}(k-{delay})" for signal, delay in zip(signals, delays, strict=True) if signal >= 0)
            for signals, delays in zip(peer.feat_ids_, peer.delay_ids_, strict=True)
        )
        theta = np.concatenate([np.ravel(peer.coef_), np.ravel(peer.intercept_)])
        self.model_ = _model(recordings, [*terms, "1"], theta)
        return self


def like_ours(candidates: Candidates) -> dict[str, Learner]:
    """Return estimators of other packages with the same lags, terms and degrees."""
    like = {"lags": candidates.output_lags, "degree": candidates.degree, "terms": candidates.max_terms}
    return {SYSIDENTPY: SysIdentPy(**like), FASTCAN: Fastcan(**like)}


def _installed(package: str, *modules: str) -> list[Any]:
    """Import modules of a package, or say that it is missing."""
    try:
        return [import_module(f"{package}.{module}") for module in modules]
    except ImportError:
        raise ModelError("not installed (extra compare)") from None


def _product(codes: Iterable[int]) -> str:
    """Convert a regressor of SysIdentPy, whose codes are 1000 times the signal (output first) plus the lag."""
    return "".join(f"{'y' if code // 1000 == 1 else 'u'}(k-{code % 1000})" for code in codes if code) or "1"


def _model(recording: Recording, terms: Iterable[str], theta: Any) -> NarxModel:
    """Return the polynomial as a NarxModel."""
    return NarxModel.from_terms(
        dict(zip(terms, theta.tolist(), strict=True)),
        sample_time=recording.sample_time,
        input_units=recording.input_units,
        output_units=recording.output_units,
    )


Model = NarxModel | LinearModel | NonlinearStateSpace

LINEAR, FROLS, SEMP, REFINED, GROWN = (
    "output error, linear",
    "FROLS",
    "SEMP",
    "NARX by FROLS, refitted to the free run",
    "NARX built by Grow",
)


def _arx(data: DataSet) -> Model:
    chosen = data.candidates
    return Arx(na=chosen.output_lags, nb=len(chosen.input_lags), nk=chosen.input_lags[0]).fit(data.train).model_


def _output_error(data: DataSet) -> Model:
    chosen = data.candidates
    return OutputError(nf=2, nb=len(chosen.input_lags), nk=chosen.input_lags[0]).fit(data.train).model_


def _narx(data: DataSet, search: Callable[..., NarxIdentifier], **more: Any) -> NarxModel:
    return search(**data.candidates.arguments, **more).fit(data.train).model_


def _fro(data: DataSet) -> NarxModel:
    return _narx(data, Frols, max_terms=data.candidates.max_terms, criterion="none")


METHODS: Mapping[str, Callable[[DataSet], Model]] = {
    "ARX, linear": _arx,
    LINEAR: _output_error,
    FROLS: _fro,
    "LASSO": lambda data: _narx(data, Lasso, max_terms=data.candidates.max_terms),
    SEMP: lambda data: _narx(data, Semp, max_terms=data.candidates.max_terms),
    "SVB": lambda data: _narx(data, SvbNarx, clean_up="none"),  # as published, without a clean-up
    REFINED: lambda data: refine(_fro(data), data.train),
    GROWN: lambda data: _narx(data, Grow, max_terms=data.candidates.max_terms, parts=data.parts),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Result of a method on a data set; errors are root mean squares in the output's unit, NaN without a model."""

    data: str  # Name of the data set
    method: str
    seconds: float  # Time for learning, s
    outputs: Array = field(default_factory=lambda: np.zeros(0))  # shape (n,): Free run over the test recording
    terms: int = 0  # Number of parameters
    one_step: float = np.nan  # One-step error over the test recording
    free_run: float = np.nan  # Free-run error over the test recording
    training: float = np.nan  # Free-run error over the training recording
    failure: str = ""  # Reason why there is no sound free run
    model: Model | None = None
    first_state: Array | None = None  # shape (n_states,): State of a state space at the first training sample

    @property
    def plain(self) -> dict[str, Any]:
        """Return numbers that are equal in every run, and the model in words, for files."""
        shown = ("data", "method", "terms", "one_step", "free_run", "training", "failure")
        model = "" if self.model is None else str(self.model)
        return {**finite({name: getattr(self, name) for name in shown}), "model": model}


def learned(method: str, data: DataSet) -> Outcome:
    """Identify a data set by a method, or by a given estimator."""
    begun = time.perf_counter()
    further, first_state = data.further.get(method), None
    try:
        model = METHODS[method](data) if further is None else further.fit(data.train).model_
    except ModelError as error:
        return Outcome(data=data.name, method=method, seconds=time.perf_counter() - begun, failure=str(error))
    if isinstance(further, StateSpaceIdentifier):
        first_state = further.first_states_[0]
    return Outcome(
        data=data.name,
        method=method,
        terms=model.theta.size,
        seconds=time.perf_counter() - begun,
        model=model,
        first_state=first_state,
    )


def attempt(method: str, data: DataSet) -> Outcome:
    """Let a method learn, and test its model on the test recording."""
    found = learned(method, data)
    if found.model is None:
        return replace(found, outputs=np.full(data.test.n_samples, np.nan))
    run = free(found.model, data.test)
    return replace(
        found,
        one_step=found.model.predict(data.test).rms_error,
        free_run=run.rms_error if run.status.ok else np.nan,
        training=free(found.model, data.train).rms_error,
        outputs=run.outputs[0],
        failure="" if run.status.ok else f"the free run diverges at {run.failed_at_s:.4g} s",
    )


def free(model: Model, recording: Recording, shown: int | None = None, first_state: Array | None = None) -> Any:
    """Simulate from the first lags only; a state space uses the shown samples, or an initial state."""
    if isinstance(model, LinearModel):
        return model.simulate(recording, warmup=model.poles.size)
    if isinstance(model, NarxModel):
        return model.simulate(recording)
    warmup = shown if first_state is None else None
    return model.simulate(recording, warmup=warmup, initial=first_state)
