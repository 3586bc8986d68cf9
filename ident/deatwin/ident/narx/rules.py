"""A rule that says which products are candidate terms.

Any callable that takes a `Term` and returns a bool will do; this one prints, so that a model's provenance names it.

>>> from deatwin.ident.narx import generate_terms
>>> from deatwin.ident.narx.rules import AtMost
>>> [str(term) for term in generate_terms(1, 1, 2, rule=AtMost(output=1))]
['1', 'y(k-1)', 'u(k-1)', 'y(k-1)u(k-1)', 'u(k-1)^2']
"""

from __future__ import annotations

from dataclasses import dataclass

from deatwin.ident.narx.terms import Term


@dataclass(frozen=True, kw_only=True)
class AtMost:
    """Bounds the degree in each kind of signal; ``AtMost(output=1)`` keeps models that are affine in the output."""

    output: int | None = None
    input: int | None = None

    def __call__(self, term: Term) -> bool:
        bounds = (("y", self.output), ("u", self.input))
        return all(
            bound is None or sum(power for v, power in term.factors if v.kind == kind) <= bound
            for kind, bound in bounds
        )
