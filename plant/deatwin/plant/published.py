"""Published materials of dielectric elastomers: each value with its source, and a range beyond the spread of sources.

*Unconfirmed* values are quoted from later literature, public code or memory: check them before citing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from deatwin.plant.laws.breakdown import HUANG_2012, BreakdownLaw
from deatwin.plant.laws.energies import arruda_boyce, gent, mooney_rivlin, neo_hookean, ogden, yeoh
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.substance import Branch, Material

STIFFEST = 1e7
"""Shear modulus of the stiffest elastomers, Pa. A value beyond a published range widens that range, at most to this."""


def _elastic(name: str, value: float, lower: float, upper: float, source: str) -> Parameter:
    """Make an elastic parameter: moduli on a logarithmic scale, limits of stretch inverse, small terms linear."""
    is_limit = name in ("stretch_limit", "locking_stretch")
    scale = Scale.RECIPROCAL if is_limit else Scale.LOGARITHMIC if lower > 0.0 else Scale.LINEAR
    unit = "1" if is_limit or name.startswith("alpha") else "Pa"
    widest = STIFFEST if scale is Scale.LOGARITHMIC and unit == "Pa" else None
    return Parameter(
        name=name, value=value, unit=unit, lower=lower, upper=upper, scale=scale, source=source, widest=widest
    )


def _modulus(value: float, source: str) -> Parameter:
    return _elastic("shear_modulus", value, 5e3, 200e3, source)


def _stretch_limit(value: float, source: str) -> Parameter:
    return _elastic("stretch_limit", value, 40.0, 1e4, source)


def _locking_stretch(value: float, source: str) -> Parameter:
    return _elastic("locking_stretch", value, 3.8, 1e4, source)


def _positive(name: str, value: float, unit: str, lower: float, upper: float, source: str) -> Parameter:
    scale = Scale.LOGARITHMIC
    return Parameter(name=name, value=value, unit=unit, lower=lower, upper=upper, scale=scale, source=source)


def _permittivity(value: float, source: str) -> Parameter:
    return _positive("permittivity", value, "1", 1.5, 10.0, source)


def _branches(source: str, *values: tuple[float, float]) -> tuple[Branch, ...]:
    """Make branches from (modulus in Pa, time in s); a fit may change a time by a factor of about 30 either way."""
    names = ["branch", *(f"branch_{i}" for i in range(2, len(values) + 1))]
    found = []
    for name, (modulus, time) in zip(names, values, strict=True):
        least, most = float(f"{time / 30:.0e}"), float(f"{time * 33:.0e}")
        found.append(
            Branch(
                name=name,
                modulus=_positive(f"{name}_modulus", modulus, "Pa", 1.0, 1e6, source),
                time=_positive(f"{name}_time", time, "s", least, most, source),
            )
        )
    return tuple(found)


_WANG = "Wang, Decker, Henann & Chester, J. Mech. Phys. Solids 95 (2016) 213"
_HOSSAIN = (
    "Hossain, Vu & Steinmann, Comput. Mater. Sci. 59 (2012) 65, identified at 50 % deformation; "
    "read in a public code's benchmark that cites it"
)
_FOO = (
    "Foo, Cai, Koh, Bauer & Suo, J. Appl. Phys. 111 (2012) 034102, doi:10.1063/1.3680878; "
    "unconfirmed: as later literature quotes it"
)
_RANGE = _permittivity(4.5, "published values for stretched VHB lie between 3.5 and 4.7")


def _common(name: str) -> Material:
    """Return VHB with one relaxation and a middling modulus, as starting values for a rig of unknown history."""
    return Material(
        name=name,
        energy=gent,
        elastic=(
            _modulus(25e3, "middle of the published range for VHB at rest, 14 to 45 kPa"),
            _stretch_limit(107.0, f"3(lambda_L^2 - 1) with lambda_L = 5.99, {_WANG}"),
        ),
        branches=_branches(f"first branch, {_WANG}", (26.06e3, 0.6074)),
        permittivity=_RANGE,
        breakdown=HUANG_2012,
    )


def _published() -> tuple[Material, ...]:
    """Return complete published sets. Their flow rules differ from ours at large strain only; the times are equal."""
    return (
        Material(
            name="VHB 4910 Wang 2016",
            energy=arruda_boyce,
            elastic=(_modulus(15.36e3, _WANG), _locking_stretch(5.99, _WANG)),
            branches=_branches(_WANG, (26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25)),
            permittivity=_permittivity(4.8, _WANG),
            breakdown=HUANG_2012,
        ),
        Material(
            name="VHB 4910 Hossain 2012",
            energy=arruda_boyce,
            elastic=(
                _modulus(13.7e3, _HOSSAIN),
                _locking_stretch(886.6, f"root of 7.86e5 links: far from any limit at that strain; {_HOSSAIN}"),
            ),
            branches=_branches(_HOSSAIN, (56.4e3, 0.82), (31.5e3, 10.7), (19.8e3, 500.0)),
            permittivity=_RANGE,
            breakdown=HUANG_2012,
        ),
        Material(
            name="VHB 4910 Foo 2012",
            energy=gent,
            elastic=(_modulus(18e3, _FOO), _stretch_limit(110.0, _FOO)),
            branches=_branches(f"its spring's own limit, 55, is left out here; {_FOO}", (42e3, 400.0)),
            permittivity=_permittivity(4.5, f"3.98e-11 F/m; {_FOO}"),
            breakdown=HUANG_2012,
        ),
    )


def _in_rigs(material: Material) -> Material:
    """Return a material whose moduli range from half the lowest to twice the highest published value."""
    moduli = (
        replace(p, lower=p.lower / 2, upper=p.upper * 2) if p.scale is Scale.LOGARITHMIC and p.unit == "Pa" else p
        for p in material.elastic
    )
    return replace(material, elastic=tuple(moduli))


_TENSILE = (
    "least squares to {upto} % of the pull at 0.23 /s in the Soft Robotics Materials Database of Marechal & Lindenroth "
    "(github.com/LucMarechal/Soft-Robotics-Materials-Database)"
)
_SOROTOKI = "Sorotoki (github.com/BJCaasenbrood/SorotokiCode)"
_AKBARI = (
    "Akbari, Rosset & Shea, Appl. Phys. Lett. 102 (2013) 071906; unconfirmed: as a public code quotes it; 345 kPa "
    "follows from the Ogden constants that the same code quotes of Vossen et al. 2015"
)
_SHEET = "data sheet; unconfirmed: from memory, values of silicones without filler lie between 2.5 and 3.2"
_WACKER = "data sheet of Elastosil Film 2030; unconfirmed: from memory"
_TRELOAR = "vulcanised rubber of Treloar: Ogden, Proc. R. Soc. Lond. A 326 (1972) 565; unconfirmed: from memory"


def _rubbers() -> tuple[Material, ...]:
    """Return silicones and natural rubber, without branches, because no source separates these from the rest."""
    wide, small = _TENSILE.format(upto=200), _TENSILE.format(upto=100)
    return (
        Material(
            name="Elastosil 2030",
            energy=neo_hookean,
            elastic=(
                _elastic(
                    "shear_modulus",
                    370e3,
                    250e3,
                    550e3,
                    "a third of an elastic modulus of 1.1 MPa; published ones lie from 0.8 to 1.6 MPa; unconfirmed: "
                    "from memory",
                ),
            ),
            permittivity=_permittivity(2.8, f"2.6 to 3.0, {_WACKER}"),
            breakdown=BreakdownLaw(
                field=80e6,
                thickness=100e-6,
                thickness_power=0.0,
                stretch_power=0.0,
                source=f"80 to 100 MV/m, {_WACKER}; no law of thickness or stretch is stated there",
            ),
            density=1080.0,
        ),
        Material(
            name="Sylgard 184",
            energy=neo_hookean,
            elastic=(
                _elastic(
                    "shear_modulus",
                    600e3,
                    200e3,
                    1.0e6,
                    "mixed 10:1; Varner & Cohen, Soft Matter 20 (2024), doi:10.1039/D4SM00573B, show that method and "
                    "curing move it by two orders of magnitude; tensile tests after usual curing lie here; the middle "
                    "is unconfirmed",
                ),
            ),
            permittivity=_permittivity(2.7, _SHEET),
            density=1030.0,
        ),
        Material(
            name="Sylgard 186",
            energy=gent,
            elastic=(
                _elastic("shear_modulus", 590e3, 300e3, 700e3, _AKBARI),
                _elastic("stretch_limit", 30.04, 15.0, 1e4, _AKBARI),
            ),
            permittivity=_permittivity(2.8, f"as the public code that quotes {_AKBARI.partition(';')[0]}"),
            density=1120.0,
        ),
        Material(
            name="Ecoflex 00-30",
            energy=yeoh,
            elastic=(
                _elastic("C1", 7.69e3, 6e3, 22e3, f"{wide}; {_SOROTOKI} has 7.6, 8.4 and 17 kPa"),
                _elastic("C2", 167.0, -500.0, 1e3, f"{wide}; {_SOROTOKI} has 242, 100 and -200 Pa"),
                _elastic("C3", -6.6, -20.0, 30.0, f"{wide}; {_SOROTOKI} has -0.6, 0 and 23 Pa"),
            ),
            permittivity=_permittivity(2.8, _SHEET),
            density=1070.0,
        ),
        Material(
            name="Dragon Skin 10",
            energy=yeoh,
            elastic=(
                _elastic("C1", 36e3, 20e3, 60e3, f"{_SOROTOKI}; the only source, so the range is a guess"),
                _elastic("C2", 250.0, -2e3, 5e3, f"{_SOROTOKI}; the only source, so the range is a guess"),
                _elastic("C3", 23.0, -200.0, 200.0, f"{_SOROTOKI}; the only source, so the range is a guess"),
            ),
            permittivity=_permittivity(2.8, _SHEET),
            density=1070.0,
        ),
        Material(
            name="Dragon Skin 30",
            energy=yeoh,
            elastic=(
                _elastic("C1", 91.7e3, 80e3, 170e3, f"{wide}; {_SOROTOKI} has 154 kPa"),
                _elastic("C2", 9.19e3, 0.0, 15e3, f"{wide}; {_SOROTOKI} has 1.6 kPa"),
                _elastic("C3", -362.0, -1e3, 100.0, f"{wide}; {_SOROTOKI} has 0"),
            ),
            permittivity=_permittivity(2.8, _SHEET),
            density=1080.0,
        ),
        Material(
            name="RTV 615",
            energy=gent,
            elastic=(
                _elastic("shear_modulus", 336e3, 250e3, 600e3, f"{small}; the range is a guess"),
                _elastic("stretch_limit", 7.46, 5.0, 1e4, small),
            ),
            permittivity=_permittivity(2.7, _SHEET),
            density=1020.0,
        ),
        Material(
            name="natural rubber",
            energy=ogden,
            elastic=(
                _elastic("mu1", 630e3, 300e3, 900e3, _TRELOAR),
                _elastic("alpha1", 1.3, 1.0, 2.5, _TRELOAR),
                _elastic("mu2", 1.2e3, 100.0, 5e3, _TRELOAR),
                _elastic("alpha2", 5.0, 4.0, 7.0, _TRELOAR),
                _elastic("mu3", -10e3, -50e3, 0.0, _TRELOAR),
                _elastic("alpha3", -2.0, -3.0, -1.0, _TRELOAR),
            ),
            permittivity=_permittivity(2.7, "handbooks: 2.4 to 3; unconfirmed: from memory"),
            density=950.0,
        ),
    )


_SOFT = "start of a fit: the middle of soft elastomers, from 10 kPa to 1 MPa"


def _unknown() -> tuple[Material, ...]:
    """Return, for each energy, an elastomer of which nothing else is known."""
    energies: dict[Callable[..., Any], tuple[Parameter, ...]] = {
        neo_hookean: (_elastic("shear_modulus", 100e3, 1e3, 2e6, _SOFT),),
        mooney_rivlin: (_elastic("C1", 40e3, 500.0, 1e6, _SOFT), _elastic("C2", 10e3, -100e3, 1e6, _SOFT)),
        yeoh: (
            _elastic("C1", 50e3, 500.0, 1e6, _SOFT),
            _elastic("C2", 100.0, -10e3, 100e3, _SOFT),
            _elastic("C3", 1.0, -100.0, 10e3, _SOFT),
        ),
        ogden: (_elastic("mu1", 100e3, 1e3, 2e6, _SOFT), _elastic("alpha1", 2.0, 0.5, 10.0, _SOFT)),
        gent: (_elastic("shear_modulus", 100e3, 1e3, 2e6, _SOFT), _elastic("stretch_limit", 100.0, 40.0, 1e4, _SOFT)),
        arruda_boyce: (
            _elastic("shear_modulus", 100e3, 1e3, 2e6, _SOFT),
            _elastic("locking_stretch", 6.0, 3.8, 1e4, _SOFT),
        ),
    }
    permittivity = _permittivity(3.0, "start of a fit: silicones have 2.5 to 3.2, acrylics 3.5 to 4.8")
    return tuple(
        Material(name=energy.__name__, energy=energy, elastic=elastic, permittivity=permittivity)
        for energy, elastic in energies.items()
    )


PUBLISHED: Mapping[str, Material] = MappingProxyType(
    {
        entry.name: entry
        for entry in (_common("VHB 4905"), _common("VHB 4910"), *_published(), *map(_in_rigs, _rubbers()))
    }
)
"""Published materials by name."""
UNKNOWN: Mapping[str, Material] = MappingProxyType({entry.name: entry for entry in _unknown()})
"""Materials by the name of their energy, with values from which a fit may start."""
