"""Constitutive laws of films: energies, electrostatics, permittivity and breakdown."""

from deatwin.plant.laws.breakdown import HUANG_2012, KOFOD_2001, BreakdownLaw
from deatwin.plant.laws.dielectric import (
    VACUUM_PERMITTIVITY,
    capacitance,
    conduction_density,
    effective_permittivity,
    electric_energy,
    electrostriction_factors,
    electrostrictive_strain,
    maxwell_strain,
    maxwell_stress,
)
from deatwin.plant.laws.energies import (
    arruda_boyce,
    first_invariant,
    gent,
    maxwell_branch,
    mooney_rivlin,
    neo_hookean,
    ogden,
    second_invariant,
    yeoh,
)
from deatwin.plant.laws.formula import Formula
from deatwin.plant.laws.permittivity import relaxing, stretched

__all__ = [
    "HUANG_2012",
    "KOFOD_2001",
    "VACUUM_PERMITTIVITY",
    "BreakdownLaw",
    "Formula",
    "arruda_boyce",
    "capacitance",
    "conduction_density",
    "effective_permittivity",
    "electric_energy",
    "electrostriction_factors",
    "electrostrictive_strain",
    "first_invariant",
    "gent",
    "maxwell_branch",
    "maxwell_strain",
    "maxwell_stress",
    "mooney_rivlin",
    "neo_hookean",
    "ogden",
    "relaxing",
    "second_invariant",
    "stretched",
    "yeoh",
]
