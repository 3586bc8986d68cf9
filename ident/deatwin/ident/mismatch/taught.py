"""Residuals of each reading, and the probabilities of the explanations with and without it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import normalised
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, likeliest
from deatwin.ident.mismatch.naming.refit_all_data import fitted_to_all
from deatwin.ident.mismatch.result import Errors, ReadingSummary
from deatwin.ident.mismatch.thresholds import SEVERAL, TINY
from deatwin.ident.parallel import run_jobs
from deatwin.plant.arrays import root_mean_square


def taught(findings: Findings) -> tuple[ReadingSummary, ...] | None:
    """Return the contribution of each reading; None if there is only one reading."""
    problem, rig = findings.problem, findings.problem.nominal.rig
    known = {part.reading: part.weight for part in problem.everything}
    if len(known) < 2:
        return None
    compared = _compared(findings)
    found = []
    for reading, name in zip(rig.readings, ("", *(one.name for one in rig.further)), strict=True):
        if name in known:
            fitted, unseen = (errors_in(findings, name, held_out=held_out) for held_out in (False, True))
            left = max(fitted.after or 0.0, unseen.after or 0.0) or reading.noise
            with_it, without_it = _posteriors(findings, compared, name)
            found.append(
                ReadingSummary(
                    reading=reading.name,
                    unit=reading.unit,
                    # Estimated with the base plant, the noise may contain what was missing; it cannot exceed what the
                    # answer leaves.
                    noise=min(reading.noise, left) if name else findings.base.noise,
                    fitted=fitted,
                    unseen=unseen,
                    with_it=with_it,
                    without_it=without_it,
                )
            )
    return tuple(found)


def errors_in(findings: Findings, name: str = "", *, held_out: bool) -> Errors:
    """Return rms residuals of the calibrated plant and of the answer in one reading, by default the first; SI."""
    parts = findings.problem.unseen if held_out else findings.problem.fitted
    edges = np.cumsum([part.size for part in parts])[:-1]

    def rms(candidate: Candidate) -> float:
        residuals = candidate.unseen if held_out else candidate.calibration.residuals
        pieces = zip(parts, np.split(residuals, edges), strict=True)
        own = np.concatenate([piece / part.weight for part, piece in pieces if part.reading == name])
        return root_mean_square(own)

    return Errors(before=rms(findings.base.chosen), after=rms(findings.answer) if findings.named else None)


def _compared(findings: Findings) -> list[Candidate]:
    """Return the explanations to be compared, the best first."""
    naming = findings.naming
    if not findings.named or naming.best is None:
        return []
    alike = [c for c in naming.candidates if len(c.effects) == len(naming.best.effects)]
    return sorted(alike, key=lambda c: -c.evidence)[:SEVERAL]


def _posteriors(
    findings: Findings, compared: list[Candidate], name: str
) -> tuple[Mapping[str, float] | None, Mapping[str, float] | None]:
    """Return probabilities from all readings, and from all but one; None if fewer than two can be compared."""
    parts = tuple(part for part in findings.problem.everything if part.reading != name)
    fits = run_jobs(fitted_to_all, [(c, parts) for c in compared], workers=findings.problem.jobs)
    fitted = [fit for fit in fits if fit is not None]
    if len(fitted) < 2:
        return None, None
    first, told = likeliest(fitted), findings.naming.probabilities
    without = normalised({c.effects: float(np.exp(advantage(c, first))) for c in fitted})
    whole = normalised({c.effects: max(told.get(c.effects, 0.0), TINY) for c in fitted})
    return _named(whole), _named(without)


def _named(odds: Mapping[tuple[str, ...], float]) -> dict[str, float]:
    ranked = sorted(odds.items(), key=lambda pair: -pair[1])
    return {" + ".join(effects): probability for effects, probability in ranked}
