"""Strip in a tensile test: stretch in, force out. It calibrates a material without voltage."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.film import Film, FilmPoint
from deatwin.plant.material import Material, material
from deatwin.plant.parameters import Parameter
from deatwin.plant.rigs.base import Rig, StartProcedure
from deatwin.plant.rigs.kinematics import with_branches
from deatwin.plant.rigs.rigfile import RigFile

Symbol = Any
RELAXED = replace(material("VHB 4910"), branches=())  # Default material: purely elastic


@dataclass(frozen=True, kw_only=True)
class Coupon(Rig):
    r"""Hyperelastic strip pulled uniaxially between two clamps; the reading is the pulling force.

    .. math:: F = \frac{1}{L}\,\frac{d}{d\lambda}\Bigl[w H L\; W(\lambda, \lambda^{-1/2})\Bigr]

    F is the force, :math:`\lambda` the stretch and W the strain energy density; w, H and L are the width, thickness and
    length of the unstretched strip. The sides are free, so that the strip contracts to :math:`\lambda^{-1/2}` in width
    and in thickness. Each pull is a separate experiment, which starts at rest at a stretch of 1.

    The command is the stretch. The simulation holds it constant during each sample, whereas the stretch of a real strip
    rises steadily and reaches this value at the end of the sample. The simulated stretch therefore leads the real
    stretch by half a sample on average. At 50 Hz, this changes the stress of a Maxwell branch with a relaxation time of
    2 s by 0.5 %.

    If width and thickness are unknown, a fit finds the relaxation times and the ratios of the moduli, but not the
    moduli themselves: the force is proportional to the cross-section and to all moduli.

    Parameters
    ----------
    material : str or Material
        Material, or its key in `deatwin.plant.MATERIALS`; by default, VHB 4910 without Maxwell branches.
    width, thickness, length : float
        Dimensions of the unstretched strip between the clamps, m.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.
    """

    material: str | Material = RELAXED
    width: float = 10e-3
    thickness: float = 1e-3
    length: float = 80e-3
    sample_time: float = 0.02
    noise: float = 1e-3
    model_error: float = 0.05
    """Rms error of the equations, N: 5 % of a force of 1 N on a strip of 10 mm². It includes the error of W and the
    uneven stretch near the clamps. Published models of VHB leave an rms error of 4.5 % (Zou & Gu)."""

    kind: ClassVar[str] = "coupon"
    has_film: ClassVar[bool] = True
    input_name: ClassVar[str] = "stretch"
    input_unit: ClassVar[str] = "1"
    output_name: ClassVar[str] = "force"
    output_unit: ClassVar[str] = "N"
    follows_at_once: ClassVar[bool] = True
    sizes: ClassVar[Sizes] = Sizes(command=1.0, command_unit="1", reading=1.0, reading_unit="N")
    """The typical command is the stretch of the unstretched strip, because the ranges of effects are scaled to it: an
    effect's offset of the command is then always smaller than the stretch."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            *(p for p in self.substance.parameters if p is not self.substance.permittivity),
            Parameter(name="zero", value=0.0, unit="N", lower=-10.0, upper=10.0, source="load cell's offset"),
        )

    @classmethod
    def from_rig_file(cls, described: RigFile) -> Self:
        """Make the strip `described` by a rig file, with the relative model error of the default strip if it states none."""
        names = {field.name for field in fields(cls)}
        shared = {name: value for name, value in described.shared.items() if name in names}
        rig = cls(**{**shared, **described.film})
        if "model_error" in shared:
            return rig
        usual = cls()
        force = rig.width * rig.thickness * rig.substance.shear_modulus
        return replace(
            rig, model_error=usual.model_error * force / (usual.width * usual.thickness * RELAXED.shear_modulus)
        )

    @property
    def start(self) -> StartProcedure:
        """Start of an experiment: at rest at a stretch of 1, without a ramp."""
        return StartProcedure(rest_command=1.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Symbol:
        pulled = build.watch("stretch", build.place(Place.DRIVE, "command", build.command))
        # The force is the derivative by a virtual pull, because the stretch itself may be an expression by now.
        virtual = build.constant("virtual_pull", 0.0)
        stretch = pulled + virtual
        volume = build.constant("volume", self.width * self.thickness * self.length)
        elastic = [build.parameter(p.name) for p in self.substance.elastic]
        strip = Film(
            points=[FilmPoint(volume=volume, stretches=_uniaxial(stretch)[0])],
            elastic=volume * self.substance.energy(*_uniaxial(stretch)[0], *elastic),
            relaxed=_uniaxial,
            prestretches=(1.0, 1.0),
        )
        strip = with_branches(strip, self.substance, build)
        stored = build.place(Place.FILM, "film", strip).stored
        force = build.watch("force", ca.gradient(stored, virtual) / build.constant("length", self.length))
        return build.place(Place.SENSOR, "reading", force + build.parameter("zero"))

    @cached_property
    def substance(self) -> Material:
        """The material with its published values."""
        return material(self.material)


def _uniaxial(stretch: Symbol) -> list[tuple[Symbol, Symbol]]:
    return [(stretch, stretch**-0.5)]
