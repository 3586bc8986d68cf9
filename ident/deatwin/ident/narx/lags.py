"""Read lags of candidate terms, which are given for all channels of a kind or for each separately."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from deatwin.plant.errors import ModelError, nearest

ChannelLags = int | Sequence[int]  # A number n for the lags 1..n, or the lags themselves, in samples
Lags = ChannelLags | Sequence[ChannelLags] | Mapping[str, ChannelLags]
"""Lags of all channels of a kind, or of each channel, in order or by name."""

_KINDS = {"u": "input", "y": "output"}


def lag_list(lags: ChannelLags, *, smallest: int) -> tuple[int, ...]:
    """Return lags in samples as an increasing tuple; a number n stands for 1..n, 0 for none."""
    if not isinstance(lags, int | np.integer | Iterable):
        raise ModelError(f"lags = {lags!r}; give a number n >= 0 for 1..n, or a sequence of lags")
    wanted = range(1, lags + 1) if isinstance(lags, int | np.integer) else lags
    if isinstance(lags, int | np.integer) and lags < 0:
        raise ModelError(f"lags = {lags}; give a number n >= 0 for 1..n, or a sequence of lags")
    if any(not isinstance(lag, int | np.integer) or lag < smallest for lag in wanted):
        raise ModelError(f"lags {list(wanted)!r} must be integers of at least {smallest}")
    return tuple(sorted({int(lag) for lag in wanted}))


def channel_lags(lags: Lags, kind: str, count: int, names: Sequence[str] = ()) -> tuple[tuple[int, ...], ...]:
    """Return the lags of each channel as an increasing tuple."""
    smallest = 1 if kind == "y" else 0
    if isinstance(lags, Mapping):
        values = _by_name(lags, kind, count, names)
    elif _is_nested(lags):
        values = list(lags)  # type: ignore[arg-type]
    else:
        return (lag_list(lags, smallest=smallest),) * count  # type: ignore[arg-type]
    if len(values) != count:
        raise ModelError(f"{_KINDS[kind]}_lags hold the lags of {len(values)} {_KINDS[kind]}s; there are {count}")
    return tuple(lag_list(value, smallest=smallest) for value in values)


def lags_anywhere(lags: Lags) -> tuple[int, ...]:
    """Return the lags of all channels in one list, with repetitions."""
    if isinstance(lags, Mapping) or _is_nested(lags):
        values: Iterable[Any] = lags.values() if isinstance(lags, Mapping) else lags  # type: ignore[assignment]
        return tuple(lag for value in values for lag in lag_list(value, smallest=0))
    return lag_list(lags, smallest=0)  # type: ignore[arg-type]


def _is_nested(lags: Any) -> bool:
    return isinstance(lags, Iterable) and any(isinstance(one, Iterable) and not isinstance(one, str) for one in lags)


def _by_name(lags: Mapping[str, ChannelLags], kind: str, count: int, names: Sequence[str]) -> list[ChannelLags]:
    side = _KINDS[kind]
    placed = [f"{kind}{row + 1}" for row in range(count)] if count > 1 else [kind] * count
    known = list(names) or placed
    row_of = dict(zip(placed, range(count), strict=True)) | dict(zip(known, range(count), strict=True))
    found: dict[int, ChannelLags] = {}
    for name, value in lags.items():
        if name not in row_of:
            raise ModelError(
                f"{side}_lags name {name!r}{nearest(str(name), known)}; the {side}s are {', '.join(known) or 'none'}"
            )
        if row_of[name] in found:
            raise ModelError(f"{side}_lags name the {side} {known[row_of[name]]} twice, the second time as {name!r}")
        found[row_of[name]] = value
    left = [known[row] for row in range(count) if row not in found]
    if left:
        raise ModelError(f"{side}_lags leave out {', '.join(left)}; give [] for what has no lags")
    return [found[row] for row in range(count)]
