"""The plant of the thesis."""

from __future__ import annotations

from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.model import Plant
from deatwin.plant.rigs.diaphragm import Diaphragm


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
