"""Follow the LASSO's path of structures, refit each by least squares, and judge it by its free run on held-out
samples.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, whole_number
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.forward import free_run_errors, split
from deatwin.ident.narx.identifier import CandidateSearch, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_KNOTS = 10  # knots of the path, times max_terms: terms also leave the path, so it has more knots than terms
_SAMPLES = 4096  # samples standardised at once


@dataclass(frozen=True, kw_only=True, eq=False)
class LassoPath(Described):
    """Knots of the LASSO's path, at which terms enter or leave."""

    terms: tuple[Term, ...]  # Candidates that take part; the constant does not, because it is not penalised
    penalties: Array = field(metadata=coordinate("knot", name="penalty"))
    coefficients: Array = field(
        metadata=variable("term", "knot", name="coefficient", about="for standardised regressors and output")
    )
    errors: Array = field(
        metadata=variable("knot", name="error", about="RMS of the free run over held-out samples, in the output's unit")
    )
    chosen: int = field(metadata=attribute())  # Position of the model's knot

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "term": coordinate("term", of=lambda found: [str(term) for term in found.terms]),
    }

    def plot(self, ax: Axes | None = None, *, most: int = 10) -> Axes:
        """Draw the coefficients over the penalty, with the chosen knot."""
        axes = axes_or_new(ax)
        held = self.coefficients[:, self.chosen]
        named = [i for i in np.argsort(-np.abs(held), kind="stable")[:most] if held[i]]
        for i in np.flatnonzero(self.coefficients.any(axis=1)):
            if i not in named:
                axes.plot(self.penalties, self.coefficients[i], color="0.8", linewidth=0.7)
        for i in named:
            axes.plot(self.penalties, self.coefficients[i], label=str(self.terms[i]))
        axes.axvline(self.penalties[self.chosen], color="black", linestyle=":")
        axes.set_xscale("log")
        axes.invert_xaxis()
        axes.set(xlabel="penalty", ylabel="standardised coefficient")
        if named:
            axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
        return axes


@dataclass(kw_only=True, eq=False, repr=False)
class Lasso(CandidateSearch):
    """Choose the terms of a NARX model by the LASSO and by the free-run error on held-out samples.

    Each recording is split into a beginning and a held-out end. On the beginnings, the regressors are standardised, and
    the LASSO path is computed from the largest penalty down (least angle regression). Each set of terms on the path,
    with and without a constant term, is refitted by least squares, which removes the bias of the penalty. The set with
    the smallest mean squared free-run error on the ends is chosen. Its parameters are then estimated on all samples.

    If regressors are correlated, false terms may enter the path before all true terms have entered. The set of true
    terms is then not on the path.

    Parameters
    ----------
    output_lags, input_lags, degree, functions, rule
        Candidate terms, as in `Frols`.
    max_terms : int
        Largest number of terms of a model.
    held_out : float
        Share of each recording, at its end, on which the models are compared.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units. ``theta_cov`` is ``sigma^2 (P'P)^-1`` with the residual variance
        sigma^2 and the regressors P.
    terms_ : tuple of Term
        Terms of the model.
    path_ : LassoPath
        LASSO path, with the rms free-run error on held-out samples at each knot. A term enters or leaves the path at a
        knot.

    References
    ----------
    Tibshirani, "Regression shrinkage and selection via the lasso", J. R. Stat. Soc. B 58 (1996) 267-288,
    doi:10.1111/j.2517-6161.1996.tb02080.x.
    Efron, Hastie, Johnstone, Tibshirani, "Least angle regression", Ann. Statist. 32 (2004) 407-499,
    doi:10.1214/009053604000000067.
    """

    max_terms: int = 30
    held_out: float = 0.3

    def _check(self) -> None:
        whole_number(self.max_terms, "max_terms")
        probability(self.held_out, "held_out")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        beginnings, held_out = split(data.recordings, self.held_out, data.first)
        training = replace(data, recordings=beginnings)
        training.require_samples_for(self.max_terms)
        rows, target = training.matrix()
        constant = next((i for i, term in enumerate(data.table.terms) if term.degree == 0), None)
        taking_part, penalties, coefficients = lasso_path(
            rows, target, centred=constant is not None, max_knots=_KNOTS * self.max_terms
        )
        errors, chosen = np.full(penalties.size, np.inf), (-1, [0])
        with self._keeping(lambda: chosen[0] >= 0):
            for knot in range(penalties.size):
                support = [int(i) for i in taking_part[coefficients[:, knot] != 0]]
                for structure in self._structures(support, constant):
                    error = _error(training.only(structure), rows[structure], target, held_out)
                    if chosen[0] < 0 or error < errors.min():
                        chosen = (knot, structure)
                    errors[knot] = min(errors[knot], error)
                progress((knot + 1) / penalties.size, f"knot {knot + 1}, {len(support)} terms")
        self.path_ = LassoPath(
            terms=tuple(data.table.terms[i] for i in taking_part),
            penalties=penalties,
            coefficients=coefficients,
            errors=np.sqrt(errors) * data.output_scale,
            chosen=max(chosen[0], 0),
        )
        kept = data.only(chosen[1])
        self.terms_ = kept.table.terms
        found = least_squares(*kept.matrix())
        return kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)

    def _structures(self, support: list[int], constant: int | None) -> Iterator[list[int]]:
        """Yield the structures to judge at a knot: its terms, without and with the constant."""
        if 0 < len(support) <= self.max_terms:
            yield support
        if constant is not None and len(support) < self.max_terms:
            yield [constant, *support]


def lasso_path(rows: Array, target: Array, *, centred: bool, max_knots: int) -> tuple[NDArray[np.intp], Array, Array]:
    """Follow the LASSO's path on standardised regressors. Shapes: `rows` (n_candidates, n_samples)."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import lars_path_gram

    n = target.size
    means = rows.mean(axis=1) if centred else np.zeros(len(rows))
    mean = float(target.mean()) if centred else 0.0
    sizes = np.sqrt(np.maximum(np.einsum("ij,ij->i", rows, rows) / n - means**2, 0.0))
    taking_part = np.flatnonzero(sizes > np.sqrt(np.finfo(float).eps) * np.abs(means))
    size = float(np.sqrt(np.mean((target - mean) ** 2)))
    if taking_part.size == 0 or size == 0:
        raise ModelError("neither a regressor nor the output may be constant: there is nothing to select")
    gram, moment = np.zeros((taking_part.size, taking_part.size)), np.zeros(taking_part.size)
    for start in range(0, n, _SAMPLES):
        part = slice(start, start + _SAMPLES)
        standard = (rows[taking_part, part] - means[taking_part, None]) / sizes[taking_part, None]
        gram += standard @ standard.T
        moment += standard @ (target[part] - mean) / size
    with warnings.catch_warnings():
        # A path that ends early because of collinear regressors is shorter, not wrong: its structures are refitted and
        # judged.
        warnings.simplefilter("ignore", ConvergenceWarning)
        penalties, _, coefficients = lars_path_gram(moment, gram, n_samples=n, max_iter=max_knots, method="lasso")
    return taking_part, penalties, coefficients


def _error(data: Regression, rows: Array, target: Array, held_out: tuple[Recording, ...]) -> float:
    """Return the mean squared free-run error on held-out samples of a structure refitted by least squares."""
    try:
        theta = least_squares(rows, target).theta
    except ModelError:  # the regressors depend on each other
        return np.inf
    return float(free_run_errors(data, held_out, theta[None])[0])
