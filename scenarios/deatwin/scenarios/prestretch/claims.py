"""The claims that are made for prestretch, each judged by what the sweep found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.plant.material import material

RELAXING = "VHB 4910 Wang 2016"
"""Its three branches are a whole published set; the plant's VHB 4905 has only the first of them."""


class Verdict(Enum):
    """What the plant says to a claim."""

    TRUE = "true"
    CONDITIONAL = "conditional"
    FALSE = "false"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim and what became of it."""

    claim: str
    verdict: Verdict  # What the plant says
    finding: str  # With its numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """What was computed over the prestretch."""

    columns: Mapping[str, np.ndarray]  # shape (n,): By prestretch; NaN where there is no such thing
    ratios: Mapping[str, np.ndarray]  # shape (m,): Of unequal prestretch, at one thickness
    pull_in_end: float  # Prestretch from which on a film under dead load no longer pulls in

    @property
    def stretch(self) -> np.ndarray:
        """The prestretches, shape (n,)."""
        return self.columns["prestretch"]

    def at(self, name: str, prestretch: float) -> float:
        """A column's value at a prestretch."""
        return float(np.interp(prestretch, self.stretch, self.columns[name]))

    def best(self, name: str) -> tuple[float, float]:
        """Where a column is largest, and its value there."""
        most = int(np.nanargmax(self.columns[name]))
        return float(self.stretch[most]), float(self.columns[name][most])

    def rises(self, values: np.ndarray) -> Verdict:
        """Whether values rise with the prestretch. Shapes: `values` (n,)."""
        steps = np.diff(values[np.isfinite(values)])
        return Verdict.TRUE if np.all(steps > 0) else Verdict.CONDITIONAL if np.any(steps > 0) else Verdict.FALSE


def judged_claims(sweep: Sweep) -> tuple[Claim, ...]:
    """All claims, judged."""
    return tuple(judge(sweep) for judge in _JUDGES)


def _strain(s: Sweep) -> Claim:
    where, most = s.best("strain_at_1kV")
    gain = s.columns["strain_at_1kV"] / s.stretch**4  # at one true field: the thickness goes with 1/stretch²
    less = gain[0] / np.interp(3.5, s.stretch, gain)
    return Claim(
        claim="Prestretch raises the strain at a given voltage, because the film is thinner.",
        verdict=s.rises(s.columns["strain_at_1kV"]),
        finding=(
            f"Under dead load 1 kV gives {100 * s.at('strain_at_1kV', 1.0):.2f} % without prestretch and "
            f"{100 * most:.1f} % at {where:.2f}, the best; beyond it the film's limit of stretch wins "
            f"({100 * s.at('strain_at_1kV', 5.0):.1f} % at 5). This counts volts: at equal true field a film of 3.5 "
            f"strains {less:.1f} times less."
        ),
    )


def _voltage(s: Sweep) -> Claim:
    needed = s.columns["voltage_for_5_percent_V"]
    cheapest = int(np.argmin(needed))
    return Claim(
        claim="It lowers the voltage that a given strain needs.",
        verdict=s.rises(-needed),
        finding=(
            f"5 % strain needs {needed[0]:.0f} V without prestretch and {needed[cheapest]:.0f} V at "
            f"{s.stretch[cheapest]:.2f}; more prestretch costs volts again ({needed[-1]:.0f} V at 5)."
        ),
    )


def _breakdown_field(s: Sweep) -> Claim:
    first, middle, last = (s.at("breakdown_field_MV_m", stretch) for stretch in (1.0, 3.5, 5.0))
    return Claim(
        claim="It raises the field at which the film breaks down.",
        verdict=s.rises(s.columns["breakdown_field_MV_m"]),
        finding=(
            f"By the law of Huang et al. (2012) from {first:.0f} to {middle:.0f} MV/m at 3.5 and {last:.0f} MV/m at 5: "
            "a measured law that the plant takes over, not one that it explains."
        ),
    )


def _breakdown_voltage(s: Sweep) -> Claim:
    first, last = (s.at("breakdown_voltage_as_mounted_V", stretch) for stretch in (1.0, 3.5))
    return Claim(
        claim="So a prestretched film stands a higher voltage.",
        verdict=s.rises(s.columns["breakdown_voltage_as_mounted_V"]),
        finding=(
            f"It is thinner by more than its field gains: were it held as mounted, {first:.0f} V without prestretch "
            f"and {last:.0f} V at 3.5. Under dead load, where it thins on, the film without prestretch pulls in at "
            f"{s.at('pull_in_V', 1.0):.0f} V and one of 3.5 breaks at {s.at('breakdown_V', 3.5):.0f} V, or at "
            f"{s.at('breakdown_of_soft_film_V', 3.5):.0f} V with the lower fields of films that are not embedded "
            "(Kofod et al., 2001)."
        ),
    )


