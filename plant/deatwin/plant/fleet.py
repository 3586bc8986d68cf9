"""Six simulated actuators of one specification, with different fabrications and histories.

Their means move as those of the thesis' six actuators do (section 2.3.2), each by named physics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from deatwin.plant.arrays import require_seed
from deatwin.plant.chain import MeasuringChain
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.charge_injection import ChargeInjection
from deatwin.plant.effects.creep import Creep
from deatwin.plant.effects.electrode_loss import ElectrodeLoss
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.effects.prestretch_relaxation import PrestretchRelaxation
from deatwin.plant.effects.thermal_stiffness import ThermalStiffness
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.grease_ridge import GreaseRidge
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.diaphragm import Diaphragm

DURATION = 1100.0  # Length of each of the thesis' recordings, s


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Fabrication tolerance of a quantity, which is uniformly distributed about its nominal value.

    Parameters
    ----------
    share : float
        Largest deviation from the nominal value, up or down, divided by the nominal value.
    reason : str
        Reason for the size of the tolerance.
    """

    share: float
    reason: str


TOLERANCES: Mapping[str, Tolerance] = MappingProxyType(
    {
        "thickness": Tolerance(
            share=0.025, reason="one roll; between rolls 3M gives ±15 % for the 0.4 mm tape of the family (4920)"
        ),
        "prestretch": Tolerance(share=0.015, reason="a circle of 23 mm drawn on the tape to ±0.3 mm before stretching"),
        "electrode_radius": Tolerance(share=0.03, reason="grease brushed by hand inside a mask, ±0.5 mm"),
        "contact_radius": Tolerance(share=0.1, reason="how far the ball sinks into film and grease"),
        "mass": Tolerance(share=0.005, reason="grease that sticks to a bearing ball"),
        "shear_modulus": Tolerance(share=0.03, reason="1 to 2 K of room temperature, and the hours since stretching"),
        "stretch_limit": Tolerance(share=0.03, reason="as the modulus: both are the network's"),
        "branch_modulus": Tolerance(share=0.1, reason="sets fitted to tapes of one kind differ by much more"),
        "branch_time": Tolerance(share=0.15, reason="falls by 15 % with each kelvin (WLF at 20 °C)"),
        "permittivity": Tolerance(share=0.03, reason="humidity, and grease that migrates into the tape"),
        "damping": Tolerance(share=0.2, reason="grease at the ball"),
        "hysteresis.force": Tolerance(share=0.2, reason="grease at the ball"),
    }
)
"""Tolerances that an experimenter would not notice before the first recording. Sizes without a source are assumed,
because the thesis gives none."""


@dataclass(frozen=True, kw_only=True)
class History:
    """Changes of an actuator during its recording.

    Parameters
    ----------
    story : str
        Sentence that describes how the reading changes, and why.
    effects : tuple of Effect
        Effects that cause the changes.
    """

    story: str
    effects: tuple[Effect, ...]


