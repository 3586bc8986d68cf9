"""Parameters that change with time, and what they do to every order of the frequency response.

First systems whose parameters are known at each instant: a smoother finds them, and the responses frozen in time are
held against truth, against the rate of variation, and for how often their bands cover. Then the six actuators: mean and
gain in sliding windows before any fit, parameters of a fixed structure along the record, the equilibrium, TV-GFRFs and
TV-NOFRFs, the output's short-time spectrum against the recording's, and what varying parameters are worth on samples
that they have not seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.ident.narx.fleet import DRIFTING
from deatwin.ident.narx.varying_systems import BLOCK, CONSTANT, LIKELIEST, REFINED, SHARES, VARYING
from deatwin.scenarios.time_varying.figures import fleet_drawings, known_drawings
from deatwin.scenarios.time_varying.measures import CHANCE, HELD, WORDS, judge
from deatwin.scenarios.time_varying.study import FACTOR, STRUCTURE, Study, carry_out
from deatwin.studies.report.drawing import key_of
from deatwin.studies.report.story import StoryPage, finish, reached
from deatwin.studies.report.words import Span, notes
from deatwin.studies.stories import Setting

SAVED_EVERY = 20  # Every so many times of a trajectory are saved: covariances of every second are large


def run(setting: Setting) -> Mapping[str, Any]:
    """Estimate time-varying parameters and responses of known systems and of the six actuators."""
    record = setting.record()
    study = carry_out(setting.seed, jobs=setting.jobs, progress=setting.progress)
    setting.progress(0.92, "judging and drawing")
    rows, tracks = judge(study), [one.track for one in study.driven]
    for track in tracks:
        setting.folder.save(f"theta/{key_of(track.name).lower()}.json", track.trajectory.thinned(SAVED_EVERY).save)
    page = StoryPage(
        title="time-varying",
        sentence=WORDS.text(
            "sentence", constant=_unseen(study, CONSTANT), varying=_unseen(study, VARYING), reached=reached(rows)
        ),
        rows=rows,
        notes=notes(__package__, **_numbers(study)),
        figures=[*known_drawings(study.known), *fleet_drawings(study)],
    )
    errors = [
        {"actuator": t.name, "share": t.share, **{kind: dict(getattr(t, kind)) for kind in ("seen", "unseen", "ahead")}}
        for t in tracks
    ]
    return finish(setting.folder, record, page, actuators=errors)


def _unseen(study: Study, way: str) -> Span:
    """Errors on blocks left out of the fit, %."""
    return Span(100 * one.track.unseen[way] for one in study.driven)


def _numbers(study: Study) -> dict[str, Any]:
    """Numbers of the notes."""
    tracks = [one.track for one in study.driven]
    seldom = [
        f"{'the constant' if str(term) == '1' else term} of “{one.name}” ({100 * share:.1f} %)"
        for one in study.known.followed
        for term, share in zip(one.trajectory.terms, one.covered, strict=True)
        if share < HELD
    ]
    return {
        "seen": 100 * max(track.seen[LIKELIEST] for track in tracks),
        "likeliest": _unseen(study, LIKELIEST),
        "constant": _unseen(study, CONSTANT),
        "varying": _unseen(study, VARYING),
        "refined": _unseen(study, REFINED),
        "losing": [track.name for track in tracks if track.unseen[VARYING] >= track.unseen[REFINED]],
        "block": BLOCK,
        "structure": STRUCTURE,
        "step": 0.02 * FACTOR,
        "worst": max(one.series_error for one in study.driven),
        "shares": ", ".join(f"{track.share:g} for {track.name}" for track in tracks),
        "least": SHARES[0] if SHARES[0] in [track.share for track in tracks] else None,
        "unsure": [one.name for one in study.driven if one.name in DRIFTING and one.chance >= CHANCE],
        "seldom": seldom,
        "held": 100 * HELD,
    }
