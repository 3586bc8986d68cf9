"""Electrical work in equals what is stored and what is dissipated; no cycle gives work away.

The command is held over each sample, so the source does the work ``V_k (Q_k - Q_{k-1})`` in it exactly. What the
damper, the branch and the leads dissipate is integrated as a further state, with the order of the integrator.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from deatwin.plant import Diaphragm, ElectrodeRC, Plant
from deatwin.plant.builder import Builder
from deatwin.plant.equations import Equations
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.film import FilmPoint, point_capacitances
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.laws.energies import neo_hookean
from deatwin.plant.rigs.diaphragm import GRAVITY
from deatwin.plant.simulate import Simulator

SAMPLE_TIME = 0.02
CLOSED = 1e-6
"""Demanded closure of the balance, relative to the work that the source did and took back."""
SLIDING = Plant(rig=Diaphragm(contact_radius=1.5e-3, ball="sliding"))

pytestmark = pytest.mark.usefixtures("uncompiled")


def audited(plant: Plant) -> Equations:
    """The equations with the plant's energy, its charge, and what damper, branch and leads dissipate."""
    build = Builder(plant.parameters, plant.effects)
    reading = plant.rig.write(build)
    film, velocity, voltage = build.signal("film"), build.signal("velocity"), build.signal("film_voltage")
    mass = build.own("mass")
    held = film.stored + mass * velocity**2 / 2 - mass * GRAVITY * build.written.states["deflection"][0]
    build.watch("held", held + film.capacitance * voltage**2 / 2)
    build.watch("charge", film.capacitance * voltage)
    # A branch loses what its spring loses where it flows, ∂E/∂ξ ξ'; lumped it has one ξ, fine two at each point.
    flows = {name: rate for name, rate in build.written.rates.items() if name.startswith("branch")}
    viscous = ca.vertcat(*(build.written.states[name][0] for name in flows))
    speeds = ca.vertcat(*(rate / mass_ for rate, mass_ in flows.values()))
    losses = {
        "by_damper": build.own("damping") * velocity**2,
        "by_branch": -ca.dot(ca.gradient(film.relaxing, viscous), speeds),
    }
    if "electrode_rc" in {e.name for e in plant.effects}:
        resistance = build.own("electrode_rc.time") / build.at_rest("capacitance_at_rest", film.capacitance)
        losses["by_leads"] = (build.own("gain") * build.command - voltage) ** 2 / resistance
    for name, power in losses.items():
        build.rate(build.watch(name, build.state(name, scale=1e-6, start=0.0)), power)
    return build.finish(reading)


def ledger(plant: Plant, commands: np.ndarray, sample_time: float = SAMPLE_TIME) -> dict[str, np.ndarray]:
    """Watched signals at the end of each sample."""
    equations = audited(plant)
    result = Simulator(equations).run(
        commands, start=0.0, sample_time=sample_time, rest_command=0.0, values=plant.free_values
    )
    assert result.status.ok
    states = {name: k for k, name in enumerate(equations.signals)}
    return {name: result.watched[row] for name, row in states.items()}


def work_of_source(plant: Plant, commands: np.ndarray, charge: np.ndarray) -> np.ndarray:
    """V ΔQ of each sample but the first, J."""
    return plant.rig.gain * commands[1:] * np.diff(charge)


COMMANDS = {
    "noise": band_limited_noise(np.random.default_rng(5), 10.0, SAMPLE_TIME),
    "steps": np.repeat([1.1, 3.0, 0.0, 2.4, -1.5, 3.4], 75),
    "cycle": 1.5 * (1 - np.cos(2 * np.pi * 0.5 * SAMPLE_TIME * np.arange(500))),
}


PLANTS = {
    "reduced": SLIDING,
    "bonded": SLIDING.with_rig(replace(SLIDING.rig, ball="bonded")),
    "fine": SLIDING.with_rig(replace(SLIDING.rig, resolution="fine", elements=2)),
}


