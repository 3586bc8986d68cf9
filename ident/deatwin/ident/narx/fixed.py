"""Estimation of a model whose terms are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from deatwin.ident.narx.estimate import Estimate, Estimator, least_squares, require_estimator
from deatwin.ident.narx.identifier import NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings, Regression, flatten
from deatwin.ident.narx.terms import Term, TermTable, require_terms
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(kw_only=True, eq=False, repr=False)
class Fixed(NarxIdentifier):
    """Estimate the parameters of given terms, by least squares or another estimator.

    Parameters
    ----------
    terms : NarxModel, sequence of Term or str, or mapping of str to such sequences
        Terms to fit: a list such as ``["y(k-1)", "u(k-1)^2"]``, or a model, whose terms and origins are used. For
        several outputs, give the list of each equation: ``{"y1": ["y1(k-1)"], "y2": ["y2(k-1)", "u(k-1)"]}``. Signals
        have their names in the recordings, for example ``"voltage(k-1)*temperature(k-2)"``. They may also be called y
        and u, or y1, y2, u1, u2, ... if there are several; a name in the recordings takes precedence.
    estimator : callable
        Estimator of the parameters: `LeastSquares`, `TotalLeastSquares`, or another function with the same arguments.

    Attributes
    ----------
    model_ : NarxModel
        Fitted model, in physical units, with the terms in the order given.
    estimate_ : Estimate
        Result of `estimator`, for regressors and an output that are scaled by powers of two.

    Examples
    --------
    >>> import numpy as np
    >>> from deatwin.plant.recording import Recording
    >>> u = np.sin(np.arange(20.0) ** 2)
    >>> recording = Recording.from_arrays(u, np.append(0.0, 2 * u[:-1]), 1.0)
    >>> Fixed(terms=["u(k-1)"]).fit(recording).model_.theta.round(12).tolist()
    [2.0]
    """

    terms: NarxModel | Sequence[Term | str] | Mapping[str, Sequence[Term | str]]
    estimator: Estimator = least_squares

    estimate_: Estimate = field(init=False)

    def _check(self) -> None:
        if not isinstance(self.terms, NarxModel):
            require_terms(self.terms, "terms", '["y(k-1)", "u(k-1)^2"]', least=1)
        require_estimator(self.estimator)

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        return data  # the terms are given, and so is their origin

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        chosen = flatten(recordings)
        table = self._table(chosen[0], output)
        if table.channels("e"):
            raise ModelError("Fixed takes terms without noise e(k-l); Narmax(Fixed(...)) adds a noise model")
        data = Regression.on(chosen, table, output=output)
        return data.about(self.terms) if isinstance(self.terms, NarxModel) else data

    def _table(self, record: Recording, output: int) -> TermTable:
        """Return the terms of one equation, after a check that the recording has their signals."""
        names = {"input_names": record.input_names, "output_names": record.output_names}
        written = self._of_output(output, record.output_names)
        terms = tuple(term if isinstance(term, Term) else Term.parse(term, **names) for term in written)
        if len(set(terms)) != len(terms):
            raise ModelError(f"each term only once; got {', '.join(map(str, terms))}")
        table = TermTable(terms)
        for kind, signals, there in (("u", "inputs", record.input_names), ("y", "outputs", record.output_names)):
            if table.channels(kind) > len(there):
                raise ModelError(
                    f"the terms use {table.channels(kind)} {signals}, the recordings have {len(there)}: "
                    f"{', '.join(there) or 'none'}"
                )
        return table

    def _of_output(self, output: int, own: Sequence[str]) -> Sequence[Term | str]:
        """Return the terms of one equation."""
        if isinstance(self.terms, NarxModel):
            if self.terms.n_outputs != len(own):
                raise ModelError(f"the model has {self.terms.n_outputs} outputs, the recordings have {len(own)}")
            pairs = zip(self.terms.terms, self.terms.equations, strict=True)
            return [term for term, equation in pairs if equation == output]
        if not isinstance(self.terms, Mapping):
            if len(own) > 1:
                raise ModelError(
                    f'the recordings have {len(own)} outputs: give the terms of each, as {{"y1": [...], "y2": [...]}}'
                )
            return self.terms
        placed = [f"y{row + 1}" for row in range(len(own))] if len(own) > 1 else ["y"]
        for names in (own, placed):
            if sorted(self.terms) == sorted(names):
                return self.terms[names[output]]
        raise ModelError(
            f"terms are given for {', '.join(self.terms)}; "
            f"the outputs are {', '.join(placed)}, or by name {', '.join(own)}"
        )

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        rows, target = data.matrix()
        self.estimate_ = self.estimator(rows, target)
        progress(1.0, f"{len(rows)} parameters")
        found = self.estimate_
        return data.model(found.theta, found.theta_cov, found.noise_variance, identifier=self, theta_dof=found.dof)
