"""Result of a check: the verdict with all its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from deatwin.control.checking.checkfile import SCHEMA, from_document, to_document
from deatwin.control.checking.operating import OperatingPoint
from deatwin.control.checking.rows import MarginRow
from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding, worst
from deatwin.control.controllers.base import Controller
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop
from deatwin.plant.amplitudes import amount, written_amplitude
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.drawing import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Check:
    """Result of checking a controller before it is used on the actuator.

    Parameters
    ----------
    findings : tuple of Finding
        All judgements; the most severe one decides the verdict.
    operating : OperatingPoint
        Operating point at which the model was linearised.
    controller : Controller or None
        Controller that was judged; None if none could be designed. In that case the fields below are empty too.
    margins : MarginRow or None
        Margins on the model at the controller's operating point.
    table : tuple of MarginRow
        Margins of the model, the plant and the other plants over operating points, and over time if the model varies.
    excited_band_Hz : float or None
        Upper end of the band that the recording excited, Hz; None if it is not known.
    steps, sine : ClosedLoop or None
        Closed-loop runs on the physics plant, with a step and a sine reference.
    others : mapping of str to ClosedLoop
        Runs of the step reference on the other plants, by the plants' names.
    predicted : PredictedLoop or None
        The model's prediction of the step run. Only its band is saved in the file.
    sine_predicted : float or None
        Rms error on the sine reference that the model predicts, in the output's unit.
    caveats : tuple of str
        Remarks beside the findings: residual tests that the model failed, a bias, or a controller that lacks a part
        that was asked for. They do not affect the verdict.
    """

    findings: tuple[Finding, ...]
    operating: OperatingPoint
    controller: Controller | None = None
    margins: MarginRow | None = None
    table: tuple[MarginRow, ...] = ()
    excited_band_Hz: float | None = None
    steps: ClosedLoop | None = None
    sine: ClosedLoop | None = None
    others: Mapping[str, ClosedLoop] = field(default_factory=dict)
    predicted: PredictedLoop | None = None
    sine_predicted: float | None = None
    caveats: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict of the worst finding."""
        return self.worst_case.verdict

    @property
    def worst_case(self) -> Finding:
        """The finding that decides the verdict; if all pass, the one nearest its limit."""
        return worst(self.findings)

    @property
    def reason(self) -> str:
        """Texts of all findings as severe as the verdict; empty if the verdict is `pass`."""
        if self.verdict is Verdict.PASS:
            return f"every limit is kept{self._where}"
        return "; ".join(f.text for f in self.findings if f.verdict is self.verdict)

    @property
    def _where(self) -> str:
        """The operating inputs at which margins were judged, in words."""
        points = [row.operating_input for row in self.table]
        if not points:
            return ""
        low, high = (f"{point:.3g}" for point in (min(points), max(points)))
        return " at inputs of " + amount(low if low == high else f"{low} to {high}", self.operating.input_unit)

    @property
    def least_margins(self) -> dict[str, float]:
        """The least gain margin and phase margin (degrees) of the whole table, including draws."""
        rows = self.table
        return {
            "gain": min((row.gain_low for row in rows), default=inf),
            "phase_deg": min((row.phase_low_deg for row in rows), default=inf),
        }

    @property
    def sentence(self) -> str:
        """The check in one plain sentence; every number in it is a field of the file."""
        if self.controller is None or self.margins is None:
            return f"{self.verdict.value}: {self.reason}.{self._warned}"
        tuned, at, least = self.controller, self.operating, self.least_margins
        margins = ", ".join(
            f"{name} {value:.2g}{unit}" if isfinite(value) else f"{name} infinite"
            for name, value, unit in (("gain margin", least["gain"], ""), ("phase margin", least["phase_deg"], "°"))
        )
        return (
            f"{self.verdict.value}: the {tuned.name} controller with a closed-loop time of "
            f"{tuned.closed_loop_time:.2g} s at {amount(f'{at.input:.3g}', at.input_unit)} (crossover there "
            f"{self.margins.crossover_Hz:.2g} Hz; at worst {margins}): {self.reason}.{self._warned}"
        )

    @property
    def _warned(self) -> str:
        """The caveats as sentences."""
        return "".join(f" {text[0].upper()}{text[1:]}." for text in self.caveats)

    def to_xarray(self) -> Any:
        """Return findings, margins and runs as an `xarray.Dataset`; see `deatwin.control.checking.datasets`."""
        from deatwin.control.checking.datasets import dataset_of

        return dataset_of(self)

    def save(self, path: str | Path) -> None:
        """Write the check as JSON ("deatwin/check/1"): to a temporary file first, which is then renamed.

        Parameters
        ----------
        path : str or Path
            File to write.
        """
        write_document(path, to_document(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a check that `save` wrote.

        Parameters
        ----------
        path : str or Path
            File to read.

        Returns
        -------
        Check
            The check, without the draws of `predicted`.

        Raises
        ------
        ModelError
            If the file is missing, not JSON, of another schema, or malformed.
        """
        return read_document(path, SCHEMA, lambda document: cls(**from_document(document)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the step reference, the output that the model predicted, and the output of the physics plant.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.
        """
        axes = axes_or_new(ax)
        if self.predicted is not None:
            self.predicted.plot(axes)
        if self.steps is not None:
            steps = self.steps
            unit, size = written_amplitude(steps.output_unit)
            axes.plot(steps.timepts, steps.output / size, color="C3", linewidth=1.2, label="on the physics plant")
            if self.predicted is None:
                axes.plot(steps.timepts, steps.reference / size, "--", color="0.4", linewidth=0.9, label="reference")
            axes.set_xlabel("time (s)")
            axes.set_ylabel(f"output ({unit})" if unit else "output")
            axes.legend()
        axes.set_title(f"{self.verdict.value}: {self.worst_case.text}", fontsize="small", wrap=True)
        return axes
