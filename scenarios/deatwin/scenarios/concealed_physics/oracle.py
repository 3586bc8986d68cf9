"""The oracle: it is told which effect is concealed, and fits the same reduced plant with it to the same recordings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.naming.screen import footprints, leads
from deatwin.ident.mismatch.refit.search import at_its_time, finish, search
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.model import Plant


def consult(nominal: Plant, base: Calibration, parts: Sequence[Part], truth: Sequence[str]) -> Plant | None:
    """Fit the plant with the true effects. `base` of the plant without added effects, on the same samples; `parts`
    all samples.
    """
    if not all(nominal.accepts(effect_named(name)) for name in truth):
        return None
    typical = tuple(effect_named(name) for name in truth)
    fits = []
    for effects, plant in product((_promising(nominal, base, parts, typical), typical), (nominal, base.plant)):
        fit = search(plant.with_effects(*effects), parts)
        if fit.status.ok:
            fits.append(at_its_time(fit, parts))
    return finish(min(fits, key=lambda fit: fit.rms), parts).plant if fits else None


def _promising(
    nominal: Plant, base: Calibration, parts: Sequence[Part], effects: tuple[Effect, ...]
) -> tuple[Effect, ...]:
    """The effects at the shapes that could explain most of what the base plant leaves, to first order."""
    error, whole = nominal.rig.model_error, tuple(parts)
    bench = Bench(
        nominal=nominal,
        effects=effects,
        fitted=whole,
        unseen=whole,
        everything=whole,
        jobs=1,
        stated_error=error,
        expected_error=error,
    )
    shaped = {lead.effect.name: lead.effect for lead in leads(footprints(bench, base, effects, base), base)}
    return tuple(shaped.get(effect.name, effect) for effect in effects)