@pytest.mark.parametrize("kind", COMMANDS)
@pytest.mark.parametrize(("plant", "time"), [("reduced", 0.02), ("reduced", 0.2), ("bonded", 0.2), ("fine", 0.2)])
def test_work_in_is_stored_or_dissipated(kind, plant, time):
    # with a resistance in the leads the voltage is continuous, so everything is smooth within a sample
    plant = PLANTS[plant].with_effects(ElectrodeRC(time=time, film_share=1.0))
    commands = COMMANDS[kind]
    seen = ledger(plant, commands)
    work = work_of_source(plant, commands, seen["charge"])
    losses = sum(np.diff(seen[name]) for name in ("by_damper", "by_branch", "by_leads"))
    gap = work.sum() - (seen["held"][-1] - seen["held"][0]) - losses.sum()
    assert abs(gap) < CLOSED * np.abs(work).sum()
    for name in ("by_damper", "by_branch", "by_leads"):
        # each is a square: what it takes never comes back, to the rounding of the larger numbers
        assert np.diff(seen[name]).min() > -1e-12 * np.abs(work).sum()


def test_charging_through_leads_loses_half_of_the_work():
    # ½ C V² however small the resistance: at 80 V the Maxwell stress strains the film by 2e-4, so C is constant
    plant = SLIDING.with_effects(ElectrodeRC(time=1e-4, film_share=1.0))
    seen = ledger(plant, np.concatenate([np.zeros(2), np.full(60, 0.1)]), sample_time=5e-5)
    voltage = plant.rig.gain * 0.1
    lost = seen["by_leads"][-1] - seen["by_leads"][0]
    assert lost == pytest.approx(seen["capacitance"][0] * voltage**2 / 2, rel=1e-3)


@pytest.mark.parametrize("kind", ["noise", "steps"])
def test_without_resistance_each_step_of_the_voltage_loses_at_least_half_c_dv_squared(kind):
    commands = COMMANDS[kind]
    seen = ledger(SLIDING, commands)
    work = work_of_source(SLIDING, commands, seen["charge"])
    losses = np.diff(seen["by_damper"]) + np.diff(seen["by_branch"])
    lost = work - np.diff(seen["held"]) - losses
    steps = SLIDING.rig.gain * np.diff(commands)
    least = np.minimum(seen["capacitance"][1:], seen["capacitance"][:-1]) * steps**2 / 2
    # the massless film snaps to its new shape within the jump and loses the work of that too, so: at least
    assert (lost > 0.98 * least - CLOSED * np.abs(work).max()).all()
    held = steps == 0.0
    assert np.abs(lost[held]).max(initial=0.0) < CLOSED * np.abs(work).max()


@pytest.mark.parametrize("charge", [0.1, 1.0, 10.0, 100.0])
def test_a9_under_charge_control_there_is_no_pull_in(charge):
    # A free equal-biaxial film under a charge D of each reference area has W + D²/(2 eps l^4) least at
    # l = (1 + D²/(eps mu))^(1/6), for every charge; at a voltage there is an equilibrium up to l = 2^(1/3) only.
    modulus, permittivity, thickness, area = 25e3, 4.5, 5e-4, 1e-2
    stretch = ca.SX.sym("stretch")
    point = FilmPoint(volume=area * thickness, stretches=(stretch, stretch), radius=0.5)
    (capacitance,) = point_capacitances([point], permittivity, thickness)
    density = charge * np.sqrt(permittivity * VACUUM_PERMITTIVITY * modulus)
    energy = point.volume * neo_hookean(stretch, stretch, modulus) + (density * area) ** 2 / (2 * capacitance)
    expected = (1 + charge**2) ** (1 / 6)
    force, stiffness = ca.Function("force", [stretch], [ca.gradient(energy, stretch), ca.hessian(energy, stretch)[0]])(
        expected
    )
    assert abs(float(force)) < 1e-12 * float(stiffness)
    assert float(stiffness) > 0
