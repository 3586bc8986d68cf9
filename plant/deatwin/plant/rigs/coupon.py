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
    r"""Hyperelastic strip pulled uniaxially between two clamps; the reading is its force.

    .. math:: F = \frac{1}{L}\,\frac{d}{d\lambda}\Bigl[w H L\; W(\lambda, \lambda^{-1/2})\Bigr]

    F is the force, :math:`\lambda` the stretch, W the strain energy density; w, H and L are the width, thickness and
    length of the unstretched strip. An isotropic, incompressible strip with free sides contracts by
    :math:`\lambda^{-1/2}` in both directions, with or without relaxing branches, so the stretch alone determines the
    deformation. Each pull is a separate experiment, from rest at stretch 1. The simulation holds the stretch constant
    during each sample, and the reading is the force at the end of the sample, when the ramp of a real pull reaches this
    stretch. On average, the staircase therefore leads the ramp by half a sample. At 50 Hz, the lead changes the stress
    of a branch with a relaxation time of 2 s by 0.5 %.

    Width and thickness enter only through the area, which multiplies every modulus. If the source does not state them,
    a fit finds relaxation times and ratios of moduli, but not their absolute size.

    Parameters
    ----------
    material : str or Material
        Material, or its key in `deatwin.plant.MATERIALS`. The default is VHB 4910 without its branch: a strip whose
        relaxation is to be identified.
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
    """Rms error, N: 5 % of the 1 N with which a strip of 10 mm² resists. It covers the form of W and the clamps,
    between which the stretch is not uniform; good phenomenological models of VHB leave 4.5 % rms (Zou & Gu)."""

    kind: ClassVar[str] = "coupon"
    has_film: ClassVar[bool] = True
    input_name: ClassVar[str] = "stretch"
    input_unit: ClassVar[str] = "1"
    output_name: ClassVar[str] = "force"
    output_unit: ClassVar[str] = "N"
    follows_at_once: ClassVar[bool] = True
    sizes: ClassVar[Sizes] = Sizes(command=1.0, command_unit="1", reading=1.0, reading_unit="N")
    """The size of the command is the strip's own length, not its longest pull, so that no offset in range takes all of
    it away."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            *(p for p in self.substance.parameters if p is not self.substance.permittivity),
            Parameter(name="zero", value=0.0, unit="N", lower=-10.0, upper=10.0, source="load cell's offset"),
        )

    @classmethod
    def from_rig_file(cls, described: RigFile) -> Self:
        """Make the strip `described` by a rig file, with the relative model error of the default strip."""
        names = {field.name for field in fields(cls)}
        shared = {name: value for name, value in described.shared.items() if name in names}
        rig = cls(**{**shared, **described.film})
        usual = cls()
        force = rig.width * rig.thickness * rig.substance.shear_modulus
        return replace(
            rig, model_error=usual.model_error * force / (usual.width * usual.thickness * RELAXED.shear_modulus)
        )

    @property
    def start(self) -> StartProcedure:
        """Start of an experiment: from rest at stretch 1, with the first command."""
        return StartProcedure(rest_command=1.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Symbol:
        pulled = build.watch("stretch", build.place(Place.DRIVE, "command", build.command))
        # The force is the derivative by a virtual pull, because the stretch itself may be an expression by now.
        virtual = build.constant("virtual_pull", 0.0)
        stretch = pulled + virtual
        volume = build.constant("volume", self._volume)
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

    @property
    def _volume(self) -> float:
        return self.width * self.thickness * self.length


def _uniaxial(stretch: Symbol) -> list[tuple[Symbol, Symbol]]:
    return [(stretch, stretch**-0.5)]
