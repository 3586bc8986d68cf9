"""An experiment on a rig that shares no code with deatwin: a finite-element membrane with a ball, and concealed effects.

``python tests/tools/membrane_rig.py OUT --seed 7001 --effect creep:modulus=50e3,time=55 [--effect ...] [--seconds 540]``
writes noise.csv, steps.csv and check.csv (shares of 4, 3 and 2 of the time), rig.toml and truth.json; ``--list`` names
the effects of `membrane_effects` and their values, SI. Elements of two nodes with one point each carry a Gent film whose Maxwell branches
flow at that point. The film has no inertia; the ball obeys Newmark's average acceleration with steps of 4 ms, which
answers a held command half a step late.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

STEP, HOLD = 0.004, 5  # Newmark's step, s; steps for which a command is held
START = 5.0  # Ramp of 2 s and hold of 3 s before time 0
GRAVITY, VACUUM, NOISE = 9.80665, 8.8541878128e-12, 2e-6
SCATTER = {
    "mu": (31.5e3, 0.048),
    "mu1": (60e3, 0.048),
    "tau1": (0.5, 0.048),
    "eps_r": (4.2, 0.0192),
    "damping": (0.06, 0.048),
}
"""Mean and relative deviation over rigs, cut at two deviations."""
RIG = """[film]
material = "VHB 4905"
thickness_mm = 0.5
prestretch = 3.5
frame_diameter_mm = 80.0
electrode_diameter_mm = 35.0

[load]
mass_g = 3.0
contact_diameter_mm = 6.0

[drive]
gain = 800.0
start_ramp_s = 2.0
start_hold_s = 3.0

