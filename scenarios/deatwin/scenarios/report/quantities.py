"""Numbers with units as a person writes them."""

from __future__ import annotations

from deatwin.ident.mismatch.diagnosis import Interval
from deatwin.ident.mismatch.prefixes import prefixed

__all__ = ["quantity", "three_digits", "with_interval"]


def quantity(value: float, unit: str) -> str:
    """A value in SI with three digits and a prefix.

    Parameters
    ----------
    value : float
        SI.
    unit : str
        SI unit; ``"1"`` is a pure number.

    Returns
    -------
    str

    Examples
    --------
    >>> quantity(26400.0, "Pa"), quantity(0.05, "s"), quantity(-0.1, "1")
    ('26.4 kPa', '50 ms', '-0.1')
    """
    factor, shown = prefixed(value, unit)
    return f"{_digits(value / factor)} {shown}".rstrip()


def three_digits(value: float | None) -> str:
    """A number with three significant digits, or a dash for none.

    Parameters
    ----------
    value : float or None
        Any.

    Returns
    -------
    str

    Examples
    --------
    >>> three_digits(2.0), three_digits(128.4), three_digits(4321.0), three_digits(0.0123), three_digits(None)
    ('2.00', '128', '4321', '0.0123', '–')
    """
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def with_interval(value: float, low: float, high: float, unit: str) -> tuple[str, str]:
    """A value and its interval, in the same prefix.

    Parameters
    ----------
    value, low, high : float
        SI.
    unit : str
        SI unit.

    Returns
    -------
    tuple of str
        For example ``("54.1 s", "50.2 to 59.3 s")``.
    """
    shown = Interval(value=value, low=low, high=high, unit=unit).shown
    return (
        f"{_digits(shown['value'])} {shown['unit']}".rstrip(),
        f"{_digits(shown['low'])} to {_digits(shown['high'])} {shown['unit']}".rstrip(),
    )


def _digits(value: float) -> str:
    """Three significant digits, and no exponent for sizes that a person would write out."""
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
