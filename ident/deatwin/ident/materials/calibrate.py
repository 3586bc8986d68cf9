"""Fit one material to several tests: their errors, an energy, the number of branches, and intervals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from deatwin.ident.materials.energies import EnergyStart, is_stable, known_energies
from deatwin.ident.materials.fit import Fit, Quantity, fewer_and_fewer, fit, neo_hookean_modulus, richest
from deatwin.ident.materials.noise import Noise, estimate_noise
from deatwin.ident.materials.notes import ODDS, notes_of, on_permittivity
from deatwin.ident.materials.observations import Observations
from deatwin.ident.materials.result import CalibratedMaterial, Choice
from deatwin.ident.materials.section import section_of, stated_energy
from deatwin.ident.materials.testfile import MaterialTests
from deatwin.ident.materials.tests import MaterialTest
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.rigs.rigmaterial import read_material

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
    """Return parameters with intervals, and the covariance of their coordinates. The scatter of specimens has the
    degrees of freedom that their number gives (Welch and Satterthwaite)."""
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
