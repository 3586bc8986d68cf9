"""Which cases the study has: plain data, the same for the same size and seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from deatwin.plant.effects import effect_named
from deatwin.plant.errors import DataError
from deatwin.scenarios.concealed_physics.excitations import RICH
from deatwin.scenarios.concealed_physics.key import KEY, OUTSIDE, TIES
from deatwin.scenarios.concealed_physics.mechanisms import log_uniform
from deatwin.scenarios.concealed_physics.reach import SHOWN_BY, reach
from deatwin.scenarios.concealed_physics.sizes import Size, size_named
from deatwin.scenarios.concealed_physics.specs import CaseSpec

PAIR_RATIOS, PAIR_NOISE_SHARES = (0.9, 2.5), (0.01, 0.025)
"""Each of two mechanisms is to reach 0.7 within the tolerance of its strength."""
OUTSIDE_RATIOS, TIE_RATIOS = (0.4, 4.0), (0.7, 3.0)
NOISE_SHARES = (0.01, 0.05)
PAIRABLE = 5.0
"""Least reach, against the noise, of an effect that takes part in a pair."""


def case_specs(size: str, seed: int) -> tuple[CaseSpec, ...]:
    """The cases of a study."""
    of = size_named(size)
    if seed < 0:
        raise DataError(f"seed {seed}: it must not be negative")
    rng = np.random.default_rng([seed, len(size)])
    effects = _few_effects(of.effects, of.library, rng) if of.library else _effects(of, rng)
    several = [
        *_clean(of.clean),
        *effects,
        *_outside(of.outside, rng),
        *_pairs(of, rng),
        *_ties(of.ties, of.library, rng),
    ]
    # A block of seeds for each study.
    first = (seed + 1) * 1_000_000
    return tuple(
        CaseSpec(seed=first + k, form=of.form, library=of.library, **_recorded(given, of.excitation, rng))
        for k, given in enumerate(several)
    )


def pairable(library: Sequence[str] = ()) -> tuple[tuple[str, str], ...]:
    """Pairs of concealed mechanisms that belong to different families and can both be seen, with the best commands."""
    seen = _seen_well(library)
    family = {name: effect_named(KEY[name][0]).family for name in seen}
    return tuple((a, b) for a, b in combinations(seen, 2) if family[a] is not family[b])


def _is_shown(mechanism: str, excitation: str) -> bool:
    """Whether commands that are given, or may be drawn, show a mechanism."""
    return not excitation or mechanism not in SHOWN_BY or SHOWN_BY[mechanism] in excitation.split("+")


def _seen_well(library: Sequence[str]) -> list[str]:
    return [name for name, names in KEY.items() if reach(name) >= PAIRABLE and (not library or names[0] in library)]


Given = dict[str, Any]


def _clean(count: int) -> Iterator[Given]:
    for k in range(count):
        yield {"name": f"clean-{k + 1:03d}", "kind": "clean", "effects": (), "truth": (), "target_ratio": 0.0}


def _effects(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    """Up the ladder of each effect; the least noise where the ratio is to be highest, so that more of it is reached."""
    ratios = sorted(of.ladder * (of.effects // len(of.ladder)))
    for name, names in KEY.items():
        noises = sorted((log_uniform(rng, *NOISE_SHARES) for _ in ratios), reverse=True)
        for k, (ratio, noise) in enumerate(zip(ratios, noises, strict=True)):
            yield {**_effect(name, names[0], f"{k + 1:02d}", ratio), "noise_share": round(noise, 4)}


def _few_effects(count: int, library: Sequence[str], rng: np.random.Generator) -> Iterator[Given]:
    """Some effects that can be seen well."""
    for name in rng.choice(_seen_well(library), count, replace=False):
        yield _effect(str(name), KEY[str(name)][0], "01", 2.8)


def _effect(name: str, truth: str, number: str, ratio: float) -> Given:
    return {
        "name": f"{truth.replace('_', '-')}-{number}",
        "kind": "effect",
        "effects": (name,),
        "truth": (truth,),
        "target_ratio": ratio,
    }


def _outside(count: int, rng: np.random.Generator) -> Iterator[Given]:
    names = list(OUTSIDE)
    for k in range(count):
        yield {
            "name": f"outside-{k + 1:02d}",
            "kind": "outside",
            "effects": (names[k % len(names)],),
            "truth": (),
            "target_ratio": log_uniform(rng, *OUTSIDE_RATIOS),
        }


def _pairs(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    every = pairable(of.library)
    shuffled = [every[number] for number in rng.permutation(len(every))]
    shown = [pair for pair in shuffled if all(_is_shown(name, of.excitation) for name in pair)]
    for k, pair in enumerate(shown[: of.pairs]):
        yield {
            "name": f"pair-{k + 1:02d}",
            "kind": "pair",
            "effects": pair,
            "truth": tuple(KEY[n][0] for n in pair),
            "target_ratio": log_uniform(rng, *PAIR_RATIOS),
            "noise_share": round(log_uniform(rng, *PAIR_NOISE_SHARES), 4),
        }


def _ties(count: int, library: Sequence[str], rng: np.random.Generator) -> Iterator[Given]:
    for k in range(count):
        waveform, alike, mechanism, _ = TIES[k % len(TIES)]
        rivals = tuple(name for name in alike if not library or name in library)
        yield {
            "name": f"tie-{k + 1:02d}",
            "kind": "tie",
            "effects": (mechanism,),
            "truth": (KEY[mechanism][0],),
            "rivals": rivals,
            "target_ratio": log_uniform(rng, *TIE_RATIOS),
            "excitation": waveform,
            "rich": False,
        }


def _recorded(given: Given, excitation: str, rng: np.random.Generator) -> Given:
    """How a case is recorded, where that is left open."""
    drawn: Given = {
        "excitation": str(rng.choice(RICH)),
        "records": int(rng.choice([1, 2])),
        "noise_share": round(log_uniform(rng, *NOISE_SHARES), 4),
    }
    for name in given["effects"]:
        drawn["excitation"] = SHOWN_BY.get(name, drawn["excitation"])
    if excitation:
        drawn |= {"excitation": excitation, "records": 1 + excitation.count("+")}
    if given["kind"] == "tie":
        drawn["records"] = 1
    return {**drawn, **given}
