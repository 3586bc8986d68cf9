"""Test the claims about prestretch: each is computed on the plant and judged with a number.

The claims are those that the literature on dielectric elastomer actuators makes (Pelrine, Kornbluh, Pei & Joseph,
Science 287 (2000) 836, and after); the wording of thesis 2.2.2 was not at hand. A square film of VHB 4905, 0.5 mm
thick, is held at its prestretch by equal dead loads (`Planar`), by unequal ones, or by a frame with a ball at its
centre (`Diaphragm`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

import numpy as np

from deatwin.plant import ActuationCurve, Diaphragm, Experiment, Planar, Plant, Recording, actuation_curve
from deatwin.plant.laws import HUANG_2012, KOFOD_2001, VACUUM_PERMITTIVITY, maxwell_branch
from deatwin.plant.laws.stress import nominal_stress
from deatwin.plant.material import material
from deatwin.plant.rigs.film_actuator import relaxed_stresses
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.drawing import Drawing, draw, inline, standalone
from deatwin.studies.report.rendering import Origin, write_page
from deatwin.studies.report.story import end_run
from deatwin.studies.report.words import notes
from deatwin.studies.stories import Setting

RELAXING = "VHB 4910 Wang 2016"
"""Film whose three branches are a whole published set; the plant's VHB 4905 has only the first of them."""


class Verdict(Enum):
    """Result of the simulations for a claim."""

    TRUE = "true"
    CONDITIONAL = "conditional"
    FALSE = "false"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim, its verdict, and the numbers behind it."""

    claim: str
    verdict: Verdict
    finding: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Results of the simulations over the prestretch."""

    columns: Mapping[str, np.ndarray]  # shape (n,): by prestretch; NaN where there is no such thing
    ratios: Mapping[str, np.ndarray]  # shape (m,): for unequal prestretch, at one thickness
    pull_in_end: float  # Prestretch from which on a film under dead load no longer pulls in

    @property
    def stretch(self) -> np.ndarray:
        """The prestretches, shape (n,)."""
        return self.columns["prestretch"]

    def at(self, name: str, prestretch: float) -> float:
        """A column's value at a prestretch."""
        return float(np.interp(prestretch, self.stretch, self.columns[name]))

    def best(self, name: str) -> tuple[float, float]:
        """Prestretch at which a column is largest, and its value there."""
        most = int(np.nanargmax(self.columns[name]))
        return float(self.stretch[most]), float(self.columns[name][most])

    def rises(self, values: np.ndarray) -> Verdict:
        """Return whether values rise with the prestretch, shape (n,)."""
        steps = np.diff(values[np.isfinite(values)])
        return Verdict.TRUE if np.all(steps > 0) else Verdict.CONDITIONAL if np.any(steps > 0) else Verdict.FALSE


def judged_claims(s: Sweep) -> tuple[Claim, ...]:
    """Judge all claims; the words stand in a template, in the same order."""
    columns, needed, prompt = s.columns, s.columns["voltage_for_5_percent_V"], s.columns["prompt_share"]
    gain = columns["strain_at_1kV"] / s.stretch**4  # at one true field: the thickness goes with 1/stretch²
    cheapest, slowest, pulls_in = int(np.argmin(needed)), int(np.argmin(prompt)), np.isfinite(columns["pull_in_V"])
    along, across = s.ratios["strain_along"], s.ratios["strain_across"]
    verdicts = (
        s.rises(columns["strain_at_1kV"]),
        s.rises(-needed),
        s.rises(columns["breakdown_field_MV_m"]),
        s.rises(columns["breakdown_voltage_as_mounted_V"]),
        Verdict.FALSE if pulls_in.all() else Verdict.CONDITIONAL if pulls_in.any() else Verdict.TRUE,
        s.rises(columns["largest_strain"]),
        s.rises(prompt),
        s.rises(along / across),
        _certain(columns["slack_V"][0] == 0 and np.all(columns["slack_V"][1:] > 0)),
        _certain(np.nanmin(columns["tension_lost"]) > 0),
        s.rises(columns["ball_at_2kV_mm"]),
    )
    findings = notes(
        __package__,
        "claims.md.j2",
        s=s,
        less=gain[0] / np.interp(3.5, s.stretch, gain),
        needed=needed,
        cheapest=cheapest,
        prompt=prompt,
        slowest=slowest,
        faster=np.interp(prompt[0], prompt[slowest:], s.stretch[slowest:]),
        along=along,
        across=across,
        relaxed=3 * max(branch.time.value for branch in material(RELAXING).branches),
    )
    return tuple(
        Claim(claim=note.title, verdict=verdict, finding=note.paragraphs[0])
        for note, verdict in zip(findings, verdicts, strict=True)
    )


def _certain(holds: bool | np.bool_) -> Verdict:
    return Verdict.TRUE if holds else Verdict.FALSE


