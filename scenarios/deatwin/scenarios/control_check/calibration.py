"""The specification, fitted to a recording: what stands for the actuator where nobody has its plant."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.greybox.parts import Part
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.fleet import specification
from deatwin.plant.recording import Experiment, Recording

CALIBRATED = ("permittivity", "shear_modulus", "branch_modulus", "damping", "hysteresis.force")
"""What a bench knows least."""


def calibrated(recording: Recording) -> CalibratedPlant:
    """The specification, its least known parameters fitted."""
    wished = specification()
    part = Part.whole(Experiment(recordings=(recording,)))
    fit = calibrate(wished, [part], names=CALIBRATED, starts=1, evaluations=30, tolerance=1e-4)
    left = float(np.sqrt(np.mean(fit.residuals**2)))
    return CalibratedPlant(
        plant=fit.plant, noise=wished.rig.noise, model_error=left, names=fit.names, covariance=fit.covariance
    )
