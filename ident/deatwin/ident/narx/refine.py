"""Models of least free-run error: their parameters by exact sensitivities, terms added and taken out one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deatwin.ident.arguments import positive, whole_number
from deatwin.ident.narx.covariance import gram_inverse_root
from deatwin.ident.narx.drive import require_suits
from deatwin.ident.narx.estimate import converged
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.terms import Term, TermTable, derivative
from deatwin.ident.narx.variables import argument_of
from deatwin.plant.arrays import Array, Integers
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(frozen=True, eq=False)
class Joined:
    """Recordings one after another."""

    recordings: tuple[Recording, ...]

    @classmethod
    def of(cls, model: NarxModel, recordings: Sequence[Recording]) -> Joined:
        """Join recordings; ModelError unless they suit the model, which must have one output."""
        require_model(model).require_one_output("a refinement")
        for recording in recordings:
            require_suits(recording, model, with_outputs=True, fewest=model.table.max_lag + 1)
        return cls(tuple(recordings))

    @cached_property
    def inputs(self) -> Array:
        """Inputs, shape (n_inputs, n)."""
        return np.concatenate([record.inputs for record in self.recordings], axis=1)

    @cached_property
    def outputs(self) -> Array:
        """Outputs, shape (1, n)."""
        return np.concatenate([record.outputs for record in self.recordings], axis=1)

    @cached_property
    def lengths(self) -> Integers:
        """Number of samples of each recording."""
        return np.array([record.n_samples for record in self.recordings])

    @cached_property
    def ends(self) -> Integers:
        """Sample after each recording."""
        return np.cumsum(self.lengths)

    @cached_property
    def ages(self) -> Integers:
        """Number of earlier samples in the recording of each sample."""
        return np.arange(self.ends[-1]) - np.repeat(self.ends - self.lengths, self.lengths)

    def samples(self, first: int) -> Integers:
        """Return the samples from `first` on of each recording."""
        return np.flatnonzero(self.ages >= first)

    def apart(self, values: Array, first: int) -> list[Array]:
        """Cut values of the samples from `first` on by recordings."""
        return np.split(values, self.ends[:-1] - first * np.arange(1, self.ends.size))

    def rows(self, model: NarxModel, table: TermTable, first: int, outputs: Array) -> Array:
        """Evaluate terms about the model's origins from sample `first` on; returns (n_terms, n_computed)."""
        rows = table.rows(*model.about_origin(self.inputs, outputs), first, self.outputs.shape[1])
        return rows if self.ends.size == 1 else rows[:, self.samples(first) - first]

    def run(self, model: NarxModel) -> tuple[Array, int | None]:
        """Return the free run, (1, n), and the sample at which it first diverges."""
        terms = [i for i, term in enumerate(model.terms) if all(v.kind != "e" for v, _ in term.factors)]
        inputs, outputs = model.about_origin(self.inputs, self.outputs)
        march = March.of(
            [model.terms[i] for i in terms],
            {"u": inputs},
            "y",
            outputs,
            first=model.table.max_lag,
            ends=self.ends,
        )
        limits = np.array([model.divergence_limit(record.outputs) for record in self.recordings])
        run, failed = march.run(model.theta[terms], limit=limits)
        if failed is not None:  # far from anything measured, wherever it diverged
            run[:, failed:] = limits.max()
        return run + model.output_origin[:, None], failed

    def sound_run(self, model: NarxModel) -> Array:
        """Return the free run, (1, n); ModelError if it diverges."""
        run, failed = self.run(model)
        if failed is not None:
            number = int(np.searchsorted(self.ends, failed, side="right"))
            recording = self.recordings[number]
            when = float(recording.timepts[self.ages[failed]])
            raise ModelError(
                f"the free run diverges at {when:g} s, so that it has no useful sensitivities; "
                "start from a model whose free run is stable on these recordings"
            )
        return run


Progress = Callable[[float, str], None]

# A candidate depends on the terms if its response beyond theirs retains less than this share of its square.
_DEPENDENT = 1e-10
# A search has converged when a step reduces the sum of squares by less than this share; most do in ten steps.
_TOLERANCE = 1e-8
_STEPS = 50
_REFINED = "least squares of the free-run error"
_STOPPED = "stopped before its gradient was small"