[sensor]
sample_rate_Hz = 50.0
noise_um = 2.0
zero = "displacement at zero volts"
"""


class Membrane:
    """Film from ball to frame; `mu`, `eps` and `tau` may be changed by effects between steps. Lengths in m."""

    def __init__(self, film, inner=16, outer=10, sliding=False):
        stretch, edges = (
            film["prestretch"],
            np.array([film["rim"], film["electrode"], film["frame"]]) / film["prestretch"],
        )
        rho = np.concatenate([np.geomspace(*edges[:2], inner + 1), np.geomspace(*edges[1:], outer + 1)[1:]])
        self.length, self.radius = np.diff(rho), (rho[1:] + rho[:-1]) / 2
        self.volume = 2 * np.pi * self.radius * self.length * film["H0"]
        self.under = self.radius < edges[1]
        self.disc, self.core = (np.pi * rho[0] ** 2 * film["H0"] if sliding else 0.0), rho[0]
        self.thickness, self.limit, self.electrode = film["H0"], film["Jm"], edges[1]
        self.modulus, self.permittivity = film["mu"], film["eps_r"] * VACUUM * self.under
        self.branch, self.times = np.array([[film["mu1"]], [film["mu2"]]]), np.array([[film["tau1"]], [film["tau2"]]])
        self.bend, self.second, self.volts = 0.0, (0.0, 1e3), 0.0
        self.r, self.z = stretch * rho, np.zeros_like(rho)
        self.free = np.arange(0 if sliding else 1, len(rho) - 1)
        self.count = len(self.free)
        self.q1 = self.q2 = np.full(len(rho) - 1, stretch**2)
        self.rest_area = stretch**2
        self.reset()
        self.flow = None

    def reset(self):
        """Undo what effects changed in the step before."""
        self.mu, self.eps, self.tau = self.modulus, self.permittivity, self.times

    def hold(self, squared):
        """Set what stays the same while a step is solved: the branches' flow, moduli and squared voltage."""
        self.field = self.eps * (squared / self.thickness**2)
        self.pull1, self.pull2 = (self.branch / self.xi1**2).sum(0), (self.branch / self.xi2**2).sum(0)
        self.push = (self.branch * (self.xi1 * self.xi2) ** 2).sum(0)

    def forces(self, r, z):
        """Forces that the film exerts against r and z of each node, N."""
        dr, dz = (r[1:] - r[:-1]) / self.length, (z[1:] - z[:-1]) / self.length
        hoop = (r[1:] + r[:-1]) / (2 * self.radius)
        self.q1, self.q2 = dr * dr + dz * dz, hoop * hoop
        t1, t2 = self.stresses(self.q1, self.q2, self.mu, self.pull1, self.pull2, self.push, self.field)
        along, around = self.volume / self.length * t1 / self.q1, self.volume / (2 * self.radius) * t2 / hoop
        fr, fz = along * dr, along * dz
        out_r, out_z = np.zeros(len(r)), np.zeros(len(z))
        out_r[:-1], out_z[:-1] = around - fr, -fz
        out_r[1:] += around + fr
        out_z[1:] += fz
        if self.disc:
            q = np.array([(r[0] / self.core) ** 2])
            same = self.branch / self.core_xi**2
            push = (self.branch * self.core_xi**4).sum(0)
            both = self.stresses(q, q, self.mu_core, same.sum(0), same.sum(0), push, self.field[:1])
            out_r[0] += self.disc * (both[0] + both[1])[0] / r[0]
        return out_r, out_z

    def stresses(self, q1, q2, mu, pull1, pull2, push, field):
        """Cauchy stresses along both directions, Pa, under squared stretches."""
        squared_area = q1 * q2
        thin = 1 / squared_area
        above = q1 + q2 + thin - 3
        share, limit = self.second
        stiff = mu * (self.limit / (self.limit - above))
        if share:
            stiff = stiff + mu * share * limit / (limit - above)
        maxwell = field * squared_area
        if self.bend:
            maxwell = maxwell * (1 + self.bend * (1.5 * np.sqrt(squared_area) / self.rest_area - 1))
        common = maxwell + (stiff + push) * thin
        return (stiff + pull1) * q1 - common, (stiff + pull2) * q2 - common

    def relax(self):
        """Let every branch forget its stress."""
        self.xi1, self.xi2 = np.sqrt(np.tile(self.q1, (2, 1))), np.sqrt(np.tile(self.q2, (2, 1)))
        self.core_xi = np.full((2, 1), self.r[0] / self.core)

    def creep(self, dt):
        """Advance the branches over the next step, Adams-Bashforth of second order; viscosity is modulus times time."""
        e1, e2, core = self.q1 / self.xi1**2, self.q2 / self.xi2**2, (self.r[0] / self.core / self.core_xi) ** 2
        s1, s2 = e1 - 1 / (e1 * e2), e2 - 1 / (e1 * e2)
        flow = ((2 * s1 - s2) / (6 * self.tau), (2 * s2 - s1) / (6 * self.tau), (core - core**-2) / (6 * self.times))
        before = flow if self.flow is None else self.flow
        self.xi1, self.xi2, self.core_xi = (
            xi * np.exp(dt * (1.5 * new - 0.5 * old))
            for xi, new, old in zip((self.xi1, self.xi2, self.core_xi), flow, before, strict=True)
        )
        self.flow = flow

    def capacitance(self):
        """Capacitance relative to that of the flat film."""
        weights = self.eps * self.volume
        return weights @ (self.q1 * self.q2) / (self.permittivity @ self.volume * self.rest_area**2)

    @property
    def mu_core(self):
        return self.mu if np.ndim(self.mu) == 0 else self.mu[0]


