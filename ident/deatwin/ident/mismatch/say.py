"""The conclusion in one plain sentence; the verdict decides which words are allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from deatwin.ident.mismatch.diagnosis import Cause, Interval, Verdict
from deatwin.plant.effects.catalogue import effect_named

__all__ = ["number", "sentence"]


def number(value: float) -> str:
    """A number as the sentence shows it: three significant digits, no exponent for everyday sizes.

    Parameters
    ----------
    value : float
        Any.

    Returns
    -------
    str

    Examples
    --------
    >>> number(55.812), number(0.0029), number(1234.5)
    ('55.8', '0.0029', '1230')
    """
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def sentence(
    verdict: Verdict,
    causes: Sequence[Cause],
    rivals: Sequence[str],
    fit: Mapping[str, Mapping[str, float | None]],
    noise: float,
    model_error: float,
    unit: str,
    findings: Sequence[str] = (),
) -> str:
    """Say the conclusion.

    Parameters
    ----------
    verdict : Verdict
        Licenses the words.
    causes : sequence of Cause
        What is built into the amended plant.
    rivals : sequence of str
        Effects that could be the explanation instead.
    fit : mapping
        As in the file.
    noise, model_error : float
        Of the sensor and of the plant's own equations, in `unit`.
    unit : str
        Of amplitudes.
    findings : sequence of str
        Faults of the recordings.

    Returns
    -------
    str
    """
    unit = "µm" if unit == "um" else unit
    residual = fit["fitted"]["before"]
    left = "" if residual is None else (
        f"a residual of {number(residual)} {unit} on the fitted data, with {number(noise)} {unit} of sensor noise"
    )  # fmt: skip
    within = f"within the plant's own model error of {number(model_error)} {unit}"
    if verdict is Verdict.NONE:
        return f"Nothing is missing {within}: the plant follows the recordings to {left}."
    if verdict is Verdict.PARAMETERS:
        return f"Nothing but other parameters is needed {within}: the calibrated plant leaves {left}."
    if verdict is Verdict.DATA_FAULT:
        return f"The recording is at fault: {'; '.join(findings)}."
    if verdict is Verdict.UNKNOWN:
        return (
            f"Something is missing that no effect of the catalogue explains: the calibrated plant leaves {left}."
        )
    if verdict not in (Verdict.NAMED, Verdict.AMBIGUOUS):
        return verdict.advice[0].upper() + verdict.advice[1:] + "."
    what = ", and ".join(_physics(cause) for cause in causes)
    what = what[0].upper() + what[1:]
    gain = _gain(fit, noise, unit)
    if verdict is Verdict.AMBIGUOUS:
        others = ", ".join(name for name in rivals if name not in {c.effect for c in causes})
        return (
            f"Something is missing, and these recordings cannot tell which: perhaps {_lower(what)}, "
            f"perhaps {others}; {gain}."
        )
    share = sum(cause.share_explained for cause in causes) if len(causes) == 1 else None
    explained = "" if share is None else f"it explains {100 * share:.0f} % of the mismatch, and "
    return f"{what}, which the model does not have; {explained}{gain}."


def _gain(fit: Mapping[str, Mapping[str, float | None]], noise: float, unit: str) -> str:
    before, after = fit["unseen"]["before"], fit["unseen"]["after"]
    if before is None or after is None:
        return f"with {number(noise)} {unit} of sensor noise"
    return (
        f"with it the error on unseen data falls from {number(before)} to {number(after)} {unit}, "
        f"with {number(noise)} {unit} of sensor noise"
    )


def _physics(cause: Cause) -> str:
    fields = {name: _with_interval(p) for name, p in cause.parameters.items()}
    return _lower(effect_named(cause.effect).wording.format(**fields))


def _with_interval(parameter: Interval) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{number(parameter.value)}{unit} ({number(parameter.low)} to {number(parameter.high)})"


def _lower(text: str) -> str:
    return text[0].lower() + text[1:]