def refine(
    model: NarxModel,
    recordings: Recordings,
    *,
    tolerance: float = _TOLERANCE,
    max_steps: int = _STEPS,
    progress: Progress | None = None,
) -> NarxModel:
    """Return the model with the same terms and the parameters that minimise the free-run error.

    If the noise is on the readings and not in the dynamics, least squares on the one-step error is biased. Least
    squares on the free-run error is then the maximum-likelihood estimate (output error). The search starts from the
    model's parameters and returns the best ones that it found, even if it is stopped by Ctrl-C.

    Parameters
    ----------
    model : NarxModel
        Model with one output and no noise terms, whose free run does not diverge on the recordings.
    recordings : Recording, Experiment, or several
        Training data; each free run starts from the first measured samples of its recording.
    tolerance : float
        Relative decrease of the sum of squares in one step below which the search ends.
    max_steps : int
        Largest number of evaluations of the free run.
    progress : callable, optional
        Called with the share of `max_steps` done, between 0 and 1, and a description of the current step.

    Returns
    -------
    NarxModel
        Refined model. ``theta_cov`` is ``sigma^2 (S'S)^-1``, where S holds the derivatives of the free run with respect
        to the parameters, and sigma^2 is the variance of the free-run error. It is valid if that error is white.
        ``noise_variance`` is the variance of the one-step error, as in every model. If the search ended before the
        gradient was small, the model's provenance says so.

    Raises
    ------
    ModelError
        If the model has several outputs or noise terms, or its free run diverges.

    References
    ----------
    Ljung, "System Identification: Theory for the User", 2nd ed. (1999), sections 4.2 and 10.3.
    """
    positive(tolerance, "tolerance")
    whole_number(max_steps, "max_steps")
    search = _Search(Joined.of(model, flatten(recordings)), model, max_steps, progress)
    with suppress(KeyboardInterrupt):
        search.run(tolerance)
    found = replace(model, theta=search.best)
    slopes, errors = tangent(found, search.joined)
    told = _REFINED if _is_least(slopes, errors, search.joined) else f"{_REFINED}, {_STOPPED}"
    return _refined(found, slopes, errors, search.joined, told)


def extensions(
    model: NarxModel, recordings: tuple[Recording, ...], candidates: Iterable[Term], *, max_terms: int
) -> Iterator[NarxModel]:
    """Yield the refined model and its successors, each larger by the term that to first order lowers the error most."""
    left = [term for term in candidates if term not in model.terms]
    larger = least_error(model, recordings)
    yield larger
    while left and len(larger.terms) < max_terms:
        gains = _gains(larger, recordings, TermTable(tuple(left)))
        best = int(np.argmax(gains))
        if gains[best] <= 0:
            return
        start = _of_terms(larger, (*larger.terms, left.pop(best)), np.append(larger.theta, 0.0))
        larger = least_error(start, recordings)
        yield larger


def prunings(model: NarxModel, recordings: tuple[Recording, ...], *, n_terms: int) -> Iterator[NarxModel]:
    """Yield the refined model and its successors, each without the term that to first order raises the error least."""
    smaller: NarxModel | None = least_error(model, recordings)
    while smaller is not None:
        yield smaller
        smaller = _without_a_term(smaller, recordings) if len(smaller.terms) > max(n_terms, 1) else None


def _without_a_term(model: NarxModel, recordings: tuple[Recording, ...]) -> NarxModel | None:
    """Return the refined model without its least useful dispensable term; None if all are needed."""
    cov = model.theta_cov
    variances = np.where(np.diag(cov) > 0.0, np.diag(cov), np.inf)  # 0 if the run does not depend on the parameter
    for out in np.argsort(model.theta**2 / variances):
        kept = np.delete(np.arange(model.theta.size), out)
        theta = model.theta - cov[:, out] / variances[out] * model.theta[out]  # best parameters with that one at zero
        with suppress(ModelError):
            return least_error(_of_terms(model, tuple(model.terms[i] for i in kept), theta[kept]), recordings)
    return None


def _gains(model: NarxModel, recordings: tuple[Recording, ...], table: TermTable) -> Array:
    """Return by how much each term lowers the sum of squares of the free-run error, to first order."""
    n = len(model.terms)
    both = TermTable(model.terms + table.terms)
    joined = Joined.of(model, recordings)
    run = joined.sound_run(model)
    responses = _responses(model, joined, run, both)
    error = (joined.outputs - run)[0, joined.samples(both.max_lag)]
    gram, moment = responses.T @ responses, responses.T @ error
    sizes = np.sqrt(np.diag(gram))  # so that the units of the signals do not decide what is dependent
    sizes[sizes == 0.0] = 1.0
    gram, moment = gram / sizes[:, None] / sizes, moment / sizes
    onto = np.linalg.lstsq(gram[:n, :n], gram[:n, n:], rcond=None)[0]
    own = np.diag(gram)[n:]
    free = own - np.einsum("ij,ij->j", onto, gram[:n, n:])
    along = moment[n:] - onto.T @ moment[:n]
    return np.divide(along**2, free, out=np.zeros(own.size), where=free > _DEPENDENT * own)


