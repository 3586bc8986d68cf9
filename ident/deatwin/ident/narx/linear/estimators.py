"""Estimators of linear models: ARX by least squares; ARMAX, output error and Box-Jenkins by prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from deatwin.ident.narx.drive import signals_like
from deatwin.ident.narx.estimate import LeastSquares
from deatwin.ident.narx.identifier import FitStatus, Identifier, Progress, silent
from deatwin.ident.narx.linear.model import LinearModel, lagged_signals
from deatwin.ident.narx.linear.polynomials import Orders, per_input
from deatwin.ident.narx.linear.prediction import Minimum, PredictionErrorLoss, minimise, starting_points
from deatwin.ident.narx.regression import Recordings, Regression, flatten, provenance_of, require_no_target
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.arguments import truth
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Counts = int | Sequence[int]


class LinearIdentifier(Identifier):
    """Base class of the estimators of linear models.

    Attributes
    ----------
    model_ : LinearModel
        Fitted model, in physical units.
    status_ : FitStatus
        Outcome of the fit; ``NOT_CONVERGED`` if the gradient is not small at the end of the search.
    """

    model_: LinearModel
    status_: FitStatus

    def fit(self, recordings: Recordings, y: None = None, *, progress: Progress | None = None) -> Self:
        """Estimate the polynomials; `recordings` (of one output), `y` and `progress` as in `NarxIdentifier.fit`."""
        from threadpoolctl import threadpool_limits

        require_no_target(y)
        chosen = flatten(recordings)
        if chosen[0].outputs.shape[0] != 1:
            raise ModelError(
                f"the recordings have {chosen[0].outputs.shape[0]} outputs; a linear model has one: "
                "fit each output with recordings of its own"
            )
        orders = self._orders(chosen[0].inputs.shape[0])
        data = _regression(chosen, orders)
        self.status_ = FitStatus.DONE
        with threadpool_limits(1):  # tall and narrow matrices, for which more threads only wait for each other
            found = self._estimate(orders, data, progress or silent)
        self.model_ = self._model(orders, data, found)
        return self

    def _orders(self, n_inputs: int) -> Orders:
        """Return the orders for a number of inputs, or raise ModelError."""
        return _orders(n_inputs, **self.get_params())

    def _estimate(self, orders: Orders, data: Regression, progress: Progress) -> Minimum:
        """Minimise the prediction errors from several starts; return the lowest minimum."""
        scaled = [data.scaled(record) for record in data.recordings]
        loss = PredictionErrorLoss(orders, [(inputs, outputs[0]) for inputs, outputs in scaled])
        progress(0.0, "a long ARX model")
        starts = starting_points(orders, loss.records)
        found: list[Minimum] = []
        for number, start in enumerate(starts):
            progress(number / len(starts), f"search {number + 1} of {len(starts)}")
            found.append(minimise(loss, start))
            if not found[-1].complete:
                self.status_ = FitStatus.INTERRUPTED
                break
        progress(1.0, "done")
        best = min(found, key=lambda one: one.noise_variance)
        if self.status_ is FitStatus.DONE and not best.converged:
            self.status_ = FitStatus.NOT_CONVERGED
        return best

    def _model(self, orders: Orders, data: Regression, found: Minimum) -> LinearModel:
        """Return the model in physical units."""
        scale = orders.scales(data.input_scales, data.output_scale)
        p = orders.split(found.theta * scale)
        cov = found.theta_cov * np.outer(scale, scale)
        return LinearModel(
            **p._asdict(),
            theta_cov=cov if orders.offset else np.pad(cov, (0, 1)),
            noise_variance=found.noise_variance * data.output_scale**2,
            **signals_like(data.recordings[0]),
            provenance=provenance_of(self, data.recordings, sum(record.n_samples for record in data.recordings)),
        )


@dataclass(kw_only=True, eq=False, repr=False)
class Arx(LinearIdentifier):
    """Estimator of ARX models A y(k) = sum_i B_i u_i(k) + e(k) + offset, by least squares (QR).

    The polynomials A and B_i are those of `LinearModel`, and e is white noise.

    Parameters
    ----------
    na : int
        Order of A.
    nb : int or sequence of int
        Number of coefficients of each B_i; a single number applies to all inputs.
    nk : int or sequence of int
        Delay of each input in samples, which is the lag of the first coefficient of B_i.
    offset : bool
        True to estimate the offset. If False, the offset is 0, and the signals should be deviations from an operating
        point.

    Attributes
    ----------
    model_ : LinearModel
        Fitted model; ``theta_cov`` is ``sigma^2 (P'P)^-1`` with the residual variance sigma^2 and the regressors P.
    status_ : FitStatus
        Always `FitStatus.DONE`.
    """

    na: int = 2
    nb: Counts = 2
    nk: Counts = 1
    offset: bool = True

    def _estimate(self, orders: Orders, data: Regression, progress: Progress) -> Minimum:
        found = LeastSquares()(*data.matrix())
        progress(1.0, "least squares")
        sign = np.where([str(term).startswith("y") for term in data.table.terms], -1.0, 1.0)
        return Minimum(found.theta * sign, found.theta_cov * np.outer(sign, sign), found.noise_variance, True)


@dataclass(kw_only=True, eq=False, repr=False)
class Armax(LinearIdentifier):
    """Estimator of ARMAX models A y(k) = sum_i B_i u_i(k) + C e(k) + offset, by prediction-error minimisation.

    The polynomials A, B_i and C are those of `LinearModel`, and e is white noise. The search uses Gauss-Newton steps in
    a trust region, with exact gradients. It is run from two starting points: a regression on the errors of a long ARX
    model, and the ARX model with C = 1. The result with the smaller error is kept.

    Parameters
    ----------
    na : int
        Order of A.
    nb : int or sequence of int
        Number of coefficients of each B_i; a single number applies to all inputs.
    nc : int
        Order of C.
    nk : int or sequence of int
        Delay of each input in samples.
    offset : bool
        True to estimate the offset; if False, the offset is 0.

    References
    ----------
    Ljung, System Identification: Theory for the User, 2nd ed., 1999, sections 4.2, 7.2, 9.3 and 10.2.
    """

    na: int = 2
    nb: Counts = 2
    nc: int = 2
    nk: Counts = 1
    offset: bool = True


@dataclass(kw_only=True, eq=False, repr=False)
class OutputError(LinearIdentifier):
    """Estimator of output-error models y(k) = sum_i (B_i/F_i) u_i(k) + e(k) + offset.

    The polynomials B_i and F_i are those of `LinearModel`, and e is white noise. The estimator minimises the mean
    squared prediction error. The search is run from two starting points: an ARX model, and a long ARX model reduced by
    the method of Steiglitz and McBride. The result with the smaller error is kept. The initial state of each recording
    is estimated, too.

    If the noise is not white, B_i and F_i are still unbiased, but their covariance is wrong. `BoxJenkins` avoids this.

    Parameters
    ----------
    nb : int or sequence of int
        Number of coefficients of each B_i; a single number applies to all inputs.
    nf : int or sequence of int
        Order of each F_i; a single number applies to all inputs.
    nk : int or sequence of int
        Delay of each input in samples.
    offset : bool
        True to estimate the offset; if False, the offset is 0.

    References
    ----------
    Ljung, System Identification: Theory for the User, 2nd ed., 1999, sections 4.2, 8.4, 9.3 and 10.2.
    """

    nb: Counts = 2
    nf: Counts = 2
    nk: Counts = 1
    offset: bool = True


@dataclass(kw_only=True, eq=False, repr=False)
class BoxJenkins(LinearIdentifier):
    """Estimator of Box-Jenkins models y(k) = sum_i (B_i/F_i) u_i(k) + (C/D) e(k) + offset.

    The polynomials B_i, F_i, C and D are those of `LinearModel`, and e is white noise. The estimator minimises the mean
    squared prediction error. The search is run from the two starting points of `OutputError`. At each of them, C and D
    are first estimated from the residual. The result with the smaller error is kept.

    Parameters
    ----------
    nb : int or sequence of int
        Number of coefficients of each B_i; a single number applies to all inputs.
    nc : int
        Order of C.
    nd : int
        Order of D.
    nf : int or sequence of int
        Order of each F_i; a single number applies to all inputs.
    nk : int or sequence of int
        Delay of each input in samples.
    offset : bool
        True to estimate the offset; if False, the offset is 0.

    References
    ----------
    Ljung, System Identification: Theory for the User, 2nd ed., 1999, sections 4.2, 9.3 and 10.2.
    """

    nb: Counts = 2
    nc: int = 2
    nd: int = 2
    nf: Counts = 2
    nk: Counts = 1
    offset: bool = True


def _orders(
    n_inputs: int, *, nb: Counts, nk: Counts, offset: bool, na: int = 0, nc: int = 0, nd: int = 0, nf: Counts = 0
) -> Orders:
    """Return checked orders."""
    if n_inputs == 0:
        raise ModelError("the recordings have no input: there is nothing that the output could answer to")
    truth(offset, "offset")
    (na,), (nc,), (nd,) = (per_input(k, v, 1, 0) for k, v in (("na", na), ("nc", nc), ("nd", nd)))
    return Orders(
        na=na,
        nb=per_input("nb", nb, n_inputs, 1),
        nc=nc,
        nd=nd,
        nf=per_input("nf", nf, n_inputs, 0),
        nk=per_input("nk", nk, n_inputs, 0),
        offset=bool(offset),
    )


def _regression(recordings: tuple[Recording, ...], orders: Orders) -> Regression:
    """Return the regression on the lagged signals; raise ModelError if there are too few samples."""
    terms = [Term.product([variable]) for variable in lagged_signals(orders)]
    data = Regression.on(recordings, TermTable((*terms, *([Term(())] if orders.offset else []))))
    for name, *rows in zip(recordings[0].input_names, *(record.inputs for record in recordings), strict=True):
        if np.ptp(np.concatenate(rows)) == 0.0:
            raise ModelError(f'the input "{name}" is constant, so its effect on the output is unknown')
    fewest = orders.first + orders.nd + sum(orders.nf) + 1
    for number, record in enumerate(recordings, start=1):
        if record.n_samples < fewest:
            raise ModelError(f"recording {number} has {record.n_samples} samples; at least {fewest} are needed")
    unknowns = orders.n_theta + len(recordings) * sum(orders.nf)
    if data.n_samples - orders.nd * len(recordings) <= unknowns:
        raise ModelError(f"{data.n_samples} usable samples are too few for {unknowns} unknowns")
    return data
