"""Growth of a model where the noise is not white, with terms judged by the refined free run.

There, as with noise on the readings of a slow plant, least squares of the one-step error is biased. Terms are therefore
added by the free-run error, and their number is judged over the whole path, because no single addition need help.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.narx.covariance import gram_inverse_root
from deatwin.ident.narx.criteria import CRITERIA
from deatwin.ident.narx.identifier import Progress
from deatwin.ident.narx.joined import Joined
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.preprocess.stationarity import correlation_samples
from deatwin.ident.narx.refine import extensions, sensitivities
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.residual_tests import whiteness_of
from deatwin.plant.arrays import Array, Booleans
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
    """Return True if a larger model improves more than the best of equally many false candidates would, by the extended
    Bayesian criterion with n divided by the correlation time of its errors."""
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