class Solver:
    """Newton with a kept tangent over the free nodes and the ball."""

    def __init__(self, film):
        self.film, self.inverse = film, None
        self.nodes = film.free

    def solve(self, squared, ball, tolerance=1e-9):
        """Balance the film under a squared voltage; `ball` maps the ball's height to its further force, N."""
        film, before, used = self.film, np.inf, 0
        film.hold(squared)
        for _ in range(60):
            residual = self.residual(film.r, film.z, ball)
            if self.inverse is None:
                self.inverse, used = np.linalg.inv(self.tangent(ball, residual)), 0
            move = self.inverse @ residual
            size, used = np.abs(move).max(), used + 1
            if not size < 5e-3:
                break
            film.r[self.nodes] -= move[: film.count]
            film.z[:-1] -= move[film.count :]
            if size < tolerance:
                return
            if size > 0.3 * before and used > 1:
                self.inverse, before = None, np.inf
            else:
                before = size
        raise SystemExit("the film has no equilibrium: pull-in")

    def residual(self, r, z, ball):
        fr, fz = self.film.forces(r, z)
        fz[0] += ball(z[0])
        return np.concatenate([fr[self.nodes], fz[:-1]])

    def tangent(self, ball, residual):
        """Differences of the residual; nodes three apart share no element and move together."""
        n, film = self.film.count, self.film
        at = np.concatenate([self.nodes, np.arange(len(film.z) - 1)])
        matrix, tiny = np.zeros((len(at), len(at))), 1e-9
        for kind in (0, 1):
            for colour in range(3):
                columns = np.flatnonzero((np.arange(len(at)) >= n) == kind)
                columns = columns[at[columns] % 3 == colour]
                r, z = film.r.copy(), film.z.copy()
                (z if kind else r)[at[columns]] += tiny
                change = (self.residual(r, z, ball) - residual) / tiny
                near = np.abs(at[:, None] - at[columns]) <= 1
                matrix[:, columns] = np.where(near, change[:, None], 0.0)
        return matrix


def at_rest(membrane, volts, weight):
    """Height of the ball, m, under a voltage held so long that every branch has relaxed, which takes a few rounds."""
    for _ in range(30):
        membrane.relax()
        Solver(membrane).solve(volts * volts, lambda z: -weight, tolerance=1e-12)
    return membrane.z[0]


def simulate(film, volts, effects, sliding=False):
    """Displacement, m, after each step under film volts; the first of them follows a long rest at 0 V."""
    membrane = Membrane(film, sliding=sliding)
    solver, mass, weight = Solver(membrane), film["mass"], film["mass"] * GRAVITY
    membrane.z[:] = 1e-3 * (1 - membrane.r / membrane.r[-1])
    rest, v, a = at_rest(membrane, 0.0, weight), 0.0, 0.0
    hooks = {name: [e for e in effects if name in vars(type(e))] for name in ("lead", "material", "ball", "accept")}
    for e in effects:
        e.prepare(membrane)
    out, last = np.empty(len(volts)), (membrane.r, membrane.z)
    for k, supplied in enumerate(volts):
        t = (k + 1) * STEP - START
        membrane.creep(STEP)
        if hooks["material"]:
            membrane.reset()
            for e in hooks["material"]:
                e.material(t, membrane)
        for e in hooks["lead"]:
            supplied = e.lead(supplied, membrane)
        z0, membrane.volts = membrane.z[0], supplied

        def ball(z, z0=z0, v=v, a=a, t=t):
            acceleration = 4 * ((z - z0) / STEP - v) / STEP - a
            velocity = v + STEP / 2 * (a + acceleration)
            further = sum(e.ball(z - rest, velocity, t) for e in hooks["ball"])
            return mass * acceleration + film["damping"] * velocity - weight + further

        guess = 2 * membrane.r - last[0], 2 * membrane.z - last[1]
        last = membrane.r, membrane.z
        membrane.r, membrane.z = guess
        solver.solve(supplied * supplied, ball)
        new = 4 * ((membrane.z[0] - z0) / STEP - v) / STEP - a
        v, a = v + STEP / 2 * (a + new), new
        out[k] = membrane.z[0] - rest
        for e in hooks["accept"]:
            e.accept(out[k], v)
    return out


