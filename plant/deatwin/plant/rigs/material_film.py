"""A rig's film made of a material: equilibrium energy, capacitance and the material's own branches."""

from __future__ import annotations

from deatwin.plant.builder import Builder
from deatwin.plant.film import AnyFilm, film_points, point_capacitances
from deatwin.plant.material import Material
from deatwin.plant.rigs.kinematics import Kinematics


def material_film(shape: Kinematics, substance: Material, rest_stretch: float, build: Builder) -> AnyFilm:
    """The film of a rig before any effect."""
    points = film_points(shape.points, build)
    elastic = [build.parameter(p.name) for p in substance.elastic]
    film = shape.film(
        points=points,
        elastic=sum(p.volume * substance.energy(*p.stretches, *elastic) for p in points),
        capacitances=point_capacitances(points, build.parameter("permittivity"), build.parameter("thickness")),
        rest_stretch=rest_stretch,
    )
    for branch in substance.branches:
        modulus, time = build.parameter(branch.modulus.name), build.parameter(branch.time.name)
        film = film.with_branch(branch.name, modulus, time, build)
    return film
