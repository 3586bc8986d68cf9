"""The plant of the thesis."""

from __future__ import annotations

from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.model import Plant
from deatwin.plant.rigs.diaphragm import Diaphragm

__all__ = ["thesis_plant"]


def thesis_plant() -> Plant:
    """The thesis' actuator: prestrained diaphragm, Maxwell stress, permittivity drift and hysteresis.

    Its 80 mm frame, 35 mm electrode, 3 g ball, gain of 800 and 50 Hz are the thesis'; "350 %" is taken as a
    stretch of 3.5. The thesis does not say how the ball sits: acrylic tape is tacky and no grease is named,
    so it is bonded, on a contact of 3 mm diameter. The material's values are the ones with which the
    membrane gives the reported stroke of about 1 mm at 3.75 V.

    Returns
    -------
    Plant

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
        rig=Diaphragm(contact_radius=1.5e-3, ball="bonded"),
        effects=(PermittivityDrift(), Hysteresis()),
        values={"shear_modulus": 25e3, "stretch_limit": 100.0, "permittivity": 4.5},
    )
