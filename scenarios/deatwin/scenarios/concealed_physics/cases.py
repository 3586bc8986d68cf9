"""Cases of the study as plain data, determined by size and seed, and the key in `key.toml`: right names of concealed mechanisms."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import combinations
from typing import Any

import numpy as np

from deatwin.plant import effect_named
from deatwin.scenarios.concealed_physics.generator.mechanism import log_uniform
from deatwin.scenarios.concealed_physics.generator.specimens import CHECK_SECONDS, RICH, SECONDS, CaseSpec

VISIBLE = 0.3
"""Structural residual over noise from which on a mechanism counts as visible: the lowest rung of the ladder."""

_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("key.toml").read_text(encoding="utf-8"))
_INSIDE, _OUTSIDE, _GROUPS = _FILE["inside"], _FILE["outside"], _FILE["group"]
DIRT: dict[str, str] = {mechanism: known["because"] for mechanism, known in _FILE["dirt"].items()}
"""Imperfections that every laboratory has, and why they are no missing physics."""

KEY: dict[str, tuple[str, ...]] = {mechanism: tuple(known["names"]) for mechanism, known in _INSIDE.items()}
"""Catalogue names of each mechanism, the canonical name first."""
OUTSIDE: dict[str, str] = {mechanism: known["because"] for mechanism, known in _OUTSIDE.items()}
"""Mechanisms outside the catalogue, and why no effect of it describes them."""
RANDOM = frozenset(mechanism for mechanism, known in _OUTSIDE.items() if known.get("random"))
"""Those of them that are random: `disturbance` is right as well as `unknown`."""
REACH: dict[str, float] = {mechanism: known["reach"] for mechanism, known in (_INSIDE | _OUTSIDE).items()}
SHOWN_BY: dict[str, str] = {mechanism: known["shown_by"] for mechanism, known in _INSIDE.items() if "shown_by" in known}
"""The only waveform under which a mechanism reaches so far."""
TIES: tuple[tuple[str, tuple[str, ...], str, str], ...] = tuple(
    (tie["waveform"], tuple(tie["names"]), mechanism, " ".join(tie["because"].split()))
    for tie in _FILE["tie"]
    for mechanism in tie["mechanisms"]
)
"""Input, names that it cannot tell apart, the mechanism, and why."""
TERM_NAMES: dict[str, frozenset[str]] = {
    term: frozenset(" ".join(_GROUPS.get(word, word) for word in words.split()).split())
    for term, words in _FILE["term"].items()
}
"""For each term of the sparse dynamics of a residual, every effect that it may stand for."""


def key_dict() -> dict[str, Any]:
    """Return the whole key as plain data, which is hashed."""
    reasons = {name: " ".join(known["because"].split()) for name, known in _INSIDE.items() if "because" in known}
    return {
        "key": {name: list(names) for name, names in KEY.items()},
        "reasons": reasons,
        "outside": dict(OUTSIDE),
        "random": sorted(RANDOM),
        "dirt": dict(DIRT),
        "reach": dict(REACH),
        "ties": [[waveform, list(names), mechanism, why] for waveform, names, mechanism, why in TIES],
    }


LADDER = (0.1, 0.15, 0.2, 0.3, 0.5, 0.9, 1.6, 2.8, 5.0)
"""Strengths of the cases of an effect: structural residual over noise."""
PAIR_RATIOS, PAIR_NOISE_SHARES = (0.9, 2.5), (0.01, 0.025)
"""Each of two mechanisms is to reach 0.7 within the tolerance of its strength."""
OUTSIDE_RATIOS, TIE_RATIOS = (0.4, 4.0), (0.7, 3.0)
NOISE_SHARES = (0.01, 0.05)
PAIRABLE = 5.0  # Least reach, against the noise, of an effect that takes part in a pair


@dataclass(frozen=True, kw_only=True)
class Size:
    """Numbers of cases, and the length of each recording."""

    clean: int  # Cases without an effect
    effects: int  # Cases of each effect, or of all together where the library is small
    outside: int  # Cases with a mechanism outside the catalogue
    pairs: int  # Cases with two effects
    ties: int  # Cases with poor input
    dirt: int = 0  # Cases without an effect in which the laboratory is not perfect
    ladder: tuple[float, ...] = LADDER
    seconds: float = SECONDS  # Length of a case's recordings together, s
    check_seconds: float = CHECK_SECONDS  # Length of its check record, s
    excitation: str = ""  # Waveforms of every case; drawn if empty
    form: str = "drawn"  # Form of every `CaseSpec`
    library: tuple[str, ...] = ()  # Effects that the diagnosis knows; empty for the whole catalogue


SIZES: Mapping[str, Size] = {
    # One form of rig and few effects, since each plant that is tried has equations of its own to compile.
    "tiny": Size(
        clean=3,
        effects=4,
        outside=2,
        pairs=2,
        ties=1,
        seconds=36.0,
        check_seconds=16.0,
        form="usual",
        library=("creep", "electrode_rc", "quadratic_damping", "sensor_drift"),
    ),
    # Recordings as long as a rig's own: a search that ends well on two minutes may lose its way on seven.
    "long": Size(
        clean=12,
        effects=2,
        outside=14,
        pairs=20,
        ties=0,
        ladder=(0.9, 2.8),
        seconds=420.0,
        check_seconds=120.0,
        excitation="noise+holds",
    ),
    "standard": Size(clean=150, effects=9, outside=40, pairs=40, ties=24, dirt=30),
    "full": Size(clean=300, effects=18, outside=80, pairs=80, ties=48, dirt=60),
}


def case_specs(size: str, seed: int) -> tuple[CaseSpec, ...]:
    """List the cases of a study that are diagnosed."""
    of = SIZES[size]
    rng = np.random.default_rng([seed, len(size)])
    clean = [_given(f"clean-{k + 1:03d}", "clean", (), 0.0) for k in range(of.clean)]
    easy = rng.choice(_seen_well(of.library), of.effects, replace=False) if of.library else ()
    effects = [_effect(str(name), 0, 2.8) for name in easy] if of.library else _effects(of, rng)
    several = [*clean, *_dirt(of), *effects, *_outside(of, rng), *_pairs(of, rng), *_ties(of, rng)]
    first = (seed + 1) * 1_000_000  # a block of seeds for each study
    return tuple(
        CaseSpec(seed=first + k, form=of.form, library=of.library, **_recorded(given, of.excitation, rng))
        for k, given in enumerate(several)
    )


def pairable(library: Sequence[str] = ()) -> tuple[tuple[str, str], ...]:
    """List pairs of mechanisms of different families that can both be detected, with the best commands."""
    seen = _seen_well(library)
    family = {name: effect_named(KEY[name][0]).family for name in seen}
    return tuple((a, b) for a, b in combinations(seen, 2) if family[a] is not family[b])


def _seen_well(library: Sequence[str]) -> list[str]:
    return [name for name, names in KEY.items() if REACH[name] >= PAIRABLE and (not library or names[0] in library)]


Given = dict[str, Any]


def _given(name: str, kind: str, effects: tuple[str, ...], ratio: float, **more: Any) -> Given:
    truth = tuple(KEY[effect][0] for effect in effects if effect in KEY)
    return {"name": name, "kind": kind, "effects": effects, "truth": truth, "target_ratio": ratio, **more}


def _effects(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    """List cases of each effect at increasing ratios; the highest ratio gets the least noise."""
    ratios = sorted(of.ladder * (of.effects // len(of.ladder)))
    for name in KEY:
        noises = sorted((log_uniform(rng, *NOISE_SHARES) for _ in ratios), reverse=True)
        for k, (ratio, noise) in enumerate(zip(ratios, noises, strict=True)):
            yield _effect(name, k, ratio, noise_share=round(noise, 4))


def _effect(name: str, k: int, ratio: float, **more: Any) -> Given:
    return _given(f"{KEY[name][0].replace('_', '-')}-{k + 1:02d}", "effect", (name,), ratio, **more)


def _dirt(of: Size) -> Iterator[Given]:
    """List clean cases with each imperfection alone, and with all together."""
    kinds = [*((name,) for name in DIRT), tuple(DIRT)]
    for k in range(of.dirt):
        yield _given(f"dirt-{k + 1:02d}", "dirt", kinds[k % len(kinds)], 0.0)


def _outside(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    names = list(OUTSIDE)
    for k in range(of.outside):
        yield _given(f"outside-{k + 1:02d}", "outside", (names[k % len(names)],), log_uniform(rng, *OUTSIDE_RATIOS))


def _pairs(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    every = pairable(of.library)
    shuffled = [every[number] for number in rng.permutation(len(every))]
    hidden = {name for name, waveform in SHOWN_BY.items() if of.excitation and waveform not in of.excitation.split("+")}
    shown = [pair for pair in shuffled if hidden.isdisjoint(pair)]
    for k, pair in enumerate(shown[: of.pairs]):
        ratio, noise = log_uniform(rng, *PAIR_RATIOS), log_uniform(rng, *PAIR_NOISE_SHARES)
        yield _given(f"pair-{k + 1:02d}", "pair", pair, ratio, noise_share=round(noise, 4))


def _ties(of: Size, rng: np.random.Generator) -> Iterator[Given]:
    for k in range(of.ties):
        waveform, alike, mechanism, _ = TIES[k % len(TIES)]
        rivals = tuple(name for name in alike if not of.library or name in of.library)
        more = {"rivals": rivals, "excitation": waveform, "rich": False}
        yield _given(f"tie-{k + 1:02d}", "tie", (mechanism,), log_uniform(rng, *TIE_RATIOS), **more)


def _recorded(given: Given, excitation: str, rng: np.random.Generator) -> Given:
    """Draw how a case is recorded, as far as that is not fixed."""
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
