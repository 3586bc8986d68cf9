"""Result of the tests of an explanation on held-out data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from deatwin.ident.mismatch.result import (
    Ablation,
    ConstancySummary,
    PlaceboSummary,
    TransferSummary,
    VerificationSummary,
)
from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.placebos import Placebo
from deatwin.ident.mismatch.verify.transfer import Transfer
from deatwin.plant.amplitudes import amplitude_unit, axis_label, written_amplitude
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, table_along, variable
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.effects.titles import effects_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.greybox.fit import Calibration


@dataclass(frozen=True, kw_only=True)
class Verification(Described):
    """Results of the tests of an explanation by `verify`. Residuals are in SI units.

    Parameters
    ----------
    fitted_before, fitted_after : float
        Rms residuals on fitted data, without and with the explanation.
    unseen_before, unseen_after : float
        Rms residuals on held-out data, without and with the explanation.
    gain_low : float
        Lower 95 % bound of the decrease of the rms residual on held-out data.
    counts : bool
        True if the explanation is accepted even if `gain_low` is not positive. The mean square residual must then
        decrease significantly over all data. On held-out data, it must decrease by more than the square of the model
        error, and its excess over the noise variance must at least be halved.
    ablations : tuple of Ablation
        For each effect, the result when this effect is removed and all other parameters are refitted.
    shams : tuple of Placebo
        Results with placebo effects, one for each kind of placebo and each effect.
    transfers : tuple of Transfer
        Residuals without and with the explanation on parts of the held-out data: on each recording, if there are
        several, and on blocks with small, medium and large commands.
    constancies : tuple of Constancy
        For each effect that is not an event, the change of its strength from the beginning to the end of the fitted
        data, in a fit that lets the strength vary.
    noise : float
        Sensor noise, rms.
    output_unit : str
        SI unit of the reading.
    whole : Calibration or None
        The plant with the explanation, calibrated on all data. None if this was not needed.
    perhaps_absent : tuple of str
        Names of the effects whose strength may be zero: its 95 % interval includes zero, at the fitted values of the
        effect's other parameters. Empty if there is only one effect: the detection has tested whether it is absent.
    one_clock : tuple of str
        Names of two effects with the same time constant, which may be a single effect of another kind. Empty if there
        are none.
    """

    fitted_before: float
    fitted_after: float
    unseen_before: float
    unseen_after: float
    gain_low: float = field(
        metadata=variable(
            unit=attrgetter("output_unit"),
            about="lower 95 % bound of the reduction of the rms residual on held-out data",
        )
    )
    counts: bool = False
    ablations: tuple[Ablation, ...] = field(default=(), metadata=table_along("ablation"))
    shams: tuple[Placebo, ...] = field(default=(), metadata=table_along("sham"))
    transfers: tuple[Transfer, ...] = field(default=(), metadata=table_along("transfer"))
    constancies: tuple[Constancy, ...] = field(default=(), metadata=table_along("constancy"))
    noise: float = field(
        default=0.0, metadata=variable(unit=attrgetter("output_unit"), about="rms of the sensor's noise")
    )
    output_unit: str = ""
    whole: Calibration | None = None
    perhaps_absent: tuple[str, ...] = ()
    one_clock: tuple[str, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "stage": coordinate("stage", of=lambda _: ["before", "after"]),
        "fitted": variable(
            "stage",
            of=lambda found: [found.fitted_before, found.fitted_after],
            unit=attrgetter("output_unit"),
            about="rms residual on fitted data",
        ),
        "unseen": variable(
            "stage",
            of=lambda found: [found.unseen_before, found.unseen_after],
            unit=attrgetter("output_unit"),
            about="rms residual on held-out data",
        ),
        "holds": attribute(),
        "failures": attribute(of=lambda found: list(found.failures)),
    }

    @property
    def holds(self) -> bool:
        """True if all tests are passed. The explanation may still be reported if not; see ``doubted``."""
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """Descriptions of the failed tests, as clauses."""
        falls = self.gain_low > 0.0 or self.counts  # as for `Ablation.returns`
        found = [] if falls else ["it is not certain that the explanation lowers the error on held-out data"]
        found += [
            f"it is not certain that the error on held-out data rises if {a.effect} is removed"
            for a in self.ablations
            if not a.returns
        ]
        found += [
            f"a placebo effect ({s.effect} {s.kind.value}) fits as well as {s.effect} itself"
            for s in self.shams
            if not s.rejected
        ]
        found += [
            f"the explanation raises the error on a part of the held-out data: {t.part}"
            for t in self.transfers
            if t.worse
        ]
        found += [
            f"the strength of {c.effect} is not constant: in a fit that lets it vary, it changes by {100 * c.change:.0f} % over "
            + ("the recordings, and this change explains most of the remaining error" if c.mends else "the fitted data")
            for c in self.constancies
            if c.change is not None and not c.holds
        ]
        found += [
            f"the strength of {effect} may be zero, even at the fitted values of its other parameters"
            for effect in self.perhaps_absent
        ]
        if self.one_clock:
            found.append(
                " and ".join(self.one_clock)
                + " have the same time constant, so they may be a single effect of another kind"
            )
        return tuple(found)

    @property
    def doubted(self) -> tuple[str, ...]:
        """Effects whose removal does not significantly raise the error, or whose strength may be zero.

        Empty if another test failed, too, or if this holds for all effects. Otherwise the explanation is reported
        together with the one without the doubted effect.
        """
        useless = [a.effect for a in self.ablations if not a.returns]
        spared = tuple(dict.fromkeys([*useless, *self.perhaps_absent]))
        only = len(self.failures) == len(useless) + len(self.perhaps_absent)
        return spared if only and len(spared) < len(self.ablations) else ()

    @property
    def summary(self) -> VerificationSummary:
        """Summarise the tests for a diagnosis, with amplitudes in the unit of `Diagnosis.output`."""
        size = amplitude_unit(self.output_unit)[1]
        return VerificationSummary(
            holds=self.holds,
            failures=self.failures,
            gain_low=self.gain_low / size,
            counts=self.counts,
            ablation=tuple(
                replace(a, fitted=a.fitted / size, unseen=a.unseen / size, gain_low=a.gain_low / size)
                for a in self.ablations
            ),
            shams=tuple(
                PlaceboSummary(
                    effect=s.effect,
                    kind=s.kind.value,
                    share=s.share,
                    expected=s.expected,
                    rejected=s.rejected if s.share is not None else None,
                    skipped=s.skipped,
                )
                for s in self.shams
            ),
            transfer=tuple(
                TransferSummary(
                    part=t.part,
                    before=t.before / size,
                    after=t.after / size,
                    gain_low=t.gain_low / size,
                    gain_high=t.gain_high / size,
                    worse=t.worse,
                )
                for t in self.transfers
            ),
            constancy=tuple(ConstancySummary(**asdict(c), holds=c.holds) for c in self.constancies),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the error on held-out data without and with the explanation.

        The first row is for all held-out data. Further rows show the error on parts of these data, without each effect,
        and with placebo effects.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; a new figure by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        unit, size = written_amplitude(self.output_unit)
        rows = [("all held-out data", self.unseen_before, self.unseen_after)]
        rows += [(t.part, t.before, t.after) for t in self.transfers]
        rows += [(f"without {effects_in_words(a.effect)}", self.unseen_before, a.unseen) for a in self.ablations]
        rows += [
            (f"{effects_in_words(s.effect)} {s.kind.value}", *self._with_placebo(s))
            for s in self.shams
            if s.share is not None
        ]
        for place, (_, before, after) in enumerate(rows):
            axes.plot([before / size, after / size], [place, place], color="0.6", linewidth=1.2, zorder=1)
        places = np.arange(len(rows))
        axes.scatter([b / size for _, b, _ in rows], places, marker="o", color="C1", label="before", zorder=2)
        axes.scatter([a / size for _, _, a in rows], places, marker="D", color="C0", label="after", zorder=3)
        axes.axvline(self.noise / size, color="0.5", linestyle=":", label="sensor noise")
        axes.set_yticks(places, [name for name, _, _ in rows])
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.05 * axes.get_xlim()[1])
        axes.set_xlabel(axis_label("rms residual on held-out data", unit))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, markerscale=1.0)
        return axes

    def _with_placebo(self, sham: Placebo) -> tuple[float, float]:
        """Return the rms error without the effect, and with a placebo effect in its place, to first order."""
        without = next((a.unseen for a in self.ablations if a.effect == sham.effect), self.unseen_before)
        gained = (sham.share or 0.0) * (without**2 - self.unseen_after**2)
        return without, float(np.sqrt(max(without**2 - gained, 0.0)))