HISTORIES: tuple[History, ...] = (
    History(
        story="The mean falls, as the permittivity relaxes; from 10 to 30 s the ball runs over a ridge of grease.",
        effects=(PermittivityDrift(relative_change=-0.09, time=400.0), GreaseRidge()),
    ),
    History(
        story="The mean rises, as the tension of a film that had not rested long enough relaxes.",
        effects=(PrestretchRelaxation(relative_loss=0.06, time=1000.0),),
    ),
    History(
        story="The mean rises, as the film creeps under its mean load and takes up moisture, which polarises.",
        effects=(Creep(modulus=42e3, time=400.0), PermittivityDrift(relative_change=0.06, time=700.0)),
    ),
    History(
        story="The mean swings to and fro, as the modulus follows a room that is heated by a thermostat.",
        effects=(ThermalStiffness(change_per_kelvin=-0.02, period=550.0, phase=-np.pi / 2),),
    ),
    History(
        story="The mean falls in the first minutes, as charge enters the film, and then rises, as the tension relaxes.",
        effects=(ChargeInjection(share=0.08, time=100.0), PrestretchRelaxation(relative_loss=0.06, time=1200.0)),
    ),
    History(
        story="A quick shift, then steady: at 45 s a part of the electrode's rim loses contact.",
        effects=(ElectrodeLoss(share=0.5, at=45.0),),
    ),
)
"""Histories of the six actuators; sizes and times lie in the typical ranges of the effects."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuator:
    """One of six simulated actuators with the same nominal plant; see `fleet`.

    Parameters
    ----------
    name : str
        ``DEA 1`` to ``DEA 6``.
    plant : Plant
        Plant with this actuator's values, which deviate from the nominal ones within the tolerances of fabrication, and
        with the effects that change the actuator during its recording.
    story : str
        Sentence that describes how the reading changes, and why.
    seed : tuple of int
        Seed of the excitation and of the sensor noise.
    """

    name: str
    plant: Plant
    story: str
    seed: tuple[int, ...]

    def excitation(self, duration: float = DURATION) -> Experiment:
        """Return an experiment with the thesis' noise commands of a `duration` in s, and with readings of zero.

        Each actuator and each duration has its own noise.
        """
        step = self.plant.rig.sample_time
        commands = band_limited_noise(np.random.default_rng((*self.seed, 1)), duration, step)
        return Experiment(recordings=(Recording.from_arrays(commands, np.zeros_like(commands), step),))

    def record(self, experiment: Experiment | None = None, rng: np.random.Generator | None = None) -> Experiment:
        """Record this actuator.

        Parameters
        ----------
        experiment : Experiment, optional
            Experiment whose commands and clock are used; by default, the result of `excitation`.
        rng : numpy.random.Generator, optional
            Random generator for the sensor noise; by default, a new one from `seed`.

        Returns
        -------
        Experiment
            Experiment with readings, m.

        Raises
        ------
        SimulationError
            If the simulation fails, for example because the film pulls in.
        """
        own = np.random.default_rng((*self.seed, 2)) if rng is None else rng
        return self.plant.record(self.excitation() if experiment is None else experiment, own)


def specification() -> Plant:
    """Return the nominal plant of the six simulated actuators in `fleet`.

    Returns
    -------
    Plant
        The plant `thesis_plant` without drift, with the drive and the sensor of a `MeasuringChain`. Hysteresis is its
        only effect.
    """
    nominal, chain = thesis_plant(), MeasuringChain()
    rig = replace(nominal.rig, chain=chain, noise=chain.noise)
    return Plant(rig=rig, effects=(Hysteresis(),), values=nominal.values)


def fleet(seed: int = 0) -> tuple[Actuator, ...]:
    """Return six simulated actuators with the same nominal plant but different fabrication and history.

    The dimensions and material values of each actuator are drawn within fabrication tolerances. In addition, each
    actuator changes during its recording, for example by drift or creep: this is its history.

    Parameters
    ----------
    seed : int
        Seed of fabrication, excitation and sensor noise. The six histories do not depend on the seed.

    Returns
    -------
    tuple of Actuator
        Six actuators, ``DEA 1`` to ``DEA 6``.

    Raises
    ------
    ModelError
        If the seed is not an integer of at least 0.

    References
    ----------
    W. R. Jacobs, "Identification and Frequency Response Analysis with Application to Soft Smart Actuators",
    University of Sheffield, section 2.3.2.

    Examples
    --------
    >>> [actuator.name for actuator in fleet()]
    ['DEA 1', 'DEA 2', 'DEA 3', 'DEA 4', 'DEA 5', 'DEA 6']
    """
    require_seed(seed)
    return tuple(
        Actuator(
            name=f"DEA {number}",
            plant=fabricated(np.random.default_rng((seed, number, 0))).with_effects(*history.effects),
            story=history.story,
            seed=(seed, number),
        )
        for number, history in enumerate(HISTORIES, start=1)
    )


def fabricated(rng: np.random.Generator, wider: float = 1.0) -> Plant:
    """Fabricate an actuator: each quantity is drawn within its tolerance times `wider`."""
    wished = specification()
    factors = {name: 1 + wider * t.share * rng.uniform(-1, 1) for name, t in TOLERANCES.items()}
    geometry = {n: f * getattr(wished.rig, n) for n, f in factors.items() if hasattr(wished.rig, n)}
    values = {n: f * wished.parameters[n].value for n, f in factors.items() if n not in geometry}
    return wished.with_rig(replace(wished.rig, **geometry)).with_values(values)


def thesis_plant() -> Plant:
    """Return the actuator of W. R. Jacobs' thesis: prestretched diaphragm with permittivity drift and hysteresis.

    The 80 mm frame, the 35 mm electrode, the 3 g ball, the gain of 800 and the sampling rate of 50 Hz are from the
    thesis. The prestretch of "350 %" in the thesis is taken as a stretch of 3.5. The thesis does not state the contact
    between film and ball; here the film slides on the ball. The material values were chosen so that the simulation
    gives the reported displacement: about a millimetre at 3 kV, and nearly linear in the command below 2.5 V. Up to
    3 kV, the displacement agrees within 2 % with that of a finite-element membrane.

    References
    ----------
    W. R. Jacobs, "Identification and Frequency Response Analysis with Application to Soft Smart Actuators",
    University of Sheffield, chapter 2.

    Examples
    --------
    >>> thesis_plant().effect_names
    ('hysteresis', 'permittivity_drift')
    """
    return Plant(
        rig=Diaphragm(contact_radius=1.5e-3, ball="sliding"),
        effects=(PermittivityDrift(), Hysteresis()),
        values={"shear_modulus": 25e3, "stretch_limit": 100.0, "permittivity": 4.5},
    )
