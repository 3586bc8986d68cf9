"""The search of `Semp`: terms are added, exchanged and pruned by the free run; where noise is not white, the model grows.

There, as with noise on the readings of a slow plant, least squares of the one-step error is biased. Terms are therefore
added by the free-run error, and their number is judged over the whole path, because no single addition need help.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from deatwin.ident.narx.covariance import gram_inverse_root
from deatwin.ident.narx.forward import CRITERIA, forward_selection, march_over
from deatwin.ident.narx.identifier import Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.preprocess.sections import correlation_samples
from deatwin.ident.narx.refine import Joined, extensions, sensitivities
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.residual_tests import whiteness_of
from deatwin.ident.narx.response import DIVERGED
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array, Booleans, Integers
from deatwin.plant.errors import ModelError

_LAGS = 10  # Lags of the test for white errors (Hyndman, Athanasopoulos, "Forecasting", 3rd ed. (2021), section 5.4)
_LEVEL = 0.01  # level of that test, as of the others of `Semp`: as rarely is a true model grown by chance
_ROUNDING = 1e-12  # share of the output below which a residual, of an exact recording, is rounding and not noise
_UNDETERMINED = 1e-9  # least share of each direction of the parameters that remains without a held-out section


def white(model: NarxModel, data: Regression) -> bool:
    """Return whether the one-step errors of a model are white, as least squares assumes."""
    residuals = [model.predict(record).residuals for record in data.recordings]
    shortest = min(e.shape[1] for e in residuals)
    lags = min(_LAGS, shortest // 5)
    largest = max(float(np.abs(e).max()) for e in residuals)
    if lags < 1 or largest <= _ROUNDING * data.output_scale:
        return True
    return whiteness_of(residuals, 0, max_lag=lags).p_value >= _LEVEL


def grown(
    model: NarxModel, data: Regression, sections: Sequence[int], *, max_terms: int, level: float, progress: Progress
) -> tuple[NarxModel, ...]:
    """Refine a model and add terms by the free-run error as long as the free run over held-out sections improves."""
    path: list[NarxModel] = []
    try:
        for larger in extensions(model, data.recordings, data.table.terms, max_terms=max_terms):
            path.append(larger)
            progress((len(path) - 1) / max(max_terms - len(model.terms), 1), f"{len(larger.terms)} terms")
    except ModelError:  # the free run of the given model diverges, so there is nothing to refine
        return ()
    except KeyboardInterrupt:
        path = path or [model]
    given = np.array([float(e @ e) for e in _by_sections(run_errors(model, data), sections)])
    errors = np.array([given, *(held_out_errors(one, data, sections) for one in path)])
    found = tuple(path[: smallest_adequate(errors, level)])
    return found if found and _beyond_chance(model, found[-1], data) else ()


def _beyond_chance(model: NarxModel, larger: NarxModel, data: Regression) -> bool:
    """Return True if a larger model improves beyond chance by the extended criterion, for correlated errors."""
    old, new = run_errors(model, data), run_errors(larger, data)
    n = max(1, int(sum(e.size / max(correlation_samples(e[None]), 1.0) for e in new)))
    squares = [float(np.mean(np.concatenate(errors) ** 2)) for errors in (old, new)]
    values = [
        CRITERIA["ebic"](square, n, len(one.terms), len(data.table.terms))
        for square, one in zip(squares, (model, larger), strict=True)
    ]
    return values[1] < values[0]


def smallest_adequate(errors: Array, level: float) -> int:
    """Return the first model of a path from which none is significantly worse; `errors` (n_models, n_sections)."""
    best = int(np.argmin(errors.sum(axis=1)))
    if not np.isfinite(errors[best].sum()):
        return 0
    poor = [k for k in range(best) if not np.isfinite(errors[k].sum()) or worse(errors[k], errors[best], level)]
    return poor[-1] + 1 if poor else 0


def worse(errors: Array, than: Array, level: float) -> Booleans:
    """Return where errors (..., n_sections) are significantly larger; at ``level=0.5`` every difference counts."""
    from scipy.special import stdtrit

    difference = errors - than
    n = difference.shape[-1]
    spread = difference.std(axis=-1, ddof=1) / np.sqrt(n)
    larger: Booleans = difference.mean(axis=-1) > -stdtrit(n - 1, level) * spread
    return larger


def held_out_errors(model: NarxModel, data: Regression, sections: Sequence[int]) -> Array:
    """Return squared free-run errors of sections, (n_sections,), with parameters refined on the others. With
    sensitivities S = Q R and the rows q of a section, its errors are (I - q q')^-1 e to first order, like leave-one-out
    errors."""
    later = data.first - model.table.max_lag
    joined = Joined.of(model, data.recordings)
    slopes = joined.apart(sensitivities(model, joined), model.table.max_lag)
    each = [one[later:] for one in slopes]
    inverse = gram_inverse_root(np.concatenate(each))
    parts = list(zip(_by_sections(run_errors(model, data), sections), _by_sections(each, sections), strict=True))
    found = np.full(len(parts), np.inf)
    for i, (e, part) in enumerate(parts):
        q = part @ inverse
        left = np.eye(q.shape[1]) - q.T @ q
        if np.linalg.eigvalsh(left)[0] > _UNDETERMINED:
            unseen = e + q @ np.linalg.solve(left, q.T @ e)
            found[i] = float(unseen @ unseen)
    return found


def run_errors(model: NarxModel, data: Regression) -> list[Array]:
    """Return the free-run errors of each recording from its first fitted sample on, shape (n - first,) each."""
    joined = Joined.of(model, data.recordings)
    errors = (joined.outputs - joined.run(model)[0])[0, joined.samples(data.first)]
    return joined.apart(errors, data.first)


def _by_sections(values: Sequence[Array], sections: Sequence[int]) -> list[Array]:
    """Cut the samples of each recording into a number of sections."""
    return [part for one, count in zip(values, sections, strict=True) for part in np.array_split(one, count)]


_SECTIONS = 20  # enough to know the variance of a mean (Schmeiser, Oper. Res. 30 (1982) 556-568), and long enough each
_STEPS = 4  # most steps, times max_terms: a search that still changes terms then makes no progress
_DEPENDENT = 1e-12  # share of its squared norm beyond the chosen terms below which a candidate depends on them
_BY_MODEL = ("candidate", "chosen", "theta", "squares", "f_ratio")  # arrays of `Neighbours` with a row for each model


@dataclass(frozen=True, kw_only=True)
class SempStep:
    """One step of the search by `Semp`: a term is added or exchanged, and other terms may be pruned afterwards.

    Parameters
    ----------
    added : tuple of Term
        Terms that the step added. Usually there is one. There are several if the search continued from the model of a
        forward regression, and none if the step only refined the parameters.
    pruned : tuple of Term
        Terms removed by the exchange and by pruning.
    terms : tuple of Term
        Terms of the model after the step.
    srr : float
        Simulation error reduction ratio of the step before pruning: decrease of the mean squared simulation error,
        divided by the mean square of the output.
    msse : float
        Mean squared simulation error after the step, in the squared unit of the output.
    """

    added: tuple[Term, ...]
    pruned: tuple[Term, ...]
    terms: tuple[Term, ...]
    srr: float
    msse: float


class SempSettings(Protocol):
    """The settings of `Semp` that its search follows."""

    max_terms: int
    threshold: float | None
    level: float
    significance: float | None
    max_exchanges: int


class SempSearch:
    """Search of `Semp`, step by step, with errors as sums of squares over each section of the records."""

    def __init__(self, settings: SempSettings, data: Regression) -> None:
        self.settings = settings
        self.data = data
        self.regression = CompressedRegression.of(data)
        self.power = float(self.regression.target @ self.regression.target)
        self.march = march_over(data, data.recordings)
        wanted = min(_SECTIONS, max(2, data.n_samples // 10))
        lengths = np.array([record.n_samples - data.first for record in data.recordings])
        self.sections = np.maximum(1, np.rint(wanted * lengths / lengths.sum())).astype(int)
        self.path: list[SempStep] = []
        self.chosen: list[int] = []
        self.squares = self.power  # sum of squared one-step errors
        self.errors = np.array([self.power])
        self.exchanges = 0
        self.restarted = False
        self.seen = {frozenset[int]()}

    def advance(self) -> bool:
        """Change the model and prune it; return whether that was possible."""
        if len(self.path) >= _STEPS * self.settings.max_terms:
            return False
        before, old = self.errors, self.chosen
        if self._add() or self._exchange():
            rival = before
        elif self._restart():
            rival = self.errors
        else:
            return False
        srr, added = float(before.sum() - self.errors.sum()) / self.power, self.chosen
        self._prune(rival)
        self.seen.add(frozenset(self.chosen))
        terms = self.data.table.terms
        self.path.append(
            SempStep(
                added=tuple(terms[i] for i in added if i not in old),
                pruned=tuple(terms[i] for i in dict.fromkeys([*old, *added]) if i not in self.chosen),
                terms=tuple(terms[i] for i in self.chosen),
                srr=srr,
                msse=float(self.errors.sum()) / self.data.n_samples * self.data.output_scale**2,
            )
        )
        return True

    def _add(self) -> bool:
        """Add the candidate whose model simulates best."""
        if len(self.chosen) >= self.settings.max_terms:
            return False
        models = self.regression.larger(self.chosen)
        if not self.chosen:
            models, errors = self._simulated(models)
            sound = errors.sum(axis=1) < self.power
            return self._take_best(models, errors, sound if sound.any() else ~sound)
        models, errors = self._simulated(models.only(models.f_ratio >= self._critical(models.freedom)))
        enough = self._as_good(errors)
        if self.settings.threshold is not None:
            enough &= self.errors.sum() - errors.sum(axis=1) >= self.settings.threshold * self.power
        return self._take_best(models, errors, enough)

    def _exchange(self) -> bool:
        """Exchange a term for a candidate that simulates better, or equally well with a smaller one-step error."""
        if not self.chosen or self.exchanges >= self.settings.max_exchanges:
            return False
        self.exchanges += 1
        models = self.regression.exchanged(self.chosen)
        models, errors = self._simulated(models.only(models.f_ratio >= self._critical(models.freedom)))
        closer = self._as_good(errors) & (models.squares < self.squares)
        return self._take_best(models, errors, closer | self._worse(self.errors, errors))

    def _restart(self) -> bool:
        """Continue from the forward-regression model that simulates best, if it is better than the present one."""
        if not self.settings.max_exchanges or self.restarted:
            return False
        self.restarted = True
        steps = forward_selection(self.regression.rows.copy(), self.regression.target, self.settings.max_terms)
        order: list[int] = []
        best, best_errors, left = order, np.array([np.inf]), self.power
        for step in steps:
            freedom = self.data.n_samples - len(order) - 1
            if (left - step.residual) * freedom < self._critical(freedom) * step.residual:
                break
            order, left = [*order, step.candidate], step.residual
            theta, _ = self.regression.fit(order)
            (errors,) = self._errors(np.array([order]), theta[None])
            if errors.sum() < best_errors.sum():
                best, best_errors = order, errors
        if not best or frozenset(best) in self.seen or not self._worse(self.errors, best_errors):
            return False
        self.chosen, self.errors, self.squares = best, best_errors, self.regression.fit(best)[1]
        return True

    def _prune(self, rival: Array) -> None:
        """Remove idle terms, and terms without which the model simulates better than `rival`, or than before."""
        while len(self.chosen) > 1:
            models, errors = self._simulated(self.regression.smaller(self.chosen))
            idle = (models.f_ratio < self._critical(models.freedom)) & self._as_good(errors)
            better = self._worse(rival, errors)
            if idle.any():
                self._take(models, errors, int(np.argmin(np.where(idle, models.f_ratio, np.inf))))
            elif better.any():
                self._take(models, errors, int(np.argmin(np.where(better, errors.sum(axis=1), np.inf))))
            else:
                return

    def _take_best(self, models: Neighbours, errors: Array, allowed: Booleans) -> bool:
        """Move to the model that simulates best; among equally good ones, to that with the smallest one-step error."""
        if not allowed.any():
            return False
        totals = np.where(allowed, errors.sum(axis=1), np.inf)
        equal = allowed & ~self._worse(errors, errors[np.argmin(totals)])
        self._take(models, errors, int(np.argmin(np.where(equal, models.squares, np.inf))))
        return True

    def _take(self, models: Neighbours, errors: Array, choice: int) -> None:
        """Move to one of the models."""
        self.chosen = models.chosen[choice].tolist()
        self.errors = errors[choice]
        self.squares = float(models.squares[choice])

    def _simulated(self, models: Neighbours) -> tuple[Neighbours, Array]:
        """Simulate new models; return those that do not diverge, and their errors, shape (n_models, n_sections)."""
        if models.chosen.shape[1] in map(len, self.seen):
            new = [frozenset(chosen) not in self.seen for chosen in models.chosen.tolist()]
            models = models.only(np.array(new, dtype=bool))
        errors = self._errors(models.chosen, models.theta)
        finite: Booleans = np.isfinite(errors.sum(axis=1))
        return models.only(finite), errors[finite]

    def _errors(self, chosen: NDArray[np.int64], theta: Array) -> Array:
        """Simulate models; return their errors, shape (n_models, n_sections)."""
        return self.march.squared_errors(chosen, theta, limit=DIVERGED, sections=self.sections)

    def _as_good(self, errors: Array) -> Booleans:
        """Return whether errors are no larger than those of the present model and of the empty model."""
        return ~self._worse(errors, self.errors) & (errors.sum(axis=1) < self.power)

    def _worse(self, errors: Array, than: Array) -> Booleans:
        return worse(errors, than, self.settings.level)

    def _critical(self, freedom: int) -> float:
        """Return the F ratio that the best false candidate exceeds with the given probability."""
        from scipy.special import stdtrit

        if self.settings.significance is None:
            return 0.0
        chosen = self.data.n_samples - freedom - 1
        competing = max(len(self.regression.rows) - chosen, 1)
        return float(stdtrit(freedom, self.settings.significance / competing / 2)) ** 2  # F of 1 and n is t^2 of n


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """Models that differ from a chosen one by a single term."""

    candidate: Integers
    chosen: Integers  # shape (n_models, n_terms): Terms of each model
    theta: Array  # shape (n_models, n_terms): Least-squares parameters
    squares: Array  # shape (n_models,): Sums of squared one-step errors, square of the scaled output
    f_ratio: Array
    freedom: int  # Number of samples minus terms of the larger model

    def only(self, kept: NDArray[np.bool_]) -> Neighbours:
        """Return the models selected by a mask `kept` (n_models,)."""
        return Neighbours(**{name: getattr(self, name)[kept] for name in _BY_MODEL}, freedom=self.freedom)


@dataclass(frozen=True, kw_only=True, eq=False)
class CompressedRegression:
    """Regression rotated to few rows by an orthogonal matrix, with the same least-squares solutions for any terms."""

    rows: Array  # shape (n_terms, n_rows): Regressors, at most n_terms + 1 numbers each
    target: Array  # shape (n_rows,): Output
    n_samples: int  # Number of samples before the compression

    @classmethod
    def of(cls, data: Regression) -> CompressedRegression:
        """Compress by QR, block by block, which loses no digits to a Gram matrix."""
        triangle: Array = np.empty((0, len(data.table.terms) + 1))
        for rows, target in data.blocks():
            triangle = _triangle(np.vstack([triangle, np.column_stack([rows.T, target])]))
        columns = np.ascontiguousarray(triangle.T)
        return cls(rows=columns[:-1], target=columns[-1], n_samples=data.n_samples)

    def fit(self, chosen: Sequence[int]) -> tuple[Array, float]:
        """Return the parameters of a model, shape (n_terms,), and its sum of squared one-step errors."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        moments = basis.T @ self.target
        left = self.target - basis @ moments
        return solve_triangular(triangle, moments), max(float(left @ left), self._rounding)

    def larger(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models with one more independent candidate p = Q c + w: its parameter is w'y/w'w."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        along = self.rows @ basis
        across = self.rows - along @ basis.T
        across -= (across @ basis) @ basis.T
        norms = np.einsum("ij,ij->i", across, across)
        free = norms > _DEPENDENT * np.einsum("ij,ij->i", self.rows, self.rows)
        free[list(chosen)] = False
        candidate = np.flatnonzero(free)
        added = (across[free] @ self.target) / norms[free]
        moments = basis.T @ self.target
        others = solve_triangular(triangle, moments[:, None] - along[free].T * added) if len(chosen) else along[free].T
        left = self.target - basis @ moments
        freedom = self.n_samples - len(chosen) - 1
        falls = added**2 * norms[free]
        squares = np.maximum(left @ left - falls, self._rounding)
        return Neighbours(
            candidate=candidate,
            chosen=np.column_stack([np.tile(np.asarray(chosen, dtype=np.int64), (candidate.size, 1)), candidate]),
            theta=np.column_stack([others.T, added]),
            squares=squares,
            f_ratio=falls * freedom / squares,
            freedom=freedom,
        )

    def smaller(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models without one chosen term: with G = (R'R)^-1, removing i gives theta - G_i theta_i / G_ii."""
        basis, triangle = np.linalg.qr(self.rows[list(chosen)].T)
        moments = basis.T @ self.target
        theta = solve_triangular(triangle, moments)
        root = solve_triangular(triangle, np.eye(len(chosen)))
        inverse = root @ root.T
        left = self.target - basis @ moments
        squares = max(float(left @ left), self._rounding)
        freedom = self.n_samples - len(chosen)
        rises = theta**2 / np.diag(inverse)
        without = ~np.eye(len(chosen), dtype=bool)
        shape = (len(chosen), len(chosen) - 1)
        return Neighbours(
            candidate=np.array(chosen, dtype=np.int64),
            chosen=np.tile(np.asarray(chosen, dtype=np.int64), (len(chosen), 1))[without].reshape(shape),
            theta=(theta - inverse / np.diag(inverse)[:, None] * theta[:, None])[without].reshape(shape),
            squares=squares + rises,
            f_ratio=rises * freedom / squares,
            freedom=freedom,
        )

    def exchanged(self, chosen: Sequence[int]) -> Neighbours:
        """Return the models with one chosen term exchanged for a candidate, named by the candidate."""
        rests = [[other for other in chosen if other != term] for term in chosen]
        found = [self.larger(rest) for rest in rests]
        parts = [models.only(models.candidate != term) for models, term in zip(found, chosen, strict=True)]
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_MODEL}
        return Neighbours(**joined, freedom=parts[0].freedom)

    @property
    def _rounding(self) -> float:
        """Sum of squared errors that rounding alone may cause."""
        return float((np.finfo(float).eps * len(self.rows)) ** 2 * (self.target @ self.target)) or 1.0


def _triangle(matrix: Array) -> Array:
    """Return R of the QR decomposition."""
    (triangle,) = qr(matrix, mode="r", overwrite_a=True, check_finite=False)
    return np.asarray(triangle[: matrix.shape[1]], dtype=np.float64)