def _pull_in(s: Sweep) -> Claim:
    pulls_in = np.isfinite(s.columns["pull_in_V"])
    some = Verdict.FALSE if pulls_in.all() else Verdict.CONDITIONAL
    return Claim(
        claim="It suppresses pull-in.",
        verdict=some if pulls_in.any() else Verdict.TRUE,
        finding=(
            f"Under dead load from a prestretch of {s.pull_in_end:.2f} on, by the film's limit of stretch. Below, it "
            f"only moves: from {100 * s.at('largest_strain', 1.0):.0f} % strain at {s.at('pull_in_V', 1.0):.0f} V to "
            f"{100 * s.at('largest_strain', 2.0):.0f} % at {s.at('pull_in_V', 2.0):.0f} V with 2. Without such a limit "
            "(neo-Hookean) no prestretch takes it beyond 50 %."
        ),
    )


def _largest_strain(s: Sweep) -> Claim:
    where, most = s.best("largest_strain")
    return Claim(
        claim="It raises the largest strain that can be reached.",
        verdict=s.rises(s.columns["largest_strain"]),
        finding=(
            f"To {100 * most:.0f} % at {where:.2f}, where pull-in has just gone and breakdown ends it; from "
            f"{100 * s.at('largest_strain', 1.0):.0f} % without prestretch. More prestretch uses up the stretch "
            f"beforehand: {100 * s.at('largest_strain', 5.0):.0f} % at 5."
        ),
    )


def _speed(s: Sweep) -> Claim:
    prompt = s.columns["prompt_share"]
    slowest = int(np.argmin(prompt))
    faster = np.interp(prompt[0], prompt[slowest:], s.stretch[slowest:])
    return Claim(
        claim="It makes the film faster and less lossy.",
        verdict=s.rises(prompt),
        finding=(
            f"20 ms after a step {100 * prompt[0]:.0f} % of the strain are there without prestretch, but "
            f"{100 * prompt[slowest]:.0f} % at {s.stretch[slowest]:.2f}, where a dead load makes the film softest; "
            f"from {faster:.1f} on it is faster than without, with {100 * s.at('prompt_share', 3.5):.0f} % at 3.5 and "
            f"{100 * prompt[-1]:.0f} % at 5: the network stiffens with the stretch, a relaxed branch does not. It "
            "rests on branches whose modulus and time do not depend on the stretch."
        ),
    )


def _direction(s: Sweep) -> Claim:
    along, across = s.ratios["strain_along"], s.ratios["strain_across"]
    return Claim(
        claim="Unequal prestretch directs the strain to where the prestretch is less.",
        verdict=s.rises(along / across),
        finding=(
            f"At one thickness, {s.ratios['ratio'][-1]:.0f} times the prestretch across as along gives "
            f"{along[-1] / across[-1]:.1f} times the strain along as across, and {along[-1] / along[0]:.2f} times that "
            "of equal prestretch."
        ),
    )


def _tension(s: Sweep) -> Claim:
    where, most = s.best("slack_V")
    holds = bool(s.columns["slack_V"][0] == 0 and np.all(s.columns["slack_V"][1:] > 0))
    return Claim(
        claim="It keeps a film in a frame from going slack.",
        verdict=Verdict.TRUE if holds else Verdict.FALSE,
        finding=(
            f"A film that is held at its edges loses its tension at once without prestretch, at {most:.0f} V with "
            f"{where:.2f} and at {s.at('slack_V', 3.5):.0f} V with 3.5: any prestretch does, a little one best."
        ),
    )


def _relaxation(s: Sweep) -> Claim:
    slowest = max(branch.time.value for branch in material(RELAXING).branches)
    lost = s.columns["tension_lost"]
    return Claim(
        claim="Its cost is that the tension relaxes.",
        verdict=Verdict.TRUE if np.nanmin(lost) > 0 else Verdict.FALSE,
        finding=(
            f"Of the tension right after a quick mounting {100 * s.at('tension_lost', 2.0):.0f} % are lost at 2 and "
            f"{100 * s.at('tension_lost', 3.5):.0f} % at 3.5, nearly all of it within {3 * slowest:.0f} s "
            "(branches of Wang et al., 2016)."
        ),
    )


def _ball(s: Sweep) -> Claim:
    where, most = s.best("ball_at_2kV_mm")
    return Claim(
        claim="The ball of the thesis' rig moves further with more prestretch.",
        verdict=s.rises(s.columns["ball_at_2kV_mm"]),
        finding=(
            f"At 2 kV {s.at('ball_at_2kV_mm', 1.5):.3f} mm at 1.5, {s.at('ball_at_2kV_mm', 3.5):.3f} mm at 3.5 and "
            f"most, {most:.3f} mm, at {where:.2f}; {s.at('ball_at_2kV_mm', 5.0):.3f} mm at 5."
        ),
    )


_JUDGES: tuple[Callable[[Sweep], Claim], ...] = (
    _strain,
    _voltage,
    _breakdown_field,
    _breakdown_voltage,
    _pull_in,
    _largest_strain,
    _speed,
    _direction,
    _tension,
    _relaxation,
    _ball,
)
