"""Result of a calibration: reported parameters, and effects with their values."""

from __future__ import annotations

from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.verdict import FittedParameter
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant


def fitted_parameters(nominal: Plant, fit: Calibration) -> dict[str, FittedParameter]:
    """Return each fitted parameter with its interval and its nominal value.

    Parameters
    ----------
    nominal : Plant
        Before the calibration.
    fit : Calibration
        Of the same plant, perhaps in another variant.

    Returns
    -------
    dict of str to FittedParameter
        By name, in the order of the fit.
    """
    found = {}
    for name in fit.names:
        parameter, (low, high) = fit.plant.parameters[name], fit.interval(name)
        before = nominal.parameters[name].value if name in nominal.parameters else None
        found[name] = FittedParameter(
            value=parameter.value,
            low=low,
            high=high,
            unit=parameter.unit,
            nominal=before,
            at_bound=name in fit.at_bound,
            undetermined=not fit.is_determined(name),
        )
    return found


def fitted_effect(plant: Plant, name: str) -> Effect:
    """Return an effect of a plant with the plant's values.

    Parameters
    ----------
    plant : Plant
        Calibrated.
    name : str
        Canonical name of the effect.

    Returns
    -------
    Effect
    """
    effect = next(e for e in plant.effects if e.name == name)
    return replace(effect, **{p.name: plant.parameters[f"{name}.{p.name}"].value for p in effect.describe()})
