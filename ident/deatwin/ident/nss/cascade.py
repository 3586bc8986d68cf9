"""Cascades of linear dynamics and static functions: Hammerstein, Wiener, and those with two blocks of one kind."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.nss.basis import Basis, numbered
from deatwin.ident.nss.identifier import StateSpaceIdentifier
from deatwin.ident.nss.march import System
from deatwin.ident.nss.search import Point, Record, search
from deatwin.plant.arguments import require_fields, truth
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Roots = NDArray[np.complex128]
_SIGNAL = re.compile(r"\bv\b")  # The signal in a term, and no letter of a function's name
_TRIAL = 10  # Steps of a search after which divisions of poles and zeros are compared
_REAL = 1e-9  # Imaginary part of a root below which it is real but for rounding


class Structure(StrEnum):
    """Order of the blocks, N for a static function and L for linear dynamics."""

    HAMMERSTEIN = "NL"
    WIENER = "LN"
    HAMMERSTEIN_WIENER = "NLN"
    WIENER_HAMMERSTEIN = "LNL"


@dataclass(kw_only=True, eq=False, repr=False)
class Cascade(StateSpaceIdentifier):
    """Identify a cascade of linear dynamics and static functions by its free-run error.

    The cascade has one input and one output. The search starts from the best linear approximation. For ``"NL"`` or
    ``"LN"`` and a Gaussian input, this approximation is proportional to the linear block (Bussgang). For ``"LNL"``, the
    poles and zeros of the approximation are divided between the two linear blocks in all possible ways. Each division
    is fitted for a few steps, and the best one is fitted to the end.

    Parameters
    ----------
    structure : str
        Blocks from input to output: ``"NL"`` (Hammerstein), ``"LN"`` (Wiener), ``"NLN"`` or ``"LNL"``.
    states : int
        Number of states of the linear block, or of both blocks together for ``"LNL"``.
    shape : sequence of str
        Nonlinear terms of the static functions: powers such as ``"v^2"``, or functions such as ``"|v|"``,
        ``"sat(v,1)"`` and, for splines, ``"hinge(v,0.5)"``. The argument v of a static function has an rms value of
        about one. A term proportional to v and a constant are always included.
    feedthrough : bool
        True if the last linear block has direct feedthrough: its output depends on its input in the same sample.
    held_out : float
        Share of each recording, at its end, that is held out. The fit to the other samples ends when the error on this
        part no longer falls; the model is then refitted to all samples. With 0, all samples are fitted from the start.
    max_steps : int
        Largest number of steps of the fit, and of the refit to all samples.

    Attributes
    ----------
    model_ : NonlinearStateSpace
        The identified model. Its `directions`, the weighted sums to which the static functions are applied, are the
        signals between the blocks.
    status_ : FitStatus
        Outcome. ``DONE``: the gradient of the error over all samples is small. ``INTERRUPTED``: the fit was ended by
        Ctrl-C. ``HELD_OUT``: the held-out error stopped falling, so the fit deliberately ended before the minimum.
        ``NOT_CONVERGED``: the fit reached `max_steps`, or no further step lowered the error.
    linear_error_ : ndarray, shape (1,)
        Rms free-run error of the initial linear model over all samples, in the output's unit.
    error_ : ndarray, shape (1,)
        Rms free-run error of ``model_`` over all samples, in the output's unit.
    held_out_error_ : ndarray, shape (1,)
        Rms free-run error on the held-out samples, in the output's unit, before the model is refitted to all samples;
        NaN if no samples are held out.
    first_states_ : ndarray, shape (n_recordings, n_states)
        State of the model at the first sample of each recording: the argument ``initial`` of
        `NonlinearStateSpace.simulate`.

    References
    ----------
    Schoukens, Tiels, "Identification of block-oriented nonlinear systems starting from linear approximations: a
    survey", Automatica 85 (2017) 272-292, doi:10.1016/j.automatica.2017.06.044.
    """

    structure: str = "LN"
    states: int = 2
    shape: Sequence[str] = ("v^2", "v^3")
    feedthrough: bool = True
    held_out: float = 0.2
    max_steps: int = 100

    def _require(self) -> None:
        self._require_whole("states")
        require_fields(self, feedthrough=truth)
        if self.structure not in list(Structure):
            raise ModelError(f"structure = {self.structure!r}; it must be one of {', '.join(Structure)}")
        if self.structure == Structure.WIENER_HAMMERSTEIN and self.states < 2:
            raise ModelError(f"states = {self.states}; two linear blocks need at least 2")
        if isinstance(self.shape, str) or not isinstance(self.shape, Iterable):
            raise ModelError(f'shape = {self.shape!r}; give a list, as ["v^2", "|v|"]')
        if wrong := [term for term in self.shape if not (isinstance(term, str) and _SIGNAL.search(term))]:
            raise ModelError(f"the term {wrong[0]!r} of a static function must hold v, as v^2 or sat(v,1)")

    def _needed(self, record: Recording) -> int:
        if len(record.inputs) != 1 or len(record.outputs) != 1:
            raise ModelError(
                f"a cascade has one input and one output; the recordings have {len(record.inputs)} and "
                f"{len(record.outputs)}: use Pnlss"
            )
        return 2 * self.states + 2 + self.structure.count("N") * (1 + len(set(self.shape)))

    def _begun(self, linear: Point, records: Sequence[Record]) -> list[Point]:
        if self.structure == Structure.WIENER_HAMMERSTEIN:
            return [self._parted(linear, records)]
        return [replace(linear, system=self._around(linear.system))]

    def _of(self, signal: str) -> list[str]:
        """Return the terms of a static function of a signal."""
        return [_SIGNAL.sub(signal, text) for text in dict.fromkeys(self.shape)]

    def _around(self, linear: System) -> System:
        """Return one linear block with static functions before it, after it, or both."""
        a, b, c, d = linear.linear_parts
        before, behind = self.structure[0] == "N", self.structure[-1] == "N"
        entering, leaving = ("s1" if before else "u"), f"s{1 + before}"
        written = [*(self._of("u") if before else []), *(["s1"] if before else [])]
        written += [leaving, *self._of(leaving)] if behind else []
        made = _Weights(Basis(len(a), 1, before + behind, tuple(written)), 1)
        states = numbered("x", len(a))
        if before:
            made.put("directions", 0, ["u"], [1.0], free=False)
            made.put("directions", 0, self._of("u"))
        for row in range(len(a)):
            made.put("transition", row, [*states, entering], [*a[row], b[row, 0]])
        final = ("directions", int(before)) if behind else ("output", 0)
        made.put(*final, states, c[0])
        made.put(*final, [entering], d[0], free=self.feedthrough)
        made.put("output", 0, ["1"], linear.output[:, 0])
        if behind:
            made.put("output", 0, [leaving], [1.0], free=False)
            made.put("output", 0, self._of(leaving))
        return made.system()

    def _parted(self, linear: Point, records: Sequence[Record]) -> Point:
        """Return the best division of poles and zeros between the blocks before and after the function."""
        from scipy.signal import ss2zpk

        a, b, c, d = linear.system.linear_parts
        zeros, poles, gain = ss2zpk(a, b, c, d)
        if not np.isfinite(gain) or gain == 0.0:
            raise ModelError("the best linear approximation is zero: there is nothing to part")
        tried = []
        for first, second in _partings(poles):
            for front, behind in _partings(zeros):
                blocks = [(front, first), (behind, second)]
                if all(z.size <= p.size and p.size for z, p in blocks):
                    system = self._series(blocks, float(gain), float(linear.system.output[0, 0]), records)
                    starts = np.zeros_like(linear.starts)
                    tried.append(search(system, starts, records, steps=_TRIAL).point)
        if not tried:
            raise ModelError("the poles cannot be parted between two blocks: give another number of states")
        return min(tried, key=lambda point: point.cost)

    def _series(
        self, blocks: Sequence[tuple[Roots, Roots]], gain: float, constant: float, records: Sequence[Record]
    ) -> System:
        """Return two linear blocks and, between them, a static function whose input has an rms value of one."""
        from scipy.signal import lfilter, zpk2ss, zpk2tf

        front, behind = blocks
        run = [lfilter(*zpk2tf(*front, 1.0), record.inputs[0]) for record in records]
        size = float(np.sqrt(np.mean(np.concatenate(run) ** 2)))
        (a1, b1, c1, d1), (a2, b2, c2, d2) = zpk2ss(*front, 1.0 / size), zpk2ss(*behind, gain * size)
        n1, n2 = len(a1), len(a2)
        states = numbered("x", n1 + n2)
        made = _Weights(Basis(n1 + n2, 1, 2, ("s1", *self._of("s1"), "s2")), 1)
        for row in range(n1):
            made.put("transition", row, [*states[:n1], "u"], [*a1[row], b1[row, 0]])
        for row in range(n2):
            made.put("transition", n1 + row, [*states[n1:], "s2"], [*a2[row], b2[row, 0]])
        made.put("directions", 0, [*states[:n1], "u"], [*c1[0], d1[0, 0]])
        made.put("directions", 1, ["s1"], [1.0], free=False)
        made.put("directions", 1, self._of("s1"))
        made.put("output", 0, ["1", *states[n1:]], [constant, *c2[0]])
        made.put("output", 0, ["s2"], [d2[0, 0]], free=self.feedthrough)
        return made.system()


class _Weights:
    """Weights of a system under construction, initially all zero and fixed."""

    def __init__(self, basis: Basis, n_outputs: int) -> None:
        self._basis = basis
        counts = {"directions": basis.directions, "transition": basis.states, "output": n_outputs}
        self._values = {name: np.zeros((count, basis.size)) for name, count in counts.items()}
        self._free = {name: np.zeros((count, basis.size), dtype=bool) for name, count in counts.items()}

    def put(
        self,
        name: str,
        row: int,
        labels: Sequence[str],
        values: Sequence[float] | Array | None = None,
        *,
        free: bool = True,
    ) -> None:
        """Set weights of regressors by their names, zero by default."""
        for label, value in zip(labels, np.zeros(len(labels)) if values is None else values, strict=True):
            column = self._basis.labels.index(label)
            self._values[name][row, column] = value
            self._free[name][row, column] = free

    def system(self) -> System:
        """Return the system."""
        return System.of(self._basis, self._values, self._free)


def _partings(roots: Roots) -> Iterator[tuple[Roots, Roots]]:
    """Yield all divisions of roots between two blocks; a pair also as two real roots, of which noise may make a pair."""
    none = np.zeros(0, dtype=np.complex128)
    choices = []
    for root in roots[roots.imag > -_REAL]:
        real = root.real[None].astype(np.complex128)
        if root.imag <= _REAL:
            choices.append([(none, real), (real, none)])
        else:
            pair = np.array([root, root.conj()])
            choices.append([(none, pair), (pair, none), (real, real)])
    for chosen in product(*choices):
        yield np.concatenate([none, *(one for one, _ in chosen)]), np.concatenate([none, *(one for _, one in chosen)])
