"""The rig of the thesis: a prestrained film in a ring, an electrode disc, and a ball that loads its centre."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.laws.stress import nominal_stress
from deatwin.plant.limits import watch_limits
from deatwin.plant.material import Material, material
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import Rig, StartProcedure
from deatwin.plant.rigs.film_actuator import SETTLING, memories, relaxed_stresses, zero_of
from deatwin.plant.rigs.kinematics import material_film, squared_voltage
from deatwin.plant.rigs.membrane import membrane
from deatwin.plant.rigs.reduced import reduced
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.scaling import Mounted, scaled_to_film

GRAVITY = 9.80665
BALLS = ("bonded", "sliding")
THESIS_PRESTRETCHES = (3.5, 4.5)  # Possible prestretches of the thesis' films; it leaves open which one they had
LEAST = 1.05  # Least stretch for which the sag at the start of the search for rest is that of a linear film
RESOLUTIONS = {"reduced": reduced, "fine": membrane}

Symbol = Any
Ball = str  # ``"bonded"``: the film sticks to the ball; ``"sliding"``: it slides on it without friction


@dataclass(frozen=True, kw_only=True)
class Diaphragm(Rig):
    """Prestretched film in a ring, with a ball on the centre of the film; the reading is the ball's displacement.

    Parameters
    ----------
    material : str or Material
        Material, or its key in `deatwin.plant.MATERIALS`.
    thickness : float
        Thickness of the film before stretching, m.
    prestretch : float
        Equal-biaxial stretch of the mounted film.
    frame_radius, electrode_radius, contact_radius : float
        Radius of the ring, of the electrode at rest, and of the film's contact with the ball, m.
    mass : float
        Mass of the ball, kg.
    gain : float
        Gain of the amplifier: film volts per command volt.
    start_ramp, start_hold : float
        Duration of the ramp and of the hold in the start procedure, s; see `StartProcedure`.
    start_is_known : bool
        False if the history of the film before the first sample is unknown. Then the start procedure is ignored, and
        the initial values of slow states, such as ``branch_at_start`` or ``creep.at_start``, are fitted.
    zero_is_known : bool
        False if the sensor's zero is arbitrary; True if the zero is near the position without voltage.
    direction : float
        1 if the reading grows with the displacement, -1 if it falls, as with a sensor on the other side.
    ball : {"bonded", "sliding"}
        Contact between film and ball: the film sticks to the ball, or slides on it without friction.
    ball_is_known : bool
        True if the experimenter is sure of `ball`; otherwise a diagnosis also tries the other contact.
    prestretch_is_known : bool
        True if the experimenter is sure of `prestretch`; otherwise a diagnosis also tries 3.5 or 4.5, whichever differs
        more from `prestretch`.
    resolution : {"reduced", "fine"}
        Discretisation of the film. ``"reduced"`` describes its shape by a few coordinates. ``"fine"`` uses axisymmetric
        finite elements, with Maxwell branches that relax independently at each point. For a film with Maxwell branches
        and a prestretch below 1.5, use ``"fine"``.
    elements : int
        Number of elements under the electrode, for ``"fine"``; the annulus around the electrode has half as many.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.
    """

    material: str | Material = "VHB 4905"
    thickness: float = 0.5e-3
    prestretch: float = 3.5
    frame_radius: float = 40e-3
    electrode_radius: float = 17.5e-3
    contact_radius: float = 3e-3
    mass: float = 3e-3
    gain: float = 800.0
    start_ramp: float = 2.0
    start_hold: float = 3.0
    ball: Ball = "sliding"
    ball_is_known: bool = False
    start_is_known: bool = True
    zero_is_known: bool = True
    direction: float = 1.0
    prestretch_is_known: bool = True
    resolution: str = "reduced"
    elements: int = 4
    sample_time: float = 0.02
    noise: float = 2e-6
    model_error: float = 1e-6
    """Rms error, m, for a real rig that differs from the equations in unknown ways. In simulations, another mesh and
    another viscous law of the film caused an error of 0.4 to 0.8 µm."""

    kind: ClassVar[str] = "diaphragm"
    has_film: ClassVar[bool] = True
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"
    model_share: ClassVar[float] = 0.01
    """Rms error of the equations divided by the standard deviation of the reading; largest at the highest voltages."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, known in (("ball", BALLS), ("resolution", RESOLUTIONS)):
            if (value := getattr(self, name)) not in known:
                raise RigError(f"unknown {name} {value!r}{nearest(value, known)} (known: {', '.join(known)})")

    @property
    def body(self) -> str:
        """Name of the moving part for sentences: ``ball``."""
        return "ball"

    def scaled(self, effect: Effect) -> Effect:
        """Return an effect of the catalogue with lengths, forces and commands in proportion to those of this rig."""
        thickness = self.thickness / self.prestretch**2
        return scaled_to_film(effect, self, Mounted(gain=self.gain, thickness=thickness, size=self.frame_radius))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        known: dict[str, Any] = {"source": "rig file", "known": True}
        return (
            *self._material.parameters,
            Parameter(
                name="damping",
                value=0.05,
                unit="N s/m",
                lower=1e-4,
                upper=2.0,
                scale=Scale.LOGARITHMIC,
                source="damping ratio 0.03 to 0.08 of the ball on the film",
            ),
            zero_of(1e-3, self.zero_is_known),
            Parameter(name="mass", value=self.mass, unit="kg", lower=1e-6, upper=1.0, **known),
            Parameter(name="gain", value=self.gain, unit="V/V", lower=1e-3, upper=1e5, **known),
            Parameter(name="thickness", value=self.thickness, unit="m", lower=1e-6, upper=0.1, **known),
        )

    @property
    def start(self) -> StartProcedure:
        """Start at rest at 0 V, with ramp and hold; if the start is unknown, the first command is held for 1 s."""
        known = StartProcedure(rest_command=0.0, ramp=self.start_ramp, hold=self.start_hold)
        return known if self.start_is_known else SETTLING

    def starts_of(self, effects: tuple[Effect, ...]) -> tuple[Parameter, ...]:
        return () if self.start_is_known else memories(self._material, effects)

    def rivals(self) -> tuple[Self, ...]:
        """Return the other rig variants: one with the reading at the other end of the hold, one with the other contact if
        the contact is unknown, and one with the other prestretch if the prestretch is unknown.
        """
        rivals = list(super().rivals())
        if not self.ball_is_known:
            other = "sliding" if self.ball == "bonded" else "bonded"
            rivals.append(replace(self, ball=other))
        if not self.prestretch_is_known:
            farther = max(THESIS_PRESTRETCHES, key=lambda stretch: abs(stretch - self.prestretch))
            rivals.append(replace(self, prestretch=farther))
        return tuple(rivals)

    def finer(self) -> Diaphragm:
        """Return the rig with the resolution ``"fine"``, or with twice as many elements if it is already fine."""
        if self.resolution == "fine":
            return replace(self, elements=2 * self.elements)
        return replace(self, resolution="fine")

    def write(self, build: Builder) -> Symbol:
        deflection = build.state("deflection", scale=1e-3)
        velocity = build.watch("velocity", build.state("velocity", scale=0.05))
        displacement = build.watch("displacement", deflection - build.at_rest("rest_deflection", deflection))
        shape = RESOLUTIONS[self.resolution](self, deflection, build)
        film = build.place(Place.FILM, "film", material_film(shape, self._material, (self.prestretch,) * 2, build))
        squared = squared_voltage(build.share("film", film), build, self.supply)
        watch_limits(film, squared, build)

        mass = build.parameter("mass")
        friction = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        forces = film.force(ca.vertcat(deflection, *shape.coordinates), squared)
        build.rate(deflection, velocity)
        build.rate(velocity, (mass * GRAVITY - forces[0] + friction) / mass)
        for number in range(len(shape.coordinates)):
            build.balance(forces[1 + number] / mass)
        build.guess(deflection, self.sag(self.contact_radius, build))
        return build.place(Place.SENSOR, "reading", self.direction * displacement + build.parameter("zero"))

    def sag(self, radius: float, build: Builder) -> Symbol:
        r"""Return the approximate sag of the film at rest, :math:`z = mg\ln(B/r)/(2\pi N)`.

        m is the mass of the ball, g the gravity and B the radius of the ring. N is the tension (force per length) of
        the uniformly stretched film, computed at the prestretch or at 1.05, whichever is larger. The search for the
        equilibrium starts from this sag.

        Parameters
        ----------
        radius : float
            r, the radius in the mounted film, m.
        build : Builder
            Builder that holds the parameters.

        Returns
        -------
        casadi.SX
            Sag, m.
        """
        elastic = (build.own(parameter.name) for parameter in self._material.elastic)
        stretch = max(self.prestretch, LEAST)
        stress, _ = nominal_stress(self._material.energy, stretch, stretch, *elastic)
        tension = stress * build.own("thickness") / stretch
        return build.own("mass") * GRAVITY / (2 * np.pi * tension) * np.log(self.frame_radius / radius)

    @cached_property
    def _material(self) -> Material:
        return material(self.material)

    @classmethod
    def from_rig_file(cls, described: RigFile) -> Self:
        """Make the rig from a rig file.

        Parameters
        ----------
        described : RigFile
            Content of the rig file, from `read_rig`.

        Returns
        -------
        Diaphragm
            Rig. `ball_is_known` is False if the rig file does not state the contact. `noise` includes the rounding to
            the sensor's resolution.
        """
        film, load = described.film, described.load
        rig = cls(
            **described.shared,
            thickness=film["thickness"],
            prestretch=film["prestretch"],
            frame_radius=film["frame_diameter"] / 2,
            electrode_radius=film["electrode_diameter"] / 2,
            contact_radius=load["contact_diameter"] / 2,
            mass=load["mass"],
            ball=film.get("ball", cls.ball),
            ball_is_known="ball" in film,
        )
        relaxed_stresses(rig._material, rig.prestretch, rig.prestretch)  # refuses a prestretch beyond the film's limit
        return rig
