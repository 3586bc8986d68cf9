"""Does the explanation hold, above all on data that no fit has seen?

Free runs before and after, on the whole unseen part, on each record and at each third of the amplitudes; each effect
taken out again; shams of each effect, which must not do as well; and the strength of each over what was
fitted, which must not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.datasets import table
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.naming.worth import MOST
from deatwin.ident.mismatch.refit.fitted import fitted_effect
from deatwin.ident.mismatch.refit.search import refit, settle
from deatwin.ident.mismatch.verify.constancy import Constancy, constancies
from deatwin.ident.mismatch.verify.shams import Sham, sham_effects
from deatwin.ident.mismatch.verify.transfer import Transfer, transfers
from deatwin.plant.amplitudes import amplitude_unit, written_amplitude
from deatwin.plant.datasets import dataset
from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.greybox.fit import Calibration

__all__ = ["Ablation", "Verification", "shares_explained", "verify"]


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """What happens when one effect is taken out and the rest is fitted anew.

    Parameters
    ----------
    effect : str
        Canonical name.
    fitted, unseen : float
        Rms residuals without it, SI.
    gain_low : float
        Lower 95 % bound of how much the effect lowers the rms on the unseen part, SI.
    share : float
        Share of the mismatch's energy that returns, from 0 to 1.
    counts : bool
        Whether the error grows for certain over both parts, and on the unseen one by more than the plant's own error.
    """

    effect: str
    fitted: float
    unseen: float
    gain_low: float
    share: float
    counts: bool = False

    @property
    def returns(self) -> bool:
        """Whether the error comes back for certain, on unseen data too.

        What acts at a few steps only is in so few blocks of the unseen part that these alone can be certain of nothing.
        """
        return self.gain_low > 0.0 or self.counts


@dataclass(frozen=True, kw_only=True)
class Verification:
    """An explanation on unseen data; SI.

    Parameters
    ----------
    fitted_before, fitted_after : float
        Rms residuals on the fitted part.
    unseen_before, unseen_after : float
        On the unseen part, in free run.
    gain_low : float
        Lower 95 % bound of the fall on the unseen part.
    counts : bool
        Whether the error falls for certain over both parts, and on the unseen one by more than the plant's own error
        and by most of what is more than noise.
    ablations : tuple of Ablation
        One for each effect.
    shams : tuple of Sham
        Of each kind for each effect.
    transfers : tuple of Transfer
        Records, where there are several, and thirds of the amplitudes.
    constancies : tuple of Constancy
        One for each effect that is no event.
    noise : float
        Rms.
    output_unit : str
        SI unit of the reading.
    whole : Calibration or None
        The amended plant fitted to all recordings, where that was needed: whoever needs it next has it here.
    """

    fitted_before: float
    fitted_after: float
    unseen_before: float
    unseen_after: float
    gain_low: float
    counts: bool = False
    ablations: tuple[Ablation, ...] = ()
    shams: tuple[Sham, ...] = ()
    transfers: tuple[Transfer, ...] = ()
    constancies: tuple[Constancy, ...] = ()
    noise: float = 0.0
    output_unit: str = ""
    whole: Calibration | None = None

    @property
    def holds(self) -> bool:
        """Whether nothing speaks against the explanation; see `doubted` for when it is shown all the same."""
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """What speaks against it, each in a clause."""
        falls = self.gain_low > 0.0 or self.counts  # as for `Ablation.returns`
        found = [] if falls else ["the error on unseen data does not fall for certain"]
        found += [
            f"without {a.effect} the error on unseen data does not return for certain"
            for a in self.ablations
            if not a.returns
        ]
        found += [f"{s.effect} {s.kind.value} does as well" for s in self.shams if not s.rejected]
        found += [f"the error grows on unseen data: {t.part}" for t in self.transfers if t.worse]
        found += [
            f"the strength of {c.effect} would change by {100 * c.change:.0f} % of itself over "
            + ("the recordings, which would take most of what is left" if c.mends else "the fitted part")
            for c in self.constancies
            if c.change is not None and not c.holds
        ]
        return tuple(found)

    @property
    def doubted(self) -> tuple[str, ...]:
        """Effects of several without which the error on unseen data does not return for certain, though with others.

        Nothing else may speak against the explanation: then it stands, and the one without that effect beside it.
        """
        spared = tuple(a.effect for a in self.ablations if not a.returns)
        return spared if len(self.failures) == len(spared) < len(self.ablations) else ()

    def to_dict(self) -> dict[str, Any]:
        """The field ``verification`` of ``diagnosis.json``; amplitudes in the unit that is reported."""
        size = amplitude_unit(self.output_unit)[1]
        return {
            "holds": self.holds,
            "failures": list(self.failures),
            "gain_low": self.gain_low / size,
            "counts": self.counts,
            "ablation": [
                {
                    "effect": a.effect, "fitted": a.fitted / size, "unseen": a.unseen / size,
                    "gain_low": a.gain_low / size, "share": a.share, "counts": a.counts,
                }
                for a in self.ablations
            ],
            "shams": [
                {
                    "effect": s.effect, "sham": s.kind.value, "share": s.share, "expected": s.expected,
                    "rejected": s.rejected if s.share is not None else None, "skipped": s.skipped,
                }
                for s in self.shams
            ],
            "transfer": [
                {
                    "part": t.part, "before": t.before / size, "after": t.after / size,
                    "gain_low": t.gain_low / size, "gain_high": t.gain_high / size, "worse": t.worse,
                }
                for t in self.transfers
            ],
            "constancy": [{**asdict(c), "holds": c.holds} for c in self.constancies],
        }  # fmt: skip

    def to_xarray(self) -> Any:
        """Return rms residuals before and after, and tables of ablations, shams and transfers, as an `xarray.Dataset`.

        All is in SI.
        """
        unit, stages = self.output_unit, ("stage", ["before", "after"])
        shams = [{**asdict(s), "kind": s.kind.value, "rejected": s.rejected} for s in self.shams]
        return dataset(
            {
                "fitted": (stages[0], [self.fitted_before, self.fitted_after], unit, "rms residual on the fitted part"),
                "unseen": (stages[0], [self.unseen_before, self.unseen_after], unit, "rms residual on the unseen part"),
                "gain_low": ((), self.gain_low, unit, "lower 95 % bound of the fall on the unseen part"),
                "noise": ((), self.noise, unit, "rms of the sensor's noise"),
                **table("ablation", map(asdict, self.ablations), {
                    "fitted": (unit, "rms residual without the effect"),
                    "unseen": (unit, "rms residual without the effect"),
                    "gain_low": (unit, "lower 95 % bound of what the effect takes away"),
                    "share": ("", "share of the mismatch's energy that returns"),
                }),
                **table("sham", shams, {"share": ("", "gain relative to that of the effect itself"),
                                        "expected": ("", "the same if the effect is the truth")}),
                **table("transfer", [{**asdict(t), "worse": t.worse} for t in self.transfers], {
                    "before": (unit, "rms residual"), "after": (unit, "rms residual"),
                    "gain_low": (unit, "lower 95 % bound of the fall"),
                    "gain_high": (unit, "upper 95 % bound of the fall"),
                    "floor": (unit, "rms of noise and model error"),
                    "model_error": (unit, "rms of the plant's own error"),
                }),
                **table("constancy", [{**asdict(c), "holds": c.holds} for c in self.constancies], {
                    "change": ("", "relative change of the strength over the recordings"),
                    "deviation": ("", "its standard deviation"),
                    "own": ("", "share of its power that nothing else can make"),
                }),
            },
            {"stage": stages},
            {"holds": self.holds, "failures": list(self.failures)},
        )  # fmt: skip

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the error on unseen data: before and after on each part, without each effect, and with its shams.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            A new figure without it.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        unit, size = written_amplitude(self.output_unit)
        rows = [("all of it", self.unseen_before, self.unseen_after)]
        rows += [(t.part, t.before, t.after) for t in self.transfers]
        rows += [(f"without {_plain(a.effect)}", self.unseen_before, a.unseen) for a in self.ablations]
        rows += [(f"{_plain(s.effect)} {s.kind.value}", *self._with_sham(s)) for s in self.shams if s.share is not None]
        for place, (_, before, after) in enumerate(rows):
            axes.plot([before / size, after / size], [place, place], color="0.6", linewidth=1.2, zorder=1)
        places = np.arange(len(rows))
        axes.scatter([b / size for _, b, _ in rows], places, marker="o", color="C1", label="before", zorder=2)
        axes.scatter([a / size for _, _, a in rows], places, marker="D", color="C0", label="after", zorder=3)
        axes.axvline(self.noise / size, color="0.5", linestyle=":", label="sensor noise")
        axes.set_yticks(places, [name for name, _, _ in rows])
        axes.invert_yaxis()
        axes.set_xlim(left=0.0)
        axes.set_xlabel(f"rms residual, unseen ({unit})")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, markerscale=1.0)
        return axes

    def _with_sham(self, sham: Sham) -> tuple[float, float]:
        """Rms before, and after with the sham in the effect's place, to first order."""
        without = next((a.unseen for a in self.ablations if a.effect == sham.effect), self.unseen_before)
        gained = (sham.share or 0.0) * (without**2 - self.unseen_after**2)
        return without, float(np.sqrt(max(without**2 - gained, 0.0)))