def _of_terms(model: NarxModel, terms: tuple[Term, ...], theta: Array) -> NarxModel:
    """Return a model with other terms and parameters, whose covariance is not yet known."""
    return replace(model, terms=terms, theta=theta, theta_cov=np.zeros((theta.size, theta.size)), equations=())


def sensitivities(model: NarxModel, joined: Joined) -> Array:
    """Derivatives of free runs by parameters, (n_computed, n_terms): s(k) = f_theta(k) + sum_l a_l(k) s(k-l)."""
    return _responses(model, joined, joined.sound_run(model), model.table)


def _responses(model: NarxModel, joined: Joined, run: Array, table: TermTable) -> Array:
    """Return the change of a run (1, n) by small coefficients of any terms, shape (n_computed, n_terms)."""
    from scipy.linalg.lapack import dtbtrs

    first = max(model.table.max_lag, table.max_lag)
    samples = joined.samples(first)
    ages = joined.ages[samples] - first  # earlier samples whose change is passed on
    lagged = [variable for variable in model.table.variables if variable.kind == "y"]
    band = np.zeros((max((v.reach for v in lagged), default=0) + 1, samples.size))
    band[0] = 1.0
    signals = model.about_origin(joined.inputs, run)
    for variable in lagged:
        slopes, weights = derivative(model.terms, model.theta, variable)
        slope = weights @ joined.rows(model, slopes, first, run)
        if variable.shape is not None:
            slope *= variable.shape.slope(argument_of(variable, lambda v, lag: signals[1][v.index, samples - lag]))
        for lag, sign in {variable.reach: 1.0, variable.lag: -1.0}.items():  # a function of a change has both
            band[lag, : samples.size - lag] += sign * np.where(ages >= lag, slope, 0.0)[lag:]
    solved, _ = dtbtrs(band, joined.rows(model, table, first, run).T, uplo="L", diag="U")
    return np.asarray(solved, dtype=np.float64)


def least_error(model: NarxModel, recordings: tuple[Recording, ...]) -> NarxModel:
    """Return the refined model; unlike in `refine`, an interrupt reaches the caller."""
    search = _Search(Joined.of(model, recordings), model, _STEPS, None)
    search.run(_TOLERANCE)
    found = replace(model, theta=search.best)
    return _refined(found, *tangent(found, search.joined), search.joined, _REFINED)


def at_least_error(model: NarxModel, recordings: tuple[Recording, ...]) -> bool:
    """Return True if the gradient of the free-run error is small at the model's parameters."""
    joined = Joined.of(model, recordings)
    return _is_least(*tangent(model, joined), joined)


def _is_least(slopes: Array, errors: Array, joined: Joined) -> bool:
    return converged(slopes, errors, errors.size, float(np.linalg.norm(joined.outputs - joined.outputs.mean())))


def tangent(model: NarxModel, joined: Joined) -> tuple[Array, Array]:
    """Return the sensitivities (n, n_theta) and the errors (n,) of the free runs, one recording after another."""
    run = joined.sound_run(model)
    errors = (joined.outputs - run)[0, joined.samples(model.table.max_lag)]
    return _responses(model, joined, run, model.table), errors


def _powers_of_two(sizes: Array | np.floating) -> Array:
    """Return the nearest powers of two; 1 for 0."""
    return np.where(sizes > 0, np.ldexp(1.0, np.frexp(sizes)[1]), 1.0)


