"""Fit one material to several tests: their errors, an energy, the number of branches, and intervals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from deatwin.ident.materials.energies import EnergyStart, equibiaxial_of, is_stable, known_energies
from deatwin.ident.materials.fit import Fit, Quantity, fewer_and_fewer, fit, neo_hookean_modulus, richest
from deatwin.ident.materials.noise import Noise, estimate_noise
from deatwin.ident.materials.observations import Observations
from deatwin.ident.materials.result import CalibratedMaterial, Choice
from deatwin.ident.materials.section import section_of, stated_energy
from deatwin.ident.materials.testfile import MaterialTests
from deatwin.ident.materials.tests import MaterialTest
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.laws.energies import first_invariant
from deatwin.plant.prefixes import range_with_unit
from deatwin.plant.rigs.rigmaterial import read_material
from deatwin.plant.substance import Material

ROUNDS = 2  # Rounds of fit and error estimate; further rounds change the errors by less than their uncertainty
HOPELESS = 20.0  # Log odds against an energy with all branches beyond which fewer branches are not tried
UNEXPLAINED = 0.5  # Unexplained share of the tests from which on no material is returned: it would be worse than none
_LOOK = "look at the columns, their signs and units, and at the specimen's dimensions"
LEVEL = 0.95  # Probability of the intervals


@taking(about=instance(Mapping, error=DataError))
def calibrate_material(tests: Sequence[MaterialTest], about: Mapping[str, Any] | None = None) -> CalibratedMaterial:
    """Fit one material to several tests.

    The material is an elastic network with Maxwell branches in parallel. The energy of the network is one of those in
    `deatwin.plant.laws`. The Bayesian information criterion (BIC) chooses the energy and the number of branches. Among
    energies whose posterior odds differ by less than a factor of 20, the one with the fewest parameters is chosen.

    Samples are weighted by their measurement errors, which are estimated from the tests. An error has an absolute part,
    a relative part, and a factor that all tests of a specimen have in common. Errors may be correlated in time.

    Parameters
    ----------
    tests : sequence of MaterialTest
        Tests of one material, on one or more specimens.
    about : mapping, optional
        Properties that tests cannot determine, with the keys of the section ``[material]`` of a rig file: ``name``,
        ``permittivity``, ``breakdown``, ``density_kg_m3``. If it contains ``energy``, only this energy is fitted. If
        that is a formula of your own, ``parameters`` must give its starting values and ranges.

    Returns
    -------
    CalibratedMaterial
        The material, its parameters with 95 % intervals, and notes on what the tests cannot determine.

    Raises
    ------
    DataError
        If there are no tests, an element is not a `MaterialTest`, the stress of a test is zero throughout, or no energy
        explains the tests.
    RigError
        If `about` contains a mistake.
    """
    listed = _listed(tests)
    own = stated_energy(about or {})
    data = Observations.of(listed)
    best, choices, noise = _choose(data, own)
    quantities, covariance = _intervals(data, best, noise)
    section = section_of(about or {}, best, quantities)
    material, _ = read_material(section)
    said = notes_of(data, best, noise, choices, quantities)
    return CalibratedMaterial(
        section=section,
        quantities=quantities,
        covariance=covariance,
        noise=noise,
        choices=choices,
        notes=(*said, *on_permittivity(about or {}, material)),
        tests=listed,
        data=data,
        modelled=best.modelled,
    )


def _listed(tests: Sequence[MaterialTest]) -> tuple[MaterialTest, ...]:
    """Return tests as a tuple; DataError if there are none, or one cannot be used."""
    listed = tuple(tests) if isinstance(tests, Iterable) else (tests,)
    if not listed:
        raise DataError("no tests: a material needs one test or more")
    for test in listed:
        if not isinstance(test, MaterialTest):
            hint = ": give its field tests" if isinstance(test, MaterialTests) else ""
            raise DataError(f"tests must be a list of MaterialTest; got a {type(test).__name__}{hint}")
        if not test.is_dma and not np.any(test.stress):
            raise DataError(f"{test.name}: the stress is zero throughout")
    return listed


def _choose(data: Observations, own: EnergyStart | str | None) -> tuple[Fit, tuple[Choice, ...], Noise]:
    """Choose energy and number of branches; return the chosen fit, the best of each choice, and the tests' errors."""
    noise = Noise.guess(data)
    white = noise.whitener(data, data.measured)
    starts = _starts(data, own, neo_hookean_modulus(data, white))
    # The best energy so far shows the noise: the misfit of a worse one would count as slow noise.
    for _ in range(ROUNDS):
        rich = min((richest(data, start, white) for start in starts), key=lambda one: one.criterion(noise.count(data)))
        noise = estimate_noise(data, data.measured - rich.modelled, rich.modelled, rich.slopes)
        white = noise.whitener(data, rich.modelled)
    count = noise.count(data)
    rich_ones = [richest(data, start, white) for start in starts]
    least = min(one.criterion(count) for one in rich_ones)
    # Fewer branches cannot make up for odds of e^20, so an energy that far behind is tried with all branches only.
    near = [one for one in rich_ones if one.criterion(count) < least + 2.0 * HOPELESS]
    fits = [one for rich in near for one in fewer_and_fewer(data, rich, white)]
    allowed = [one for one in fits if one.coordinates.size < count and is_stable(one.start, one.elastic, data.largest)]
    if not allowed:
        raise DataError(f"no energy with a stress that rises with the stretch explains these tests; {_LOOK}")
    best = _simplest(allowed, count)
    for _ in range(ROUNDS):
        white = noise.whitener(data, best.modelled)
        best = fit(data, best.start, best.elastic, best.branches, white)
        noise = estimate_noise(data, data.measured - best.modelled, best.modelled, best.slopes)
    if np.linalg.norm(data.measured - best.modelled) > UNEXPLAINED * np.linalg.norm(data.measured):
        raise DataError(
            f"{best.start.called}, the best energy, leaves more than half of the stress unexplained; {_LOOK}"
        )
    return best, tuple(_choices(allowed, best, count)), noise


