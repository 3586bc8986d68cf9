"""What the page says in words."""

from __future__ import annotations

import numpy as np

from deatwin.ident.narx.fleet.alike import OPERATING_INPUT
from deatwin.scenarios.frequency_analysis.actuators import ORDERS, Actuators
from deatwin.scenarios.frequency_analysis.anchor import LARGE, SMALL, Anchor
from deatwin.scenarios.frequency_analysis.verdicts import HALF, HIGH, LOW, spread
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import Note


def notes(fleet: Actuators, truth: Anchor) -> list[Note]:
    """Write the notes."""
    return [_words(), _thesis(), _structure(fleet), _apart(fleet), _belief(fleet, truth), _signal(fleet)]


def _words() -> Note:
    return Note(
        title="What the letters mean",
        paragraphs=[
            "The output of a weakly nonlinear system is a sum of orders: order n is of n-th power in the input. Hₙ is "
            "its generalised frequency response function (GFRF), a function of n frequencies; H₁ is the ordinary "
            "frequency response. Yₙ is the spectrum of order n of the output, Uₙ that of the n-th power of the input, "
            "and Gₙ their ratio, the nonlinear output frequency response function (NOFRF). It depends on the input.",
            "y₁ and u₂ in an equation are the output one sample ago and the input two samples ago. S1 is "
            "linear, S2 has powers of the input, the quadratic system and the Duffing oscillator have powers of the "
            "output. SEMP searches term by term for the model of least free-run error; SVB is sparse variational "
            "Bayes, which gives the parameters with their covariance.",
        ],
    )


def _thesis() -> Note:
    return Note(
        title="Which figures of the thesis these are",
        paragraphs=[
            "Of figures 4.10 and 4.11 captions and the text beside them could be read, and of table 4.3 the caption. "
            "Of figure 4.12 only that it holds the NOFRFs of the six. What is asked of them is what the text claims: "
            "first-order responses that are alike at low frequencies and differ at high ones, a ridge of the second "
            "order where f₁ + f₂ = 0, a random record that is not fit for NOFRFs.",
            "Figures 4.2, 4.4, 4.5, 6.10 and 6.13 could not be seen. In their place stand what their sections are "
            "about: output ranges, frequency responses and NOFRFs of systems whose equations are known, and orders of "
            "an output with the uncertainty of an SVB model, of a benchmark system and of an actuator.",
        ],
    )


def _structure(fleet: Actuators) -> Note:
    one, rival = fleet.fleet, fleet.rival
    step = one.actuators[0].model.sample_time
    fits = [alike.fit_percent for alike in one.actuators]
    last = 100 * rival.left[:, -1]
    return Note(
        title="One structure for all, whose series ends",
        paragraphs=[
            f"Searches by SEMP on the actuators pass through {one.tried} structures. With each, all models are fitted "
            "to the beginnings of the training sections; the one is taken whose free runs follow their ends best: "
            f"{len(one.structure)} terms at {quantity(step, 's')}. Over the held-out sections the models fit "
            f"{min(fits):.1f} to {max(fits):.1f} %. Their covariance is the one that holds for coloured residuals. All "
            f"responses are about {OPERATING_INPUT:g} V, the mean of the noise; only the removal of the DC component "
            "is shown at the mean of each actuator's own training commands.",
            "The candidates hold the past output by itself only. With products of output and command the best common "
            f"structure has {len(rival.models[0].terms)} terms and fits {rival.fits.min():.1f} to "
            f"{rival.fits.max():.1f} %. But its Volterra series diverges at the size of the noise: the first "
            f"{rival.left.shape[1]} orders leave {last.min():.0f} to {last.max():.0f} % of the settled free run. No "
            "sum of GₙUₙ says what such a model does there. Whether the series of the thesis' models converge could "
            "not be read.",
        ],
    )


