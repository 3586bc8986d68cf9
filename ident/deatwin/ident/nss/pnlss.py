"""Polynomial nonlinear state spaces, with functions as terms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.arguments import whole_number
from deatwin.ident.nss.basis import Basis, monomials
from deatwin.ident.nss.identifier import StateSpaceIdentifier
from deatwin.ident.nss.march import System
from deatwin.ident.nss.search import Point, Record
from deatwin.plant.arguments import require_fields, truth
from deatwin.plant.arrays import require_seed
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(kw_only=True, eq=False, repr=False)
class Pnlss(StateSpaceIdentifier):
    """Estimator of state spaces with polynomial and other nonlinear terms; it minimises the free-run error.

    The estimator starts from a linear state space. Subspace identification finds this linear model from the best linear
    approximation if the input is periodic, otherwise from the samples; its weights are then refined to the smallest
    free-run error. Its states x1, x2, ... are transformed so that x1 is roughly the first output, x2 the rate of x1,
    and so on. Each state has an rms value of about one and is uncorrelated with the earlier states.

    All weights of the nonlinear model are then fitted by the Levenberg-Marquardt method, in two searches. In the first
    search, the end of each recording is held out, and the search ends when the free-run error on the held-out samples
    no longer falls. The second search fits all samples. If the held-out error was still falling, the second search
    continues from the result of the first. Otherwise the second search starts again from the linear model and takes as
    many steps as the first search took to its smallest held-out error. The result of the second search is used
    only if its error over all samples is smaller than that of the first result.

    Parameters
    ----------
    states : int
        Number of states.
    degrees : sequence of int
        Degrees of the monomials in the state equation, each at least 2.
    output_degrees : sequence of int
        Degrees of the monomials in the output equation, each at least 2.
    inputs_in_products : bool
        True if monomials may contain inputs too; False if they contain states only.
    terms, output_terms : sequence of str
        Further terms of the state equation and of the output equation, such as ``"|x2|"`` or ``"tanh(s1,1) u"``. Terms
        may contain the functions of NARX terms, including those added by `register_function`.
    directions : int
        Number of directions (s1, s2, ...). A direction is a weighted sum of 1, the states and the inputs, and its
        weights are estimated too. Each direction must occur in `terms` or `output_terms`.
    starts : int
        Number of random starts for the weights of the directions; the result with the smallest held-out error is kept.
    feedthrough : bool
        True if the outputs depend on the inputs in the same sample.
    held_out : float
        Share of each recording, at its end, that is held out from the first search. With 0, both searches fit all
        samples.
    max_steps : int
        Largest number of steps of each search.
    seed : int
        Seed of the random starts, at least 0.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. ``theta_cov`` is valid if the noise is white and on the readings.
    status_ : FitStatus
        Outcome. ``DONE``: the gradient of the error over all samples is small. ``INTERRUPTED``: the fit was ended by
        Ctrl-C. ``HELD_OUT``: the held-out error stopped falling, so the fit deliberately ended before the minimum.
        ``NOT_CONVERGED``: the fit reached `max_steps`, or no further step lowered the error.
    linear_error_ : ndarray, shape (n_outputs,)
        Rms free-run error of the initial linear model over all samples, in the outputs' units.
    error_ : ndarray, shape (n_outputs,)
        Rms free-run error of ``model_`` over all samples, in the outputs' units.
    held_out_error_ : ndarray, shape (n_outputs,)
        Rms free-run error on the held-out samples, in the outputs' units, before the model is refitted to all samples;
        NaN if no samples are held out.
    first_states_ : ndarray, shape (n_recordings, n_states)
        State of the model at the first sample of each recording: the argument ``initial`` of
        `NonlinearStateSpace.simulate`.

    References
    ----------
    Paduart, Lauwers, Swevers, Smolders, Schoukens, Pintelon, "Identification of nonlinear systems using polynomial
    nonlinear state space models", Automatica 46 (2010) 647-656, doi:10.1016/j.automatica.2010.01.001.
    """

    states: int = 2
    degrees: Sequence[int] = (2, 3)
    output_degrees: Sequence[int] = ()
    inputs_in_products: bool = True
    terms: Sequence[str] = ()
    output_terms: Sequence[str] = ()
    directions: int = 0
    starts: int = 1
    feedthrough: bool = True
    held_out: float = 0.2
    max_steps: int = 100
    seed: int = 0

    def _require(self) -> None:
        self._require_whole("states", "starts")
        require_fields(self, feedthrough=truth, inputs_in_products=truth)
        for name in ("degrees", "output_degrees", "terms", "output_terms"):
            if isinstance(given := getattr(self, name), str) or not isinstance(given, Iterable):
                kind = "(2, 3)" if "degrees" in name else '["|x1|"]'
                raise ModelError(f"{name} = {given!r}; give a list, as {kind}")
        wrong = [d for d in (*self.degrees, *self.output_degrees) if not isinstance(d, int | np.integer) or d < 2]
        if wrong:
            raise ModelError(
                f"a degree of {wrong[0]}; degrees are whole numbers from 2 on, linear terms are always there"
            )
        whole_number(self.directions, "directions", 0)
        require_seed(self.seed)

    def _needed(self, record: Recording) -> int:
        basis, rates, readings = self._basis(len(record.inputs))
        n, p = self.states, len(record.outputs)
        weights = self.directions * basis.linear + n * (basis.linear + len(rates)) + p * (basis.linear + len(readings))
        return weights - n * n

    def _basis(self, n_inputs: int) -> tuple[Basis, tuple[str, ...], tuple[str, ...]]:
        """Return the regressors, and which terms are in the equation of the state and of the output."""
        names = Basis(self.states, n_inputs, 0, ()).names[: None if self.inputs_in_products else self.states]
        rates = tuple(dict.fromkeys((*monomials(names, self.degrees), *self.terms)))
        readings = tuple(dict.fromkeys((*monomials(names, self.output_degrees), *self.output_terms)))
        basis = Basis(self.states, n_inputs, self.directions, tuple(dict.fromkeys((*rates, *readings))))
        held = {basis.names[factor.variable] for term in basis.terms for factor in term}
        if unused := [name for name in basis.names if name[0] == "s" and name not in held]:
            raise ModelError(f"no term holds the direction {unused[0]}: give fewer directions, or a term of it")
        return basis, rates, readings

    def _begun(self, linear: Point, records: Sequence[Record]) -> list[Point]:
        """Return the linear system with all terms at weight zero, for each draw of the directions."""
        basis, rates, readings = self._basis(linear.system.basis.inputs)
        held, first = {"transition": rates, "output": readings}, basis.linear
        weights, free = {}, {}
        for name, terms in held.items():
            known = getattr(linear.system, name)
            weights[name] = np.zeros((len(known), basis.size))
            weights[name][:, :first] = known
            free[name] = np.ones(weights[name].shape, dtype=bool)
            free[name][:, first:] = [term in terms for term in basis.written]
        free["output"][:, 1 + basis.states : first] = self.feedthrough
        rng, points = np.random.default_rng(self.seed), []
        for _ in range(self.starts if basis.directions else 1):
            # The weights of a direction have a norm of one, and the states and inputs an rms value of about one, so that
            # functions bend where the data are.
            drawn = rng.standard_normal((basis.directions, first))
            weights["directions"] = np.zeros((basis.directions, basis.size))
            weights["directions"][:, :first] = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
            free["directions"] = weights["directions"] != 0.0
            points.append(replace(linear, system=System.of(basis, weights, free)))
        return points
