r"""No plant gives more work than it was given: at any time the work of the source is at least what the field holds.

The source does ``V_k (Q_k - Q_{k-1})`` in a sample. Rest at 0 V is where the plant's mechanical energy is least, so

.. math:: \sum_k V_k\,\Delta Q_k \ge \tfrac12 C V^2

at every time, for whatever command, if each part is passive: what it stores it can give back, no more. The film's
charge is C V here, so effects that add charge to it or take some away are not audited by it: ``electrode_rc`` is, in
tests/validation/test_energy.py; ``leakage`` only takes (its drop has the sign of its current); of ``charge_injection``
and ``dielectric_absorption`` the plant has the stress and not the charge, so they have no balance of work to close and
count as not admissible.
"""

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from deatwin.plant import Diaphragm, Experiment, Plant, Recording, Scale, effect_named

PASSIVE = (
    "creep",
    "strain_stiffening",
    "mullins",
    "permittivity_stretch",
    "hysteresis",
    "coulomb_friction",
    "quadratic_damping",
    "end_stop",
    "cubic_stiffness",
    "resonance",
    "relaxation",
)
"""Their parameters are constant and they are thermodynamically admissible. Where a parameter changes in time, driven from
outside, as in ``prestretch_relaxation``, pumping it in step with the command would give work."""
CLOSED = 1e-6


pytestmark = pytest.mark.usefixtures("uncompiled")


def ledger(plant: Plant, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Work of the source so far less the energy of the field, and the work done in both directions so far, J."""
    blank = Recording.from_arrays(commands, np.zeros(commands.size), plant.rig.sample_time, start=5.0)
    simulation = plant.simulate(Experiment(recordings=(blank,)))
    if not simulation.status.ok:
        reject()
    seen = simulation.watched[0]
    charge = seen["capacitance"] * seen["film_voltage"]
    voltage = plant.rig.gain * commands[1:]
    work = voltage * np.diff(charge)
    return np.cumsum(work) - seen["capacitance"][1:] * voltage**2 / 2, np.cumsum(np.abs(work))


def drawn(data, name: str) -> Plant:
    """An effect with each parameter between a quarter and four times its typical value, inside its range."""
    values = {}
    for parameter in effect_named(name).parameters:
        factor = 4.0 ** data.draw(st.floats(-1.0, 1.0), label=parameter.name)
        lower = parameter.lower if parameter.scale is Scale.LINEAR else max(parameter.lower, 1e-300)
        values[parameter.name] = float(np.clip(parameter.value * factor, lower, parameter.upper))
    rig = Diaphragm(contact_radius=1.5e-3, start_ramp=0.0, start_hold=0.0)
    return Plant(rig=rig).with_effects(effect_named(name)).with_values(values)


@pytest.mark.parametrize("name", PASSIVE)
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_no_command_draws_work_from_a_passive_effect(name, data):
    plant = drawn(data, name)
    levels = data.draw(st.lists(st.floats(-2.8, 2.8), min_size=4, max_size=6), label="levels")
    hold = data.draw(st.integers(1, 8), label="samples held")
    # begins with rest, so that the ledger counts from there
    commands = np.concatenate([[0.0, 0.0], np.repeat([*levels, 0.0], hold)])
    margin, both_ways = ledger(plant, commands)
    assert (margin >= -CLOSED * both_ways[-1]).all()


def test_a_parameter_that_is_changed_from_outside_can_give_work():
    # The clock is at 5 s, a quarter of the period, when the command begins. A film that is stiffened while it is
    # stretched, and softened while it is not, gives work, and this audit must see it.
    plant = Plant(rig=Diaphragm(contact_radius=1.5e-3, start_ramp=0.0, start_hold=0.0))
    swinging = plant.with_effects(effect_named("thermal_stiffness")).with_values(
        {
            "thermal_stiffness.change_per_kelvin": 0.2,
            "thermal_stiffness.period": 20.0,
            "thermal_stiffness.phase": np.pi / 2,
            "damping": 1.0,
            "branch_modulus": 1.0,
        }
    )
    angle = 2 * np.pi * 0.02 / 20.0 * np.arange(3000)
    gained = []
    for sign in (1.0, -1.0):
        margin, _ = ledger(swinging, np.concatenate([[0.0, 0.0], 1.8 + sign * np.sin(angle)]))
        gained.append(margin[-1] - margin[-1001])  # over the last period, after which all is as before
    assert min(gained) < 0.0 < max(gained)
