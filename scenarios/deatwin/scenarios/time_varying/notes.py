"""What the page says in words: what is known of the thesis' figures, and how the numbers are to be read."""

from __future__ import annotations

from deatwin.ident.narx.wander import BLOCK, CONSTANT, LIKELIEST, REFINED, SHARES, VARYING
from deatwin.scenarios.time_varying.benchmark import Benchmark
from deatwin.scenarios.time_varying.study import FACTOR, STRUCTURE, Study
from deatwin.scenarios.time_varying.verdicts import CHANCE, DRIFTING, HELD
from deatwin.studies.report.story import Note


def notes(study: Study) -> list[Note]:
    """Write the notes."""
    return [_words(), _figures(), _wander(study), _structure(study), _reading(study)]


def _words() -> Note:
    return Note(
        title="What the letters mean",
        paragraphs=[
            "Order n of an output is of n-th power in the input. Hₙ is its generalised frequency response function "
            "(GFRF), a function of n frequencies; H₁ is the ordinary frequency response. Gₙ, the nonlinear output "
            "frequency response function (NOFRF), is the spectrum of order n of the output over Uₙ, that of the n-th "
            "power of the input. TV stands before what varies with time: the response of the parameters of each "
            "instant, as if they stayed (frozen time).",
            "A free run is a simulation from the commands alone. Errors are root mean squares; those of actuators are "
            "over the standard deviation of the reading.",
        ],
    )


def _figures() -> Note:
    return Note(
        title="Figures 5.1 to 5.10 of the thesis",
        paragraphs=[
            "Of chapter 5 only this could be read: mean and gain in sliding windows come first (section 5.2.1, figure "
            "5.5); a Kalman smoother then gives the parameters of a NARX model along time, the DC component is removed "
            "at each instant, and the recursion gives time-varying responses of every order (Algorithm 5.1); appendix "
            "C shows the parameters and the equilibrium. What the other nine figures show could not be found. So this "
            "page follows the method: systems whose parameters are known first, then the actuators, with each step "
            "drawn. Numbers of single figures are not claimed, but for 5.5."
        ],
    )


def _wander(study: Study) -> Note:
    tracks = [one.track for one in study.driven]
    likeliest, constant, varying, refined = (
        [100 * track.unseen[way] for track in tracks] for way in (LIKELIEST, CONSTANT, VARYING, REFINED)
    )
    losing = [t.name for t in tracks if t.unseen[VARYING] >= t.unseen[REFINED]]
    told = (
        f" For {_listed(losing)} constant parameters of least free-run error do as well or better on the blocks left "
        "out: "
        "varying parameters cost some accuracy where nothing drifts any more, as after the shift of the sixth at 45 s."
        if losing
        else ""
    )
    return Note(
        title="How far the parameters may wander",
        paragraphs=[
            "A smoother's parameters reproduce the record that they were fitted to: with variances by maximum "
            f"likelihood the free run misses it by {100 * max(t.seen[LIKELIEST] for t in tracks):.1g} % of its "
            "deviation at most. They follow hysteresis, the polynomial's misfit and the sensor's noise; on blocks that "
            f"were left out they miss by {_span(likeliest)} %, constant parameters by {_span(constant)} %.",
            f"So the record is cut into blocks of {BLOCK:.0f} s. Of every four one serves for choosing how far the "
            "contribution of each term may wander over the record, by free-run error, and another one for judging; "
            f"what is chosen misses the latter by {_span(varying)} % (constant parameters of least free-run error: "
            f"{_span(refined)} %).{told} Blocks left out lie between others that are known; the errors on blocks ahead "
            "use nothing of the future but the chosen share.",
        ],
    )


def _structure(study: Study) -> Note:
    worst = max(one.series_error for one in study.driven)
    return Note(
        title="Why this structure",
        paragraphs=[
            f"All six have the same {len(STRUCTURE)} terms: y(k−1), a constant, and every product of u(k) and u(k−1) "
            f"up to the fifth degree, at {0.02 * FACTOR:.2f} s. The past output stands alone, so that the series of "
            f"orders ends with the fifth, and the sum of Gₙ Uₙ is the whole output (to {worst:.0e} of it). Products of "
            "the output with powers of the command, as the other structure of the story `frequency-analysis` has them, "
            "fit a little better and make a series without end, which does not converge under the thesis' noise: "
            "single orders are defined there, their sum is not the output. With the output alone an equilibrium that "
            "moves is seen in the mean only: what changes the orders of these models are their parameters. The "
            "quadratic system below shows the other case."
        ],
    )


def _reading(study: Study) -> Note:
    shares = {one.name: one.track.share for one in study.driven}
    least = f" ({SHARES[0]:g} is the least that was tried)" if SHARES[0] in shares.values() else ""
    unsure = [one.name for one in study.driven if one.name in DRIFTING and one.chance >= CHANCE]
    missed = _listed(unsure)
    return Note(
        title="How to read the maps and the spectra",
        paragraphs=[
            "The maps are of parameters smoothed over the whole record; they say what the record says, not what could "
            "have been known at the time. A term may wander by a share of the reading's deviation; chosen are "
            f"{', '.join(f'{share:g} for {name}' for name, share in shares.items())}{least}. A walk of one pace smears "
            "a jump: the shift of the sixth at 45 s becomes a slope.",
            "Mean and gain in sliding windows need no model, and are blunt: the mean of 100 s of the thesis' noise "
            "wanders of itself, and through a steep curve the gain does too. "
            f"{f'They do not tell the drift of {missed} from chance; the parameters follow it. ' if missed else ''}"
            "A single realisation of known parameters is a small sample of their bands: its errors are alike over long "
            f"stretches.{_short(study.benchmark)} The figure of the coverage is of many.",
            "The predicted spectrum takes the command of a window for one period. Both it and the recording are seen "
            "through a Hann window, so that the seam of the period is out of sight and leakage is the same on both "
            "sides. The windows that are judged were left out of the fit. Above 2 Hz the output is small, and "
            "hysteresis and the sensor have their share in it.",
        ],
    )


def _short(benchmark: Benchmark) -> str:
    """Which bands of known parameters hold the truth too seldom."""
    seldom = [
        f"{'the constant' if str(term) == '1' else term} of “{one.name}” ({100 * share:.1f} %)"
        for one in benchmark.followed
        for term, share in zip(one.trajectory.terms, one.covered, strict=True)
        if share < HELD
    ]
    return f" So the measure of {100 * HELD:.0f} % is missed by the band of {_listed(seldom)}." if seldom else ""


def _listed(texts: list[str]) -> str:
    return " and ".join([*filter(None, [", ".join(texts[:-1])]), *texts[-1:]])


def _span(percent: list[float]) -> str:
    return f"{min(percent):.1f} to {max(percent):.1f}"
