"""How sure a verdict is: the figures that decided it, in one line beside its sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from deatwin.ident.mismatch.detect.detect import DRAWS
from deatwin.ident.mismatch.detect.law import LEVEL
from deatwin.ident.mismatch.detect.origin import FOREIGN, UNPREDICTED
from deatwin.ident.mismatch.quality.quality import FAULTY_SHARE, FEWEST_FAULTY
from deatwin.ident.mismatch.verdict import Verdict
from deatwin.plant.amplitudes import amount, written_unit
from deatwin.studies.report.quantities import three_digits

if TYPE_CHECKING:
    from deatwin.ident.mismatch import DetectionSummary, Diagnosis


def certainty(diagnosis: Diagnosis) -> str:
    """State the figures behind a verdict without causes; empty for one with causes, whose probabilities are shown."""
    said = _LINES.get(diagnosis.verdict)
    return "" if said is None else said(diagnosis)


def _clean(diagnosis: Diagnosis) -> str:
    found, unit = diagnosis.detection, written_unit(diagnosis.output.unit)
    if found.p_value is None or found.excess is None or found.practical is None:
        return ""
    excess, least = (amount(three_digits(x), unit) for x in (found.excess, found.practical))
    if found.taken_up:
        return (
            f"after the fit to a part of the data, the error exceeded the noise by {excess} rms ({_chance(found)}); after the "
            f"fit to all data, the excess is below {least} rms, and such an error does not count as a mismatch"
        )
    return (
        f"{_chance(found)}, and the error exceeds the noise by {excess} rms; it counts as a mismatch only if the probability "
        f"is below {LEVEL:g} and the excess is at least {least} rms"
    )


def _chance(found: DetectionSummary) -> str:
    at_most = "at most " if found.p_value is not None and found.p_value < 1 / DRAWS else ""
    return (
        f"if no physics were missing, a residual this unusual would occur with a probability of "
        f"{at_most}{three_digits(found.p_value)}"
    )


def _unknown(diagnosis: Diagnosis) -> str:
    located = diagnosis.location.place if diagnosis.location else ()
    best = max((place.score for place in located), default=None)
    effect = "" if best is None else f"; no single effect explains more than {100 * best:.0f} % of the mismatch"
    return _beyond_chance(diagnosis) + effect


def _disturbance(diagnosis: Diagnosis) -> str:
    origin = diagnosis.detection.origin
    if origin is None or origin.by == "nothing":
        return _beyond_chance(diagnosis)
    repeats = origin.by == "repeats"
    what = "repeats with the command" if repeats else "can be predicted from command and motion"
    return (
        f"apart from slow drifts, single steps and pure tones, {_percent(origin.share)} % of the mismatch's power {what} "
        f"(at most {_percent(origin.high)} %, two standard deviations higher); a mismatch counts as a disturbance if this "
        f"share is below {100 * (FOREIGN if repeats else UNPREDICTED):g} %"
    )


def _percent(share: float) -> str:
    """Write a share in per cent; an estimate below 0 counts as 0."""
    percent = max(100 * share, 0.0)
    return f"{percent:.1f}" if 0.05 <= percent < 1 else f"{percent:.0f}"


def _beyond_chance(diagnosis: Diagnosis) -> str:
    found, unit = diagnosis.detection, written_unit(diagnosis.output.unit)
    if found.p_value is None or found.excess is None or found.practical is None:
        return ""
    excess, least = (amount(three_digits(x), unit) for x in (found.excess, found.practical))
    return f"{_chance(found)}, and the error exceeds the noise by {excess} rms, where {least} rms would suffice for a mismatch"


def _faulty(diagnosis: Diagnosis) -> str:
    if not diagnosis.faults or diagnosis.readings is None:
        return ""
    bad = sum(fault.samples for fault in diagnosis.faults)
    whole = sum(record.timepts.size for one in diagnosis.readings.experiments for record in one.recordings)
    return (
        f"{bad} of {whole} samples ({three_digits(100 * bad / whole)} %) are faulty; a recording counts as faulty if more "
        f"than {FEWEST_FAULTY} samples and more than {100 * FAULTY_SHARE:g} % of all samples are"
    )


def _not_testable(diagnosis: Diagnosis) -> str:
    moved, unit = diagnosis.detection.moved, written_unit(diagnosis.output.unit)
    if moved is None:
        return ""
    sizes = (amount(three_digits(x), unit) for x in (moved, diagnosis.noise, diagnosis.model_error))
    return "the command moves the reading by {} rms; the sensor noise is {} rms, and the stated model error is {} rms".format(
        *sizes
    )


_LINES: Mapping[Verdict, Callable[[Diagnosis], str]] = {
    Verdict.NONE: _clean,
    Verdict.PARAMETERS: _clean,
    Verdict.UNKNOWN: _unknown,
    Verdict.DISTURBANCE: _disturbance,
    Verdict.DATA_FAULT: _faulty,
    Verdict.NOT_TESTABLE: _not_testable,
}
