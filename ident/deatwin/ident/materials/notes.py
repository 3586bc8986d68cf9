"""Notes, in words, on what the tests leave open about a material."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from deatwin.ident.materials.energies import equibiaxial_of
from deatwin.ident.materials.fit import Fit, Quantity
from deatwin.ident.materials.noise import Noise
from deatwin.ident.materials.observations import Observations
from deatwin.ident.materials.result import Choice
from deatwin.plant.laws.energies import first_invariant
from deatwin.plant.prefixes import range_with_unit
from deatwin.plant.substance import Material

ODDS = 3.0  # Logarithm of 20: log odds up to which a less probable choice remains possible
APART = 0.05  # Relative difference of two energies' stresses that is reported: models of elastomers leave such errors
WIDE = 3.0  # Ratio of an interval's ends above which the tests hardly determine a value


def notes_of(
    data: Observations, fitted: Fit, noise: Noise, choices: Sequence[Choice], quantities: Sequence[Quantity]
) -> Iterator[str]:
    """Yield the notes for a user of the material."""
    yield from _on_energies(data, fitted, choices)
    yield from _on_times(data, fitted)
    yield from _on_errors(data, noise)
    yield from _on_softening(data, fitted, noise)
    for one in quantities:
        wide = one.low <= 0.0 <= one.high or max(abs(one.high / one.low), abs(one.low / one.high)) > WIDE
        if wide and not one.name.endswith("limit") and one.name != "locking_stretch":
            yield f"{one.name} is hardly known: {range_with_unit(one.low, one.high, one.unit)}"


def on_permittivity(about: Mapping[str, Any], material: Material | None) -> Iterator[str]:
    """State which permittivity is used if the file gives none."""
    if "permittivity" not in about and material is not None:
        yield (
            f"no permittivity is stated, and coupon tests do not show it: {material.permittivity.value:.3g} is "
            f"assumed, which determines the effect of voltage; state it in [material]"
        )


def _on_energies(data: Observations, fitted: Fit, choices: Sequence[Choice]) -> Iterator[str]:
    """State which energies fit equally well, and how much they differ outside the tests."""
    best: dict[str, Choice] = {}
    for choice in choices:
        best.setdefault(choice.energy, choice)
    others = [c for name, c in best.items() if name != fitted.start.called and c.behind < ODDS]
    if others:
        yield f"as good as {fitted.start.called}: {', '.join(c.energy for c in others)}"
    if any(block.test.deformation != "uniaxial" for block in data.blocks):
        return
    stretch = equibiaxial_of(data.largest)
    if stretch < 1.05:
        return
    pair = np.full((2, 1), stretch)
    own = float(fitted.start.stress(pair, fitted.elastic)[0][0])
    apart = [float(c.fit.start.stress(pair, c.fit.elastic)[0][0]) / own - 1.0 for c in others]
    worst = max(apart, key=abs, default=0.0)
    yield (
        "all tests are uniaxial, but a film in a ring is stretched in both directions, so its stress is extrapolated"
        + (f", {100 * worst:+.0f} % by another energy at a stretch of {stretch:.2f}" if abs(worst) > APART else "")
    )


def _on_times(data: Observations, fitted: Fit) -> Iterator[str]:
    if data.relaxation is None:
        pulls = any(block.test.times is not None for block in data.blocks)
        why = (
            "all tests are pulls at one rate, at which relaxation and elasticity cannot be distinguished"
            if pulls
            else "no test has times"
        )
        yield f"{why}: the material has no branches, even if it relaxes"
        return
    shortest, longest = data.relaxation
    shown = max(clock[1] for block in data.blocks if (clock := block.test.clock) is not None)
    yield f"the equilibrium is the stress after {shown:.3g} s, the longest time of a test: the tests show nothing slower"
    times = fitted.branches[1] if fitted.n_branches else np.empty(0)
    if np.any(times < 1.05 * shortest):
        yield f"the fastest branch lies at the end of what the tests show, {shortest:.2g} s: it represents everything faster"
    if np.any(times > longest / 1.05):
        yield "the slowest branch lies at the end of what the tests show: it represents everything slower"


def _on_errors(data: Observations, noise: Noise) -> Iterator[str]:
    if len(data.specimens) > 1 and noise.scatter > 0.005:
        yield f"the {len(data.specimens)} specimens differ by {100 * noise.scatter:.1f} % (one deviation), which the intervals allow for"
    elif len(data.specimens) == 1:
        yield "there is only one specimen: the intervals do not include the differences between specimens"
    repeats = max(noise.repeats)
    if repeats > 2.0:
        worst = data.blocks[int(np.argmax(noise.repeats))].test.name
        yield (
            f"residuals are correlated, most in {worst}, where {repeats:.0f} samples count as one: the material does not "
            "follow the tests to within their noise, and the intervals are widened accordingly"
        )


def _on_softening(data: Observations, fitted: Fit, noise: Noise) -> Iterator[str]:
    """State whether the stress is lower below the largest earlier stretch: the Mullins effect."""
    elastic, _ = data.elastic(fitted.start, fitted.elastic)
    parts = []
    for block, place in zip(data.blocks, data.places, strict=True):
        extension = np.zeros(block.measured.size)
        if not block.test.is_dma:
            here = first_invariant(*block.stretches) - 3.0
            most = np.maximum.accumulate(here)
            extension = np.where(here < most, 1.0 - here / np.maximum(most, 1e-12), 0.0)
        parts.append(-extension * elastic[place])
    softening = np.concatenate(parts)
    if not np.any(softening):
        return
    white = noise.whitener(data, fitted.modelled)
    own, slopes, residual = white(softening), white(fitted.slopes), white(data.measured - fitted.modelled)
    basis, _ = np.linalg.qr(slopes)
    own = own - basis @ (basis.T @ own)
    size = float(own @ own)
    share = float(own @ residual) / size if size > 1e-9 else 0.0
    # A further parameter must gain half the logarithm of the count, as everywhere by Schwarz' criterion, and odds of
    # 20.
    if share > 0.0 and 0.5 * share**2 * size > 0.5 * np.log(noise.count(data)) + ODDS:
        yield (
            f"below the largest stretch so far the stress is lower by up to {100 * min(share, 1.0):.0f} % than the branches "
            "explain (Mullins effect); the material does not include this effect: add the effect mullins to a rig, or test conditioned "
            "specimens"
        )