def verify(
    base: Candidate,
    amended: Candidate,
    rng: np.random.Generator,
    bench: Bench | None = None,
    tried: Sequence[Candidate] = (),
) -> Verification:
    """Compare a candidate with the base plant on the unseen part, in every way in which it could fail.

    Parameters
    ----------
    base, amended : Candidate
        Judged on the same samples.
    rng : numpy.random.Generator
        Of the paired block bootstrap and of random phases.
    bench : Bench, optional
        Recordings; without them each record, the amplitudes and the shams cannot be told.
    tried : sequence of Candidate
        Where the explanation without one of its effects is looked up before it is fitted.

    Returns
    -------
    Verification
    """
    reduced = _reduced(base, amended, bench, tried)
    whole = None if bench is None else _whole(amended, bench)
    return Verification(
        fitted_before=base.calibration.rms, fitted_after=amended.calibration.rms,
        unseen_before=_rms(base.unseen), unseen_after=_rms(amended.unseen),
        gain_low=bootstrap_gain(block_losses(base.unseen), block_losses(amended.unseen), rng),
        ablations=tuple(_ablation(name, base, amended, without, rng) for name, without in reduced.items()),
        shams=() if bench is None else _shams(amended, reduced, bench, rng),
        transfers=() if bench is None else transfers(base, amended, bench, rng),
        constancies=() if bench is None else _constancies(amended, bench, whole),
        counts=_takes_most_unseen(base, amended) and _counts(base, amended, rng),
        noise=amended.noise, output_unit=amended.calibration.plant.rig.output_unit, whole=whole,
    )  # fmt: skip


