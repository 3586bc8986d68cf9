"""Estimators of other packages; their polynomials are converted to NarxModel, so that all are simulated alike."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Self

import numpy as np

from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording
from deatwin.studies.public.records import Candidates, Learner

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
