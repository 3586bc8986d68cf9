"""Compare the verdicts of several folders in a table with drawings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deatwin.app.live.glance import DRAWING
from deatwin.app.live.verdicts import Verdict

SIZE = (2.7, 1.2)
MOST = 6  # Most verdicts that are compared at once


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Several verdicts, side by side."""

    verdicts: tuple[Verdict, ...]
    limits: tuple[float, ...]
    same_recordings: bool | None

    def html(self) -> str:
        """Return the table with its drawings, for a page that defines the report's colours as CSS variables."""
        from deatwin.studies.report.rendering import templates

        pictures = [
            _drawn(number, verdict, limit) if limit else ""
            for number, (verdict, limit) in enumerate(zip(self.verdicts, self.limits, strict=True))
        ]
        return (
            templates("deatwin.app.live").get_template("comparison.html.j2").render(comparison=self, pictures=pictures)
        )


def compare(verdicts: Sequence[Verdict]) -> Comparison:
    """Arrange verdicts side by side."""
    taken = tuple(verdicts[:MOST])
    largest: dict[str, float] = {}
    for verdict in taken:
        largest[verdict.unit] = max((largest.get(verdict.unit, 0.0), *verdict.errors))
    seen = [verdict.recordings for verdict in taken]
    return Comparison(
        verdicts=taken,
        limits=tuple(largest[verdict.unit] if verdict.errors else 0.0 for verdict in taken),
        same_recordings=len(set(seen)) == 1 if len(seen) > 1 and all(seen) else None,
    )


def _drawn(number: int, verdict: Verdict, limit: float) -> str:
    """Draw errors before and after, on fitted and on held-out data, with the noise."""
    from deatwin.studies.report.drawing import COLOURS, draw, inline

    with DRAWING, draw(SIZE) as figure:
        axes = figure.subplots()
        for height, (before, after) in enumerate((verdict.unseen, verdict.fitted)):
            if before is not None and after is not None:
                axes.plot([before, after], [height, height], color=COLOURS["grid"][0], linewidth=3, zorder=2)
            for value, role, marker in ((before, "before", "o"), (after, "after", "D")):
                if value is not None:
                    axes.plot(value, height, marker, color=COLOURS[role][0], markersize=7, zorder=3)
        if verdict.noise is not None:
            axes.axvline(verdict.noise, color=COLOURS["measured"][0], linestyle="--", linewidth=1.2)
        axes.set_yticks([0, 1], ["held out", "fitted"])
        axes.set_ylim(-0.6, 1.6)
        axes.set_xlim(-0.03 * limit, 1.06 * limit)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(f"error in {verdict.unit} rms")
        return inline(figure, f"compared-{number}", f"Errors before and after, {verdict.verdict}")