class _Search:
    """The free-run error as a function of the parameters, and the best parameters so far."""

    def __init__(self, joined: Joined, model: NarxModel, max_steps: int, progress: Progress | None) -> None:
        self.model, self.joined = model, joined
        self.max_steps, self.progress = max_steps, progress
        self.best, self.least, self.steps = model.theta, np.inf, 0

    def run(self, tolerance: float) -> None:
        """Search by Gauss-Newton steps in a trust region; scales are powers of two, so that units change no digit."""
        from scipy.optimize import least_squares

        start = self.jacobian(self.model.theta)
        size = float(_powers_of_two(np.linalg.norm(self.joined.outputs - self.model.output_origin[:, None])))
        scales = size / _powers_of_two(np.linalg.norm(start, axis=0))
        origin = self.model.theta / scales
        least_squares(
            lambda x: self.errors(x * scales) / size,
            origin,
            lambda x: (start if np.array_equal(x, origin) else self.jacobian(x * scales)) * (scales / size),
            x_scale="jac",
            ftol=tolerance,
            xtol=1e-12,
            gtol=1e-15,
            max_nfev=self.max_steps,
        )

    def errors(self, theta: Array) -> Array:
        """Return computed minus measured outputs, shape (n_samples,); large values if the run diverges."""
        run, _ = self.joined.run(replace(self.model, theta=theta))
        found = (run - self.joined.outputs)[0, self.joined.samples(self.model.table.max_lag)]
        square = float(found @ found)
        if square < self.least:
            self.best, self.least = theta.copy(), square
        self.steps += 1
        if self.progress is not None:
            rms = np.sqrt(self.least / found.size)
            self.progress(min(self.steps / self.max_steps, 1.0), f"refining: free-run error {rms:.4g} rms")
        return found

    def jacobian(self, theta: Array) -> Array:
        """Return the sensitivities of all samples, shape (n_samples, n_terms)."""
        return sensitivities(replace(self.model, theta=theta), self.joined)


def _refined(model: NarxModel, slopes: Array, errors: Array, joined: Joined, told: str) -> NarxModel:
    """Return a model of least error with its covariance and the remark `told`; `tangent` gives slopes and errors."""
    first = model.table.max_lag
    predicted = model.theta @ joined.rows(model, model.table, first, joined.outputs)
    one_step = (joined.outputs - model.output_origin[:, None])[0, joined.samples(first)] - predicted
    freedom = max(errors.size - model.theta.size, 1)
    root = gram_inverse_root(slopes)
    return replace(
        model,
        theta_cov=float(errors @ errors) / freedom * (root @ root.T),
        theta_dof=np.inf,
        noise_variance=float(one_step @ one_step) / freedom,
        provenance={**model.provenance, "refined": told},
    )


def with_correlated_error(model: NarxModel, recordings: Sequence[Recording]) -> NarxModel:
    """Return a model of least free-run error with the covariance (S'S)^-1 S'RS (S'S)^-1 for correlated errors."""
    from scipy.linalg import matmul_toeplitz

    slopes, errors = tangent(model, joined := Joined.of(model, recordings))
    first = model.table.max_lag
    correlation = autocovariance(joined.apart(errors, first))
    root = gram_inverse_root(slopes)
    middle = np.zeros((root.shape[1],) * 2)
    for part in joined.apart(slopes, first):
        directions = part @ root  # orthonormal over all recordings
        middle += directions.T @ matmul_toeplitz(correlation[: len(part)], directions, check_finite=False)
    spread = 0.5 * errors.size / max(errors.size - model.theta.size, 1) * (middle + middle.T)
    return replace(model, theta_cov=root @ spread @ root.T)


def autocovariance(errors: Sequence[Array]) -> Array:
    """Autocovariance, (longest,), of the autoregressive process (Yule, Walker) that Akaike's criterion prefers."""
    from scipy.linalg import solve_toeplitz
    from scipy.signal import lfilter

    longest, n = max(e.size for e in errors), sum(e.size for e in errors)
    most = min(int(10 * np.log10(n)), longest // 4)  # as in `ar` of R and most texts
    sample = np.array([sum(float(e[lag:] @ e[: e.size - lag]) for e in errors) for lag in range(most + 1)]) / n
    found = np.zeros(longest)
    found[0] = sample[0]
    if sample[0] == 0.0:
        return found
    best, chosen = 0.0, np.empty(0)
    for order in range(1, most + 1):
        coefficients = solve_toeplitz(sample[:order], sample[1 : order + 1])
        left = 1.0 - float(coefficients @ sample[1 : order + 1]) / sample[0]
        if left <= 0.0:
            break
        if (criterion := n * np.log(left) + 2 * order) < best:
            best, chosen = criterion, coefficients
    order = chosen.size
    if order == 0:
        return found
    found[: order + 1] = sample[: order + 1]
    # Beyond these lags g(k) = sum_i a_i g(k-i): a filter without input that starts from them.
    whole = np.concatenate([[1.0], -chosen])
    state = np.array([chosen[i:] @ sample[order:i:-1][: order - i] for i in range(order)])
    found[order + 1 :] = lfilter([1.0], whole, np.zeros(longest - order - 1), zi=state)[0]
    return found