def shares_explained(
    base: Candidate, amended: Candidate, tried: Sequence[Candidate], noise: float
) -> dict[str, float]:
    """What share of the mismatch's energy goes with each effect of a candidate.

    An effect's share is what returns when it alone is taken out (the other effects refitted), relative to the
    base plant's energy above noise; for a single effect that is what the whole candidate explains.

    Parameters
    ----------
    base, amended : Candidate
        Without effects, and the explanation.
    tried : sequence of Candidate
        Where the reduced candidates are looked up.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    dict of str to float
        From 0 to 1.
    """
    found = _reduced(base, amended, None, tried)
    return {name: _share(base, amended, found.get(name, base), noise) for name in amended.effects}


def _share(base: Candidate, amended: Candidate, without: Candidate, noise: float) -> float:
    missing = max(float(base.losses.mean()) - noise**2, 1e-300)
    return float(np.clip((without.losses.mean() - amended.losses.mean()) / missing, 0.0, 1.0))


def _reduced(
    base: Candidate, amended: Candidate, bench: Bench | None, tried: Sequence[Candidate]
) -> dict[str, Candidate]:
    """The explanation without each of its effects, fitted; without those that cannot be had."""
    carried = (c for c in tried if not c.calibration.given_up)
    known = {frozenset(c.effects): c for c in (*carried, base)}
    found = {}
    for name in amended.effects:
        rest = frozenset(amended.effects) - {name}
        candidate = known.get(rest) or (None if bench is None else _refitted(bench, amended, name))
        if candidate is not None:
            found[name] = candidate
    return found


