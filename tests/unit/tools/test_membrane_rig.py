"""The finite-element rig: its film against theory and against the fine plant, and effects that vanish at size 0."""

import json

import membrane_rig
import numpy as np
import pytest
from membrane_effects import EFFECTS

from deatwin.plant import Diaphragm, Experiment, Plant, Recording, read_rig
from deatwin.plant.files import read_recording
from deatwin.plant.rest import rest_state

FILM = {"H0": 0.5e-3, "prestretch": 3.5, "frame": 0.04, "electrode": 0.0175, "rim": 3e-3, "mass": 3e-3, "Jm": 160.0}
FILM |= {"mu": 31.5e3, "mu1": 60e3, "tau1": 0.5, "mu2": 0.0, "tau2": 90.0, "eps_r": 4.2, "damping": 0.06}
GONE = {"amplifier_saturation": {"limit": np.inf}, "amplifier_slew": {"up": np.inf, "down": np.inf}}
GONE |= {
    "electrode_loss": {"share_left": 1.0},
    "healing_electrode": {"share_left": 1.0},
    "sensor_saturation": {"limit": np.inf},
}
SIZES = "share modulus relative_change force mass coefficient change reading_size volts resistance slope stiffness slip size".split()


def heights(volts, refine=1, sliding=False):
    """Height of the ball, m, at rest under each voltage."""
    film = membrane_rig.Membrane(FILM, 16 * refine, 10 * refine, sliding)
    film.z[:] = 1e-3 * (1 - film.r / film.r[-1])
    return np.array([membrane_rig.at_rest(film, v, FILM["mass"] * membrane_rig.GRAVITY) for v in volts])


def fine_plant(ball):
    values = {"shear_modulus": "mu", "stretch_limit": "Jm", "branch_modulus": "mu1", "branch_time": "tau1"}
    values |= {"permittivity": "eps_r", "damping": "damping"}
    rig = Diaphragm(ball=ball, resolution="fine", elements=4)
    return Plant(rig=rig, values={ours: FILM[theirs] for ours, theirs in values.items()})


@pytest.mark.parametrize("ball", ["bonded", "sliding"])
def test_equilibria_converge_with_the_square_of_the_elements_to_those_of_the_fine_plant(ball):
    """Where refining by 2 moves a height by d, an error of d/3 remains; four elements of fourth order err by 1e-4."""
    volts = [0.0, 1600.0, 2400.0]
    coarse, middle, fine = (heights(volts, refine, ball == "sliding") for refine in (1, 2, 4))
    np.testing.assert_allclose((coarse - middle) / (middle - fine), 4.0, rtol=0.02)
    plant, theirs, guess = fine_plant(ball), [], None
    for v in volts:
        state = rest_state(plant.equations, v / 800.0, plant.free_values, guess=guess)
        guess = np.concatenate([state.x, state.z])
        theirs.append(state.x[plant.equations.states.index("deflection")])
    np.testing.assert_allclose(fine + (fine - middle) / 3, theirs, rtol=3e-4)


def test_motion_is_that_of_the_fine_plant_half_a_step_later():
    """26 elements of second order err by 0.1 % of the motion; Newmark answers steps 2 ms late."""
    film, _, parts, reading = membrane_rig.experiment(4, [], 13.5, False)
    seen = np.arange(300)
    record = Recording(inputs=parts[0][None], outputs=reading[None, seen], sample_time=0.02)
    theirs = ("mu", "mu1", "tau1", "eps_r", "damping")
    ours = ("shear_modulus", "branch_modulus", "branch_time", "permittivity", "damping")
    plant = fine_plant("bonded").with_values({a: film[b] for a, b in zip(ours, theirs, strict=True)})
    ours = plant.simulate(Experiment(recordings=(record,))).require().outputs[0][0]
    late = ours - 2e-3 * np.gradient(ours, 0.02)
    assert np.sqrt(np.mean((reading[seen] - late) ** 2)) < np.hypot(membrane_rig.NOISE, 1e-3 * np.ptp(ours))


def test_the_sag_of_a_light_ball_is_that_of_a_stretched_membrane():
    r"""Sag of a uniformly stretched film, :math:`mg\ln(B/r)/(2\pi N)`, as the mass vanishes."""
    film, stretch = membrane_rig.Membrane(FILM), FILM["prestretch"]
    film.z[:] = 1e-5 * (1 - film.r / film.r[-1])
    weight = 1e-3 * FILM["mass"] * membrane_rig.GRAVITY
    stress = FILM["mu"] * 160 / (163 - 2 * stretch**2 - stretch**-4) * (stretch**2 - stretch**-4)
    tension = stress * FILM["H0"] / stretch**2
    sag = weight * np.log(FILM["frame"] / FILM["rim"]) / (2 * np.pi * tension)
    assert membrane_rig.at_rest(film, 0.0, weight) == pytest.approx(sag, rel=2e-3)


def test_a_free_ball_oscillates_and_decays_as_its_sag_and_damper_say():
    r"""Frequency :math:`\sqrt{g/z_0}/2\pi`, lowered by Newmark's :math:`(\omega\Delta t)^2/12`; decay by :math:`e^{-ct/2m}`."""
    film = FILM | {"mu1": 0.0}
    volts = np.concatenate([np.full(1250, 500.0), np.zeros(150)])
    y = membrane_rig.simulate(film, volts, [])[1250:]
    omega = np.sqrt(membrane_rig.GRAVITY / heights([0.0])[0])
    omega *= 1 - (omega * membrane_rig.STEP) ** 2 / 12
    rate, t = film["damping"] / (2 * film["mass"]), membrane_rig.STEP * np.arange(len(y))
    turning = np.sqrt(omega**2 - rate**2)
    shapes = np.exp(-rate * t)[:, None] * np.column_stack([np.cos(turning * t), np.sin(turning * t)])
    left = y - shapes @ np.linalg.lstsq(shapes, y, rcond=None)[0]
    assert np.std(left) < 0.03 * np.std(y)


def test_an_undamped_ball_keeps_its_swing():
    """Average acceleration neither feeds nor takes energy."""
    y = membrane_rig.simulate(
        FILM | {"mu1": 0.0, "damping": 0.0}, np.concatenate([np.full(1250, 500.0), np.zeros(1000)]), []
    )[1250:]
    assert np.ptp(y[-250:]) == pytest.approx(np.ptp(y[:250]), rel=0.01)


def test_effects_of_size_0_change_nothing():
    """All at once, to a thousandth of a sensor's noise; a closed form at size 0 rounds."""
    gone = [
        kind(3, **(GONE.get(n) or {k: 0.0 for k in kind.values if k in SIZES} or {"time": 0.0}))
        for n, kind in EFFECTS.items()
    ]
    plain, found = (membrane_rig.experiment(3, effects, 0.9, False)[3] for effects in ([], gone))
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-3 * membrane_rig.NOISE)


def test_the_command_writes_what_deatwin_reads(tmp_path, monkeypatch):
    asked = [str(tmp_path), "--seed", "5", "--effect", "creep:modulus=4e4,time=20", "--seconds", "9"]
    monkeypatch.setattr("sys.argv", ["membrane_rig", *asked])
    membrane_rig.main()
    assert json.loads((tmp_path / "truth.json").read_text())["effects"] == {"creep": {"modulus": 4e4, "time": 20.0}}
    read_rig(tmp_path / "rig.toml")
    recordings = [read_recording(tmp_path / f"{name}.csv") for name in ("noise", "steps", "check")]
    assert [r.outputs.size for r in recordings] == [200, 150, 100]
