"""What the page says in words: what was done, what the measures mean, and what they cannot show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from deatwin.control.checking.specification import Specification, Verdict
from deatwin.scenarios.control_check.calibration import CALIBRATED
from deatwin.scenarios.control_check.concealed import BAND, CLOSED_LOOP_TIME, FAST, OTHER_TIMES, SECONDS, SLOW
from deatwin.scenarios.control_check.matters import Matters
from deatwin.scenarios.control_check.promises import QUANTITIES, Promise, kept, promises
from deatwin.scenarios.control_check.rates import broken, caught, in_words, inside, sound
from deatwin.scenarios.control_check.rigs import CONCEALED
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import Tracking
from deatwin.scenarios.control_check.trials import NO_MODEL, Outcome
from deatwin.studies.report.story import Note, Row


def answer(study: Study, rows: Sequence[Row]) -> str:
    """What came out, in a few sentences."""
    factor = study.tracking[0].ratio("PI", "inverse")
    passed, unsound = inside(study.outcomes), caught(study.outcomes)
    return (
        f"PI behind the inverse of the static curve tracks with an error {factor:.1f} times below that of PI alone, at "
        f"equal margins. Of {len(study.outcomes)} random rigs and designs the check passes {passed.count}, of which "
        f"{passed.hits} keep inside the predicted band; {unsound.count} break a limit on the true rig, of which it "
        f"passes {unsound.count - unsound.hits}. {sum(row.passed for row in rows)} of {len(rows)} stated measures are "
        "reached."
    )


def notes(study: Study) -> list[Note]:
    """Write the notes."""
    return [
        _question(),
        _tracking(study.tracking),
        _concealed(),
        _trials(study.outcomes),
        _models(study.matters),
        _limits(),
    ]


def _question() -> Note:
    return Note(
        title="What is asked",
        paragraphs=[
            "A check is given a recording, a NARX model identified from it and a physics plant fitted to it, and says "
            "of a controller pass, marginal or fail. Here the true rig is a simulation that no check sees, so that "
            "each verdict can be held against what the controller then does on it.",
            "Margins are of the linearised loop with the identified model. A design is sound if its runs on the true "
            "rig keep every limit of the check: they reach their end, overshoot, ring and saturate little, and end "
            "where they should. How well a slow sine is tracked against the model's own prediction is left out of "
            "that, as it is no wish of a user.",
        ],
    )


def _tracking(every: Sequence[Tracking]) -> Note:
    nominal, hysteretic = every[0], every[1]
    best = min(one.rms for name, one in nominal.tracked.items() if name.startswith("oracle"))
    against = nominal.tracked["inverse with dynamics"].rms / best
    inverses = ("inverse", "inverse with dynamics")
    pays, near = (
        " and ".join(f"{f(name):.1f}" for name in inverses)
        for f in (lambda n: hysteretic.ratio("PI", n), lambda n: hysteretic.ratio(n, f"oracle: {n}"))
    )
    return Note(
        title="What the inverse buys",
        paragraphs=[
            "The displacement goes with about the square of the voltage, and stretch bends it further. The inverse of "
            "the identified static curve turns the reference into a command; PI corrects what is left. The local "
            "feedback is that of PI alone, so that the margins are the same, and all the gain is feedforward. With "
            "dynamics, the feedforward goes through a stable inverse of the linear model as well.",
            "An oracle is the same design, made on the true plant's own static curve and linear model, so that like "
            f"is compared with like. The design with dynamics has {against:.2f} times the error of the best oracle.",
            "On the specification of the fleet, whose ball drags grease, hysteresis is not in any static curve: there "
            f"the error of PI alone is only {pays} times that behind the inverse, bare and with dynamics, and "
            f"theirs is {near} times that of their oracles. It is reported, and nothing is demanded of it.",
        ],
    )


def _concealed() -> Note:
    return Note(
        title="What a concealed effect does to a design",
        paragraphs=[
            "The true rig has an effect that its nominal plant does not have. One recording of "
            f"{SECONDS:.0f} s, of noise up to {BAND:.0f} Hz, is diagnosed; one rule makes a controller from the base "
            "plant, fitted as well as it can be without the effect, and one from the plant that the diagnosis amended. "
            "Both are checked on a second recording's NARX model and the amended plant, and run on the true rig.",
            "The case was made so that the effect matters. An electrode of 0.05 s does not trouble this design, so one "
            "of 0.4 s is concealed. The closed-loop time is as long: "
            f"{CLOSED_LOOP_TIME:g} s, which was chosen after 0.3 s had been seen to be no clear case; designs for "
            f"{' and '.join(f'{time:g}' for time in OTHER_TIMES)} s are in the table. At less "
            "than 0.3 s the rule cancels the lag of 0.3 s that the base plant has in "
            "the electrode's place; such a design overshoots by some 15 %, which is within the limits, and is passed. "
            f"The second recording is noise as well, half of its variance up to {SLOW:.1f} Hz, the bandwidth of the "
            f"loop, and half up to {FAST:.0f} Hz, beyond the frequency of the gain margin. The first comes through the "
            "electrode so weak that the film hardly moves as far as the check's steps and operating points, and beyond "
            "its training data a polynomial has the slope that its terms happen to have: on 3 of 26 recordings like "
            "the first the check called the amended design marginal, since the steps left the predicted band or draws "
            "of the model had too little margin at a level that had never been recorded. On one recording like the "
            "second to which the base plant was fitted, its design was sound, and passed: so much hangs on what is "
            "recorded.",
            "Creep is concealed for comparison. Integral action takes away what creeps, so that both designs are "
            "expected to do, and nothing is demanded.",
        ],
    )


def _trials(outcomes: Sequence[Outcome]) -> Note:
    passed = sound(outcomes)
    nothing = sum(o.verdict == NO_MODEL for o in outcomes)
    cautious = sum(o.verdict != Verdict.PASS.value and o.sound is True for o in outcomes)
    missed = len(broken(outcomes))
    return Note(
        title="Random rigs, random designs",
        paragraphs=[
            f"Each of {len(outcomes)} trials fabricates a rig beside the specification of the fleet, with twice its "
            f"tolerances. {100 * CONCEALED:.0f} % of the rigs, on average, have creep, an electrode's lag, a dead "
            "time, a slow sensor, drag or drift of the permittivity, which the specification does not have. The rig is "
            "recorded for 60 to 120 s under noise up to 0.8 to 4 Hz, identified and fitted; a way of design, an "
            "operating point and a closed-loop time of 0.05 to 1 s are drawn, the design is checked, and run on the "
            "rig.",
            f"Steps inside the band, of those passed: {in_words(inside(outcomes))}. Sound on the true rig, of those "
            f"passed: {in_words(passed)}. Not passed, of the unsound: {in_words(caught(outcomes))}. {missed} passed "
            f"designs did not keep their word in one way or the other; {cautious} that were not passed were sound, "
            f"which is the price of caution; {nothing} recordings gave no model. Bounds are exact and one-sided "
            "(Clopper and Pearson).",
            "A run leaves the band if a single sample does. Few trials prove little: the bounds say how little.",
        ],
    )


def _models(matters: Matters) -> Note:
    made = promises(matters)
    count = kept(made)
    by = ", ".join(f"{q.name} {_counted(p for p in made if p.quantity is q)}" for q in QUANTITIES)
    physics = _counted(p for p in made if p.model == "calibrated plant")
    errors = {p.model: p.achieved for p in made if p.quantity.key == "rms"}
    reached = ", ".join(f"{name} {error:.3g} µm" for name, error in errors.items())
    return Note(
        title="Does the model matter?",
        paragraphs=[
            f"One design rule, and the error that its steps reach on the true plant: {reached}.",
            f"{count.hits} of {count.count} numbers came out inside their predicted 95 % intervals ({by}); of the "
            f"calibrated plant's {physics}. Nothing is demanded here, and the intervals are not good.",
            "The actuator has hysteresis, which is in none of the NARX models. Their intervals hold what the "
            "parameters leave open, not that the form is wrong. Overshoot and error are promised with what the free "
            "run left of the recording as a random wander on top; on the plant that is hysteresis, which the "
            "controller mostly removes, and the promise is far too cautious.",
            "Bandwidth and gain margin are promised by the identified model, and achieved by the true plant's own "
            "linearised loop, for small motions and, where something sticks, for large ones. "
            "With hysteresis the gain grows with the motion: the calibrated plant "
            "knows it, "
            "and yet what it says of small motions is not what large ones do. The check therefore judges physics "
            "plants for small and for large motions.",
        ],
    )


def _counted(made: Iterable[Promise]) -> str:
    rate = kept(tuple(made))
    return f"{rate.hits} of {rate.count}"


def _limits() -> Note:
    return Note(
        title="What this cannot show",
        paragraphs=[
            "All true rigs are simulations of one family of plants, and the plant that is fitted to a recording, in "
            f"{', '.join(name.replace('_', ' ').replace('.', ' ') for name in CALIBRATED)}, is the specification that "
            "they are fabricated beside: kinder than a real actuator, whose physics nobody wrote down. What is "
            "concealed in the trials comes from the same catalogue, one effect at a time, at sizes of our choice.",
            "Check and truth try the same references, so that nothing is said of others, of years of use, or of "
            "actuators that break. Of its runs on the fitted plant the check keeps "
            f"{100 * Specification().reserve:.0f} % of the limits of overshoot, end, ripple and saturation in reserve, "
            "as that plant is not the actuator; on the true rig the limits are whole.",
        ],
    )
