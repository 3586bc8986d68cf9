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
    """Estimator of polynomial nonlinear state spaces that minimises the free-run error; terms may be functions, too.

    The search starts from a linear state space. Subspace identification finds it from the best linear approximation if
    the input is periodic, otherwise from the samples. Its weights are then refined by the free-run error. The states
    x1, x2, ... are transformed into the first output, the change of this output, and so on. Each state has an rms value
    of about one and is uncorrelated with the earlier states, so that x1 is roughly the output and x2 its rate.

    Then all weights are fitted by Levenberg's and Marquardt's method with exact sensitivities. At first the end of each
    recording is held out, and the search ends when the free-run error on the held-out samples no longer falls. A second
    search fits all samples. If the held-out error had not stopped falling, the second search continues from the end of
    the first. Otherwise it begins again at the linear start, and takes as many steps as the first search took to its
    smallest held-out error; its result is discarded unless its error over all samples is smaller than that of the first
    search's best model.

    Parameters
    ----------
    states : int
        Number of states.
    degrees : sequence of int
        Degrees, from 2 on, of the monomials in the equation of the state.
    output_degrees : sequence of int
        Degrees of the monomials in the equation of the output.
    inputs_in_products : bool
        True if monomials may contain inputs too; False if they contain states only.
    terms, output_terms : sequence of str
        Further terms of the equations of the state and of the output, as ``"|x2|"``, ``"tanh(s1,1) u"`` or terms with a
        function that `register_function` has added. The built-in functions are those of NARX terms.
    directions : int
        Number of learned directions. A direction s1, s2, ... is a weighted sum of 1, the states and the inputs. Its
        weights are estimated too. `terms` and `output_terms` must use each direction.
    starts : int
        Number of random starts of the directions; the start with the smallest held-out error is kept.
    feedthrough : bool
        True if the outputs depend on the inputs in the same sample.
    held_out : float
        Share of each recording, at its end, that is held out: the search stops when the error on this part no longer
        falls. With 0, all samples are fitted.
    max_steps : int
        Largest number of steps of a search.
    seed : int
        Seed of the random starts.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. ``theta_cov`` is valid if the noise is white and on the readings.
    status_ : FitStatus
        Outcome. ``DONE``: the gradient over all samples is small. ``INTERRUPTED``: Ctrl-C. ``HELD_OUT``: the held-out
        error stopped falling, so the model was deliberately not fitted to the minimum. ``NOT_CONVERGED``: a search
        reached `max_steps` or could not lower the error further.
    linear_error_, error_, held_out_error_ : ndarray, shape (n_outputs,)
        Root mean squares of the free-run error, in the outputs' units. ``linear_error_`` is that of the initial linear
        model on all samples, ``error_`` that of the final model on all samples, and ``held_out_error_`` that of the
        model on the held-out samples before it is refitted to all samples (NaN if no samples are held out).
    first_states_ : ndarray, shape (n_recordings, n_states)
        State of the model at the first sample of each recording, as `NonlinearStateSpace.simulate` takes it.

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

    @property
    def _order(self) -> int:
        return self.states

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