Array = np.ndarray
Columns = Mapping[str, Array]
PRESTRETCHES = np.linspace(1.0, 5.0, 17)
RATIOS = np.linspace(1.0, 3.0, 9)  # Prestretch across over prestretch along, at the thickness of 3 x 3
KILOVOLT, TOP = 1000.0, 10e3
STRAIN = 0.05


def run(setting: Setting) -> Mapping[str, Any]:
    """Simulate films over the prestretch, judge the claims, and write page, figure and table."""
    record = setting.record()
    columns = sweep(setting.progress)
    setting.progress(0.8, "unequal prestretch")
    ratios = unequal(RATIOS)
    setting.progress(0.9, "where pull-in ends")
    judged = judged_claims(Sweep(columns=columns, ratios=ratios, pull_in_end=pull_in_ends_at(columns)))
    setting.folder.csv("prestretch.csv", columns)
    setting.folder.csv("unequal.csv", ratios)
    true, conditional, false = (sum(c.verdict is verdict for c in judged) for verdict in Verdict)
    result = {
        "claims": [{**asdict(claim), "verdict": claim.verdict.value} for claim in judged],
        "sentence": (
            f"Of {len(judged)} claims about prestretch, {true} are true, {conditional} are true under a condition, and {false} are false. "
            f"{judged[0].finding}"
        ),
    }
    figure = _drawn(setting.folder, columns, ratios)
    origin = Origin.of(record)
    write_page(setting.folder, "prestretch.html.j2", [figure], origin, __package__, result=result, figure=figure)
    return end_run(setting.folder, record, "prestretch", result)


def dead_load(prestretch: float, **fields: Any) -> ActuationCurve:
    """Return the actuation curve of the square film under equal dead loads, up to 10 kV."""
    rig = Planar(**{"prestretch": float(prestretch), "gain": 1.0, **fields})
    return actuation_curve(Plant(rig=rig), np.linspace(0.0, TOP, 201))


def sweep(progress: Callable[[float, str], None]) -> dict[str, Array]:
    """Compute all columns over the prestretch, each of shape (n,)."""
    rows: list[dict[str, float]] = []
    for number, prestretch in enumerate(PRESTRETCHES):
        progress(0.8 * number / PRESTRETCHES.size, f"prestretch {prestretch:g}")
        rows.append({"prestretch": float(prestretch), **_under_dead_load(prestretch), **_mounted(prestretch)})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _under_dead_load(prestretch: float) -> dict[str, float]:
    curve = dead_load(prestretch)
    volts, stretch = curve.commands, curve.unknowns["position"] / Planar.length
    strain = stretch / prestretch - 1
    ends = [at for at in (None if curve.end.ok else volts[-1], curve.breakdown_command) if at is not None]
    thickness = Planar.thickness / stretch**2
    weaker = curve.signals["field"] / KOFOD_2001.at(thickness, stretch, stretch)
    return {
        "strain_at_1kV": float(np.interp(KILOVOLT, volts, strain)),
        "voltage_for_5_percent_V": float(np.interp(STRAIN, strain, volts)),
        "pull_in_V": np.nan if curve.end.ok else float(volts[-1]),
        "breakdown_V": curve.breakdown_command or np.nan,
        "breakdown_of_soft_film_V": _crossing(volts, weaker),
        "largest_strain": float(np.interp(min(ends), volts, strain)),
        "prompt_share": _prompt_share(prestretch, float(np.interp(0.01, strain, volts))),
    }


def _crossing(volts: Array, share: Array) -> float:
    """Return the voltage at which a share that starts at 0 first reaches 1; NaN if it does not."""
    if share.max() < 1.0:
        return np.nan
    first = int(np.argmax(share >= 1.0))
    return float(np.interp(1.0, share[: first + 1], volts[: first + 1]))


def _prompt_share(prestretch: float, voltage: float) -> float:
    """Return the share of the final strain reached 20 ms after a step, without mass and damping."""
    rig = Planar(prestretch=float(prestretch), gain=1.0, mass=0.0, damping=1e-6)
    step = Recording.from_arrays(np.array([0.0, voltage]), np.zeros(2), rig.sample_time)
    prompt = Plant(rig=rig).simulate(Experiment(recordings=(step,))).require().outputs[0][0, -1]
    return float(prompt / actuation_curve(Plant(rig=rig), np.array([voltage])).readings[-1])


def _mounted(prestretch: float) -> dict[str, float]:
    """Return values of the film as mounted, and in the ring with the ball."""
    film = material(Planar.material)
    thickness = Planar.thickness / prestretch**2
    tension = relaxed_stresses(film, prestretch, prestretch)[0]
    permittivity = film.permittivity.value * VACUUM_PERMITTIVITY
    field = HUANG_2012.at(thickness, prestretch, prestretch)
    return {
        "breakdown_field_MV_m": float(field / 1e6),
        "breakdown_voltage_as_mounted_V": float(field * thickness),
        "slack_V": float(Planar.thickness * np.sqrt(max(tension, 0.0) / (permittivity * prestretch**3))),
        "tension_lost": _tension_lost(prestretch),
        "ball_at_2kV_mm": _ball(prestretch),
    }


