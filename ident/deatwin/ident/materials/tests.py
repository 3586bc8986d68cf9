"""Tests of a material, in SI units: stress on a path of stretches, or moduli over frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.materials.flow import STRETCHES
from deatwin.plant.arrays import Array, real_numbers
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import DataError, nearest
from deatwin.plant.words import listed

KINDS = ("tension", "relaxation", "cycles", "equibiaxial", "pure shear", "dma")
"""Kinds of tests. The first three pull a strip; their names do not affect how they are evaluated."""
FEWEST = 4  # Fewest samples of a test: fewer carry less information than its noise takes


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialTest(Rebuilt):
    """Data of one mechanical test. Before the test, the specimen was at rest and unstretched.

    Parameters
    ----------
    name : str
        Name in reports, for example that of the data file.
    kind : str
        ``"tension"``, ``"relaxation"`` or ``"cycles"`` for a strip with free sides; ``"equibiaxial"``;
        ``"pure shear"`` for a wide strip, which keeps its width; or ``"dma"`` for dynamic mechanical analysis.
    specimen : str
        Name of the specimen; by default the name of the test. Stresses and moduli of different specimens may differ by
        a factor, which is common to all tests of one specimen.
    times : array_like, shape (n,), optional
        Times, s, at least 0. The stretch is 1 until time 0. From then on, it changes at a constant strain rate until
        the first sample. If the first sample is at time 0, the stretch jumps. Without times, the test counts as so slow
        that all Maxwell branches are relaxed.
    stretch : array_like, shape (n,)
        Stretch in the loading direction. For a dma test a single number: the static stretch, 1 by default, at which the
        specimen has relaxed.
    stress : array_like, shape (n,)
        Nominal stress, Pa: force in the loading direction per area of the unstretched specimen. For an equibiaxial
        test, the stress in one of the two directions. Omitted for a dma test.
    frequencies, storage, loss : array_like, shape (n,)
        Data of a dma test: frequencies in Hz, storage and loss modulus in Pa. The moduli refer to the dimensions of the
        unstretched specimen.
    shear : bool
        True if a dma test measured shear moduli; False if it measured tensile moduli.

    Raises
    ------
    DataError
        If `kind` is unknown, the arrays required for it are missing or differ in length, a test has fewer than 4
        samples, a time is negative, times do not strictly increase, a value is not finite, or a stretch, frequency or storage
        modulus is not positive.
    """

    name: str
    kind: str
    specimen: str = ""
    times: ArrayLike | None = None
    stretch: ArrayLike = 1.0
    stress: ArrayLike = ()
    frequencies: ArrayLike = ()
    storage: ArrayLike = ()
    loss: ArrayLike = ()
    shear: bool = False

    UNIAXIAL: ClassVar[tuple[str, ...]] = ("tension", "relaxation", "cycles")

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise DataError(
                f"{self.name}: unknown kind {self.kind!r}{nearest(self.kind, KINDS)} (known: {', '.join(KINDS)})"
            )
        object.__setattr__(self, "specimen", self.specimen or self.name)
        names: tuple[str, ...] = ("frequencies", "storage", "loss") if self.is_dma else ("stretch", "stress")
        names += ("times",) if self.times is not None and not self.is_dma else ()
        arrays = {name: self._numbers(name) for name in names}
        shapes = {values.shape for values in arrays.values()}
        if len(shapes) != 1 or len(*shapes) != 1 or next(iter(shapes))[0] < FEWEST:
            raise DataError(f"{self.name}: a {self.kind} test needs {listed(names)} of one length, {FEWEST} or more")
        if self.is_dma:
            arrays["stretch"] = self._numbers("stretch")
            if arrays["stretch"].ndim:
                raise DataError(f"{self.name}: a dma test has one mean stretch, a number")
        self._require_sound(arrays)
        for name, values in arrays.items():
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def _numbers(self, name: str) -> Array:
        """Return a field as an array of its own."""
        return np.array(real_numbers(getattr(self, name), f"{self.name}: {name}"))

    def _require_sound(self, arrays: dict[str, Array]) -> None:
        """Raise an error for impossible values."""
        positive = ("stretch", "frequencies", "storage")
        for name, values in arrays.items():
            bad = ~np.isfinite(values) | ((values <= 0.0) if name in positive else False)
            if np.any(bad):
                row = int(np.argmax(bad))
                limit = "positive and finite" if name in positive else "finite"
                raise DataError(f"{self.name}: {name} at sample {row + 1} must be {limit}")
        times = arrays.get("times")
        if times is not None and (times[0] < 0.0 or np.any(np.diff(times) <= 0.0)):
            row = 1 + int(np.argmax(np.diff(times, prepend=min(-1e-300, times[0])) <= 0.0)) if times[0] >= 0.0 else 1
            raise DataError(f"{self.name}: times must begin at 0 or later and rise; they do not at sample {row}")

    @property
    def is_dma(self) -> bool:
        """True if the test is a dynamic mechanical analysis."""
        return self.kind == "dma"

    @property
    def deformation(self) -> str:
        """``"uniaxial"``, ``"equibiaxial"`` or ``"pure shear"``."""
        return self.kind if self.kind in STRETCHES else "uniaxial"

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(np.atleast_1d(self.frequencies if self.is_dma else self.stress))

    @property
    def clock(self) -> tuple[float, float] | None:
        """Shortest and longest time scale that the test resolves, s; None for a test without times."""
        if self.is_dma:
            turned = 2.0 * np.pi * np.asarray(self.frequencies)
            return float(1.0 / turned.max()), float(1.0 / turned.min())
        if self.times is None:
            return None
        times = np.asarray(self.times)
        # The 10 % quantile, because a machine may sample faster where it reverses.
        return float(np.quantile(np.diff(times), 0.1)), float(times[-1])