def _simplest(fits: Sequence[Fit], count: float) -> Fit:
    """Return the most probable fit or, among nearly equally probable energies, the one with the fewest parameters."""
    least = min(one.criterion(count) for one in fits)
    near = [one for one in fits if one.criterion(count) < least + 2.0 * ODDS]
    fewest = min(len(one.start.parameters) for one in near)
    return min((one for one in near if len(one.start.parameters) == fewest), key=lambda one: one.criterion(count))


def _starts(data: Observations, own: EnergyStart | str | None, modulus: float) -> list[EnergyStart]:
    if isinstance(own, EnergyStart):
        return [own]
    known = list(known_energies(modulus, data.largest))
    return [start for start in known if own in (None, start.energy.__name__)]


def _choices(fits: Sequence[Fit], best: Fit, count: float) -> Iterator[Choice]:
    """Return the best fit of each energy, and of each number of branches with the best energy."""
    least = min(one.criterion(count) for one in fits)
    kept: dict[tuple[str, int], Fit] = {}
    for one in sorted(fits, key=lambda one: one.criterion(count)):
        name = one.start.called
        first = not any(called == name for called, _ in kept)
        if first or name == best.start.called:
            kept.setdefault((name, one.n_branches), one)
    for (name, number), one in kept.items():
        behind = 0.5 * (one.criterion(count) - least)
        yield Choice(energy=name, branches=number, behind=float(behind), fit=one)


def _intervals(data: Observations, best: Fit, noise: Noise) -> tuple[tuple[Quantity, ...], Array]:
    """Return parameters with intervals (Welch and Satterthwaite), and the covariance of their coordinates."""
    covariance = _covariance(noise.whitener(data, best.modelled)(best.slopes), best.prior)
    alone = Noise(absolute=noise.absolute, relative=noise.relative, scatter=0.0, repeats=noise.repeats)
    own = np.diag(_covariance(alone.whitener(data, best.modelled)(best.slopes), best.prior))
    whole = np.diag(covariance)
    free = max(noise.count(data) - best.coordinates.size, 1.0)
    scattered = np.maximum(whole - own, 0.0) ** 2 / max(len(data.specimens) - 1, 1)
    freedom = whole**2 / np.maximum(scattered + np.minimum(own, whole) ** 2 / free, 1e-300)
    half = student.ppf(0.5 + LEVEL / 2, freedom) * np.sqrt(whole)
    order = np.argsort(best.coordinates[len(best.start.parameters) + best.n_branches :])
    return tuple(_quantities(best, half, order)), covariance


def _covariance(white: Array, prior: Array) -> Array:
    """Invert the information in whitened slopes and prior; a direction without information gets a large variance."""
    size = np.sqrt(np.sum(white**2, axis=0) + prior)
    size[size == 0.0] = 1e-150
    information = (white.T @ white + np.diag(prior)) / np.outer(size, size)
    values, vectors = np.linalg.eigh(information)
    return (vectors / np.maximum(values, 1e-12)) @ vectors.T / np.outer(size, size)


def _quantities(best: Fit, half: Array, order: NDArray[np.intp]) -> Iterator[Quantity]:
    bounds, count = best.start.bounds, len(best.start.parameters)
    for k, parameter in enumerate(best.start.parameters):
        at = float(best.coordinates[k])
        ends = np.clip([at - half[k], at + half[k]], bounds[0, k], bounds[1, k])
        low, high = sorted(parameter.scale.to_value(float(end)) for end in ends)
        value = min(max(parameter.scale.to_value(at), low), high)
        yield Quantity(name=parameter.name, value=value, low=low, high=high, unit=parameter.unit)
    for number, branch in enumerate(order, start=1):
        name = "branch" if number == 1 else f"branch_{number}"
        for what, unit, place in (("modulus", "Pa", branch), ("time", "s", best.n_branches + branch)):
            k = count + int(place)
            low, value, high = np.exp(best.coordinates[k] + min(half[k], 50.0) * np.array([-1.0, 0.0, 1.0]))
            yield Quantity(name=f"{name}_{what}", value=float(value), low=float(low), high=float(high), unit=unit)


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
