"""A plant along its free run. The states of a foreign model are unknown: something may enter the reading only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.greybox.filter_linear import Linear, with_equations
from deatwin.ident.greybox.filter_openings import READING, Opening
from deatwin.ident.greybox.parts import Part
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant


def linearise(plant: Plant, parts: Sequence[Part], openings: Sequence[Opening] | None = None) -> tuple[Linear, ...]:
    """Linearise a plant along its free run; of a model written elsewhere, only the reading is known."""
    if plant.rig.equations_known:
        return with_equations(plant, parts, openings)
    return tuple(readings_alone(plant, part) for part in parts)


def readings_alone(plant: Plant, part: Part) -> Linear:
    """Linearisation without states, with the readings' derivatives by the parameters."""
    timeline, rig = plant.timeline(part.experiment), plant.rig
    at = part.counted(timeline)
    n = int(at.max()) + 1
    run = plant.runner.run_with_sensitivities(**plant.given(timeline, n))
    if not run.status.ok or run.sensitivities is None:
        raise SimulationError(run.advice)
    slopes = [p.scale.slope(p.value) for p in (plant.parameters[name] for name in plant.parameters.free)]
    residual = np.full(n, np.nan)
    later = at >= 0
    residual[at[later]] = part.measured[later] - run.outputs[at[later] + 1]
    place, signal = READING
    return Linear(
        plant=plant,
        state_names=(),
        openings=(Opening(place=place, signal=signal),),
        timepts=timeline.start + timeline.sample_time * np.arange(1.0, n + 1),
        residual=residual,
        transition=np.empty((n, 0, 0)),
        by_parameter=np.empty((n, 0, len(slopes))),
        rows=np.empty((n, 0)),
        rows_by_parameter=run.sensitivities[1:] * slopes,
        start_by_parameter=np.empty((0, len(slopes))),
        entering=np.empty((n, 0, 1)),
        rows_entering=np.ones((n, 1)),
        states={rig.input_name: timeline.commands[:n], rig.output_name: run.outputs[1:]},
        counts=np.isfinite(residual).astype(float),
        interval=timeline.sample_time,
    )