def _refitted(bench: Bench, amended: Candidate, name: str) -> Candidate | None:
    fit = settle(amended.calibration.plant.without_effects(name), bench.fitted, amended.noise)
    return judge(bench, fit, amended.noise) if fit.status.ok else None


def _ablation(
    name: str, base: Candidate, amended: Candidate, without: Candidate, rng: np.random.Generator
) -> Ablation:
    gain_low = bootstrap_gain(block_losses(without.unseen), block_losses(amended.unseen), rng)
    return Ablation(
        effect=name, fitted=without.calibration.rms, unseen=_rms(without.unseen), gain_low=gain_low,
        share=_share(base, amended, without, amended.noise),
        counts=_counts(without, amended, rng),
    )  # fmt: skip


def _counts(without: Candidate, amended: Candidate, rng: np.random.Generator) -> bool:
    """Whether the error is less for certain over both parts, and on the unseen one by more than the plant's own.

    The power of the unseen part may differ so much by chance: it is no certainty of that part.
    """
    over_both = bootstrap_gain(without.losses, amended.losses, rng)
    return over_both > 0.0 and _gained_unseen(without, amended) > amended.calibration.plant.rig.model_error**2


def _takes_most_unseen(base: Candidate, amended: Candidate) -> bool:
    """Whether most of what is more than noise on the unseen part is gone: chance does not take so much."""
    return _gained_unseen(base, amended) > MOST * float(np.mean(base.unseen**2) - amended.noise**2)


def _gained_unseen(without: Candidate, amended: Candidate) -> float:
    """Mean square by which the unseen part is better explained, square of the residual's unit."""
    return float(np.mean(without.unseen**2) - np.mean(amended.unseen**2))


def _whole(amended: Candidate, bench: Bench) -> Calibration | None:
    """The fit to all recordings of an explanation that leaves too much; None of others, or where there is none."""
    if amended.adequate or not amended.effects:
        return None
    fit = refit(amended.calibration, bench.everything)
    return None if fit is amended.calibration else fit


def _constancies(amended: Candidate, bench: Bench, whole: Calibration | None) -> tuple[Constancy, ...]:
    """Over what was fitted; where the explanation leaves too much, over all recordings if that refutes an effect."""
    fitted = constancies(amended.calibration, bench.fitted, amended.effects)
    if whole is None:
        return fitted
    # The extrapolation may leave too much where this fit does not; but what is no part of the noise's power is nothing.
    left = max(whole.rms**2 - amended.noise**2, practical_size(amended.noise, 0.0) ** 2)
    everywhere = constancies(whole, bench.everything, amended.effects, too_much=float(np.sqrt(left)))
    return tuple(e if e.mends and not e.holds else f for f, e in zip(fitted, everywhere, strict=True))


def _shams(
    amended: Candidate, reduced: dict[str, Candidate], bench: Bench, rng: np.random.Generator
) -> tuple[Sham, ...]:
    found: list[Sham] = []
    for name, without in reduced.items():
        effect = fitted_effect(amended.calibration.plant, name)
        gain = _gained_unseen(without, amended)
        found += sham_effects(without.calibration, effect, gain, bench.fitted, bench.everything, rng)
    return tuple(found)


def _rms(residual: np.ndarray) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _plain(name: str) -> str:
    return name.replace("_", " ")