def commands(rng, seconds):
    """Commands of the three recordings, one a sample: noise of 0 to 1 Hz about 2.4 V, random holds, other noise."""
    lengths = [round(50 * seconds * share / 9) for share in (4, 3, 2)]

    def noise(n):
        low = sosfiltfilt(butter(6, 1.0, fs=50.0, output="sos"), rng.normal(size=n + 500))[250:-250]
        return np.clip(2.4 + 0.6 * low / low.std(), 1.1, 3.75)

    holds = np.concatenate(
        [np.full(int(50 * rng.uniform(2, 25)), rng.uniform(1.1, 3.6)) for _ in range(lengths[1] // 100 + 1)]
    )
    return [np.round(u, 5) for u in (noise(lengths[0]), holds[: lengths[1]], noise(lengths[2]))]


def experiment(seed, effects, seconds, sliding):
    """Film, times, commands and readings of the three recordings."""
    rng = np.random.default_rng([seed, 0])
    film = {"H0": 0.5e-3, "prestretch": 3.5, "frame": 0.04, "electrode": 0.0175, "rim": 3e-3, "mass": 3e-3, "Jm": 160.0}
    film |= {k: m * (1 + s * np.clip(rng.normal(), -2, 2)) for k, (m, s) in SCATTER.items()} | {
        "mu2": 0.0,
        "tau2": 90.0,
    }
    for e in effects:
        film |= e.film()
    parts = commands(np.random.default_rng([seed, 1]), seconds)
    command = np.concatenate(parts)
    start = command[0] * np.minimum(np.arange(0, START, STEP) / 2.0, 1.0)
    volts = 800.0 * np.concatenate([start, np.repeat(command, HOLD)])
    t = np.arange(1, len(volts) + 1) * STEP - START
    for e in effects:
        volts = e.amplifier(t, volts)
    reading = simulate(film, volts, effects, sliding)
    for e in effects:
        reading = e.reading(t, reading)
    times = np.arange(len(command)) / 50.0
    seen, loud = times + HOLD * STEP, 1.0  # a sample is read at the end of its hold
    for e in effects:
        seen, loud = e.clock(seen), loud * e.loudness(command)
    noise = NOISE * loud * np.random.default_rng([seed, 2]).normal(size=len(times))
    return film, times, parts, np.interp(seen, t, reading) + noise


def main():
    from membrane_effects import EFFECTS, made  # the effects import the step

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--effect", action="append", default=[], metavar="NAME:KEY=VALUE,...")
    parser.add_argument("--seconds", type=float, default=540.0)
    parser.add_argument("--sliding", action="store_true", help="a ball on which the film slides; else it sticks")
    parser.add_argument("--list", action="store_true")
    asked = parser.parse_args()
    if asked.list or asked.out is None:
        print(
            "\n".join(
                f"{name}: {', '.join(f'{k}={v:g}' for k, v in kind.values.items())}" for name, kind in EFFECTS.items()
            )
        )
        return
    effects = [made(text, asked.seed) for text in asked.effect]
    film, times, parts, reading = experiment(asked.seed, effects, asked.seconds, asked.sliding)
    asked.out.mkdir(parents=True, exist_ok=True)
    table, at = np.column_stack([times, np.concatenate(parts), 1e3 * reading]), 0
    for name, part in zip(("noise", "steps", "check"), parts, strict=True):
        rows = table[at : at + len(part)]
        head = "time_s,command_V,displacement_mm"
        np.savetxt(asked.out / f"{name}.csv", rows, ("%.2f", "%.5f", "%.5f"), ",", header=head, comments="")
        at += len(part)
    (asked.out / "rig.toml").write_text(RIG)
    truth = {
        "effects": {e.name: e.given for e in effects if not e.dirt},
        "dirt": {e.name: e.given for e in effects if e.dirt},
    }
    truth |= {"seed": asked.seed, "film": film | {"elements": 26, "sliding": asked.sliding}}
    (asked.out / "truth.json").write_text(json.dumps(truth, indent=1))


if __name__ == "__main__":
    main()