def _tension_lost(prestretch: float) -> float:
    """Return the share of the initial tension that the branches relax; NaN without tension."""
    film = material(RELAXING)
    branches, _ = nominal_stress(maxwell_branch, prestretch, prestretch)
    relaxing = sum(branch.modulus.value for branch in film.branches) * float(branches)
    total = relaxing + relaxed_stresses(film, prestretch, prestretch)[0]
    return relaxing / total if total > 0 else np.nan


def _ball(prestretch: float) -> float:
    """Return the displacement of the ball on the film; NaN if a film without tension cannot hold it."""
    if prestretch < 1.5:
        return np.nan
    curve = actuation_curve(Plant(rig=Diaphragm(prestretch=float(prestretch), gain=1.0)), np.linspace(0, 2000.0, 11))
    return float(1e3 * curve.readings[-1]) if curve.end.ok else np.nan


def unequal(ratios: Array) -> dict[str, Array]:
    """Strains at 1 kV along and across a film of unequal prestretch, at one thickness, (n,)."""
    along, across = [], []
    for ratio in ratios:
        first, second = 3.0 / np.sqrt(ratio), 3.0 * np.sqrt(ratio)
        rig = Planar(prestretch=float(first), side_prestretch=float(second), sides="free", gain=1.0)
        curve = actuation_curve(Plant(rig=rig), np.array([0.5 * KILOVOLT, KILOVOLT]))
        along.append(curve.unknowns["position"][-1] / rig.length / first - 1)
        across.append(curve.unknowns["side_stretch"][-1] / second - 1)
    return {"ratio": ratios, "strain_along": np.array(along), "strain_across": np.array(across)}


def pull_in_ends_at(columns: Columns) -> float:
    """Return the prestretch above which a film under dead load no longer pulls in."""
    stretches, pulls_in = columns["prestretch"], np.isfinite(columns["pull_in_V"])
    low, high = float(stretches[pulls_in].max()), float(stretches[~pulls_in].min())
    while high - low > 0.01:
        middle = (low + high) / 2
        low, high = (low, middle) if dead_load(middle).end.ok else (middle, high)
    return (low + high) / 2


def _drawn(folder: ResultFolder, columns: Columns, ratios: Columns) -> Drawing:
    """Draw the page's figure, and write ``prestretch.svg``."""
    title = "What changes with the prestretch"
    with draw((9.6, 6.0)) as figure:
        stretch = columns["prestretch"]
        axes = figure.subplots(2, 3)
        strain, volts, limits, prompt, directed, ball = axes.flat
        strain.plot(stretch, 100 * columns["strain_at_1kV"])
        strain.set(title="strain at 1 kV (%)")
        volts.semilogy(stretch, columns["voltage_for_5_percent_V"], label="for 5 % strain")
        volts.semilogy(stretch, columns["pull_in_V"], label="pull-in")
        volts.semilogy(stretch, columns["breakdown_V"], label="breakdown")
        volts.semilogy(stretch, np.where(columns["slack_V"] > 0, columns["slack_V"], np.nan), label="slack in a frame")
        volts.set(title="voltages (V)", ylim=(500, 4e4))
        volts.legend(fontsize="small")
        limits.plot(stretch, 100 * columns["largest_strain"])
        limits.set(title="largest strain (%)")
        prompt.plot(stretch, 100 * columns["prompt_share"], label="of a step's strain within 20 ms")
        prompt.plot(stretch, 100 * columns["tension_lost"], label="of the tension lost after mounting")
        prompt.set(title="shares (%)", ylim=(0, 100))
        prompt.legend(fontsize="small")
        directed.plot(ratios["ratio"], 100 * ratios["strain_along"], label="along")
        directed.plot(ratios["ratio"], 100 * ratios["strain_across"], label="across")
        directed.set(title="strain at 1 kV, unequal (%)")
        directed.legend(fontsize="small")
        ball.plot(stretch, columns["ball_at_2kV_mm"])
        ball.set(title="ball at 2 kV (mm)")
        for panel in axes.flat:
            panel.set_xlabel("prestretch")
            panel.title.set_fontsize("medium")
        directed.set_xlabel("prestretch across / along")
        folder.text("prestretch.svg", standalone(figure))
        return Drawing(
            name="prestretch",
            title=title,
            svg=inline(figure, "prestretch", title),
            data="prestretch.csv",
            further=("unequal.csv",),
            caption="A square film of VHB 4905 under equal dead loads. Below, in the middle: under unequal loads, at "
            "equal thickness. Below, on the right: the ball of the thesis' rig.",
        )