def _apart(fleet: Actuators) -> Note:
    """Why the six are, or are not, alike where the thesis' actuators were."""
    low, high = spread(fleet.each, LOW), spread(fleet.each, HIGH)
    rests = np.array([1e3 * one.first.point.output for one in fleet.each])
    far, gains = int(rests.argmax()), np.array([one.first.gain for one in fleet.each])
    most = ", and its gain is the largest at all frequencies" if np.all(gains[far] >= gains) else ""
    verdict = "They are not alike there" if low > HALF * high else "They are alike there by the measure above"
    return Note(
        title="Are the six alike at low frequencies?",
        paragraphs=[
            f"The largest |H₁| is {100 * low:.0f} % above the smallest at {LOW:g} Hz, and {100 * high:.0f} % at "
            f"{HIGH:g} Hz. {verdict}. The six differ in size first: under {OPERATING_INPUT:g} V they rest at "
            f"{rests.min():.3f} to {rests.max():.3f} mm, {fleet.each[far].name} furthest out{most}. What made the "
            "thesis' six alike at low frequencies could not be read."
        ],
    )


def _belief(fleet: Actuators, truth: Anchor) -> Note:
    film, small, large = (1e6 * np.abs(values) for values in (truth.film, truth.small, truth.large))
    low, high = truth.frequency_Hz[0], truth.frequency_Hz[-1]
    model = 1e6 * truth.recorded.gain
    place = next(i for i, one in enumerate(fleet.each) if one.name == fleet.sampled.name)
    common, rival = fleet.each[place].first, fleet.rival.first[place]
    return Note(
        title="What a first-order response of an actuator is worth",
        paragraphs=[
            "The fleet is simulated, so it can be asked. "
            f"The bare film of {truth.name} answers {film[0]:.0f} µm/V at {low:g} Hz and {film[-1]:.0f} µm/V at "
            f"{high:g} Hz: it hardly lags. With hysteresis the answer to tones of {1e3 * SMALL:.0f} mV is "
            f"{small[0]:.0f} and {small[-1]:.0f} µm/V, to tones of {1e3 * LARGE:.0f} mV {large[0]:.0f} and "
            f"{large[-1]:.0f} µm/V. The model of the actuator has {model[0]:.0f} and {model[-1]:.0f} µm/V. So the fall "
            "of the gain with frequency is friction, which depends on the size of the motion and not on its rate; a "
            "polynomial of a few past values can only express it as a lag.",
            "The bands are those of the parameters, the structure being given. The structure with products has "
            f"|H₁| = {1e6 * rival.gain[0]:.0f} µm/V at 0.01 Hz for {fleet.sampled.name}, where the one of this page "
            f"has {1e6 * common.gain[0]:.0f} µm/V ± {1.96e6 * common.gain_deviation[0]:.0f} (95 %), and neither holds "
            "what friction does. So a difference between actuators that is significant within one structure is one of "
            "behaviour under this noise, not of a physical constant.",
            "Beyond 1 Hz nothing was excited. What the responses do there is the structure's extrapolation.",
        ],
    )


def _signal(fleet: Actuators) -> Note:
    side = fleet.side
    cautions = "; ".join(f"{one.name}: {one.fitted.status.value}" for one in fleet.each if not one.fitted.status.ok)
    return Note(
        title="The test signal and its levels",
        paragraphs=[
            "The pulse is the periodic form of the thesis' equation 4.80, whose band is 0 to 1 Hz. Its lines are in "
            "phase, so Gₙ is a mean of Hₙ with positive weights. With a record of noise the weights have arbitrary "
            "phases. The least squares over levels are as exact as before; it is Gₙ itself that is no mean any more, "
            f"and another record gives another one. The package says of the record: {side.by_random.status.value}.",
            f"The largest level is {side.signal.amplitude:.2g} V, up to the end of the training commands, and "
            f"{fleet.each[0].fitted.highest} orders are fitted, as many as the models have; {ORDERS} are shown. The "
            f"crest factor is {side.signal.crest_factor:.1f}: such a signal has little power for its peak, which does "
            f"for models and not for experiments. {cautions or 'No status asks for caution.'}",
        ],
    )
