"""Split the header of a column into name and unit."""

import re
from collections.abc import Iterator, Sequence

from deatwin.plant.files.units import FULL_WIDTH, UNITS, find_unit, without_latex

LONGEST = 300
"""Number of characters beyond which a header is a text, not a name with a unit; searches in it would take seconds."""
_LOWERED = {name.lower() for name in UNITS}
_IN_BRACKETS = re.compile(r"(.+?)[\s/]*(\([^()]*\)|\[[^\[\]]*\])")
_REMARK = re.compile(
    r"(.+[)\]])\s*(\([^()\d]*\)|\[[^\[\]\d]*\]"
    r"|\((?:\w+/)?(?!(?i:gain|range|factor|scale|ratio|div|mult|times|bits?|exp))[^\W\d_]{2,}[ _#.-]{0,2}\d{1,2}\))"
)
"""Header with a remark behind the unit. With a digit, it may be a factor, unless it is a channel: ``HV (kV) (laser 1)``."""
_AMID = re.compile(r"([^()\[\]]+?)\s*(\([^()]*\)|\[[^\[\]]*\])\s+(?!per\b)([^\W_][^()\[\]/]*)")
"""Header with a unit in brackets before its last words: ``HV (kV) monitor``."""
_TAIL = re.compile(r"([^()\[\]]+?)\s*(\([^()]*\)|\[[^\[\]]*\])((?!:\s?10)[_.#:/]\s*[^()\[\]]+|\d+|\*+)")
"""Header with a unit in brackets before a mark: ``HV (kV).1``, as pandas numbers equal names, or ``HV[kV]/Value``."""
_QUOTIENT = re.compile(r"(.+?)_([^\W_]+)_(per_)?([^\W\d_][^\W_]*)")
_LAST_PART = re.compile(r"(.+?)\s*_((?:[^_()\[\]]|\([^()]*\)|\[[^\[\]]*\])+)")
_IN_WORDS = re.compile(r"(.+?)(?:\s+(?:in|en)\s+|\s*,\s*)(\S.*)")
_DIVIDED = re.compile(r"([^\W\d]\w*|<[^\W\d]\w*>|\|[^\W\d]\w*\|)\s*/\s*(\([^()]*\)|\[[^\[\]]*\]|[^\s/]+)")
_FORMS = (_IN_BRACKETS, _LAST_PART, _IN_WORDS, _DIVIDED)
"""Patterns of a header with a unit; the second group is the unit."""
_TIMES = re.compile(
    r"((?:(?:.*[^a-z])?t|.*(?:time|stamp|epoch|clock|zeit|unix|elapsed|ticks?)))[\s_.:-]*?"
    r"(?:(?<![a-z0-9])(s|h|min)|(hours?|hrs?|stunden|minut(?:es?|en)|days?|millis|micros|nanos|[mun]?sec(?:ond)?s?|(?:milli|micro|nano)seconds?|[mun]s))",
    re.IGNORECASE,
)
"""Header of a time column that ends in its unit without a separator."""
_TIME_WORD = re.compile(r"millis|micros|nanos|[mun]s|[mun]?secs?|(?:milli|micro|nano)?seconds?", re.IGNORECASE)
"""Header that is only a unit of time. s, min and h are excluded: alone they may mean distance, minimum and height."""
_UNIT_ALONE = re.compile(r"(?:in\s+)?(\(.*\)|\[.*\]|(?<=\s)\S+)")
"""Header without a name, of which brackets or the word *in* say that it is a unit: ``[s]``, ``in s``."""
_OTHER_BRACKETS = re.compile(r"(.*\S)\s*(?:\{([^{}]+)\}|<([^<>]+)>)")
_CHANNEL = r"[^\W\d](?:\S*[^\s\d])?(?:(?<=[^\W\d_])(?<![/:.\d][xX])\d+)?"
"""Word that may end in the number of a channel, as ``U2``; *_10* and *=10* may belong to the unit, and *:x10* is a factor."""
_NO_WORD = (
    r"(?!pm)[munpkMGcµμ](?:m|V|A|N|Pa|Hz|F|W|J|[Oo]hm|Ω|bar|g)|Hz|rpm|psi|[°º][CF]|℃|%"
    r"|(?:мк|[пнмскМГ])(?:м|В|А|Н|Па|Гц|Ом|Ф|г)"
)
"""Units that are no words and no endings of names, as ``V`` is in *Phase V*."""
SURE = re.compile(r"(?!pm)[munpkµμ](?:m|V|A|N|Pa|Hz|[Oo]hm|Ω|bar|g)|cm|Hz|rpm|[°º]C|℃")
"""Units that stand for themselves where they are a whole header or a whole part of one: MV may be a measured value, and
psi an angle."""
_PLURAL = re.compile(
    r"((?:\S+\s+)?(?!(?:in|at|of|to|per|and|zero|the)\s)\S+)\s+(?!(?i:turns|.*(?:second|minute|hour|day|bar)s)$)([^\W\d_]{4,}s)"
)
"""Header of few words that ends in a unit in words: ``Voltage kilovolts``."""
_OTHER_QUANTITY = frozenset(
    "per pro mon monitor rate speed velocity vel dot accel squared sq count counts pp p2p".split()
)
"""Words beside a unit in a header that make it another unit: ``mm_rate`` is no length."""
_GLUED = re.compile(rf"((?i:ch|chan|channel)[ _]?\d{{1,2}})({_NO_WORD}|V|A)")  # CH1mV, as oscilloscopes write it
_ELEMENT = re.compile(r"(.+?)(\((?::,\d+|\d+,:)\))")  # Column or row of a matrix of MATLAB: y_mm(:,2)
_MULTIPLE = re.compile(r"\d[\d.,]*\s*(\D.*)")  # Several of a unit: 1000 V
_PEAK = re.compile(rf"(?:{_NO_WORD}|V|A)(?:pp|pk|p|ss|rms|RMS|eff)")
"""Unit of an amplitude, which is no unit of a sample."""
_APART = re.compile(rf"((?:.*\s)?{_CHANNEL})(?:\s+|\s*[-–@.|:]\s*)({_NO_WORD})")
"""Header with a unit behind a blank or another mark."""
_BEFORE = re.compile(r"(\[[^\[\]]*\]|\([^()]{2,}\))\s*([^\W\d_][^()\[\]]*)")
"""Header with a unit in brackets before the name: ``[kV] HV``; *(A)* and *(B)* may only tell two names apart."""
_FIRST = re.compile(rf"({_NO_WORD})\s+((?!mon|per\b|pro\b)[^\W\d_].*)")
"""Header that begins with a unit, as ``kV set``; what stands for a kV at a monitor is another matter."""
_MANGLED = re.compile(r"(.*[^\W_])(?:\.{1,2}([^\W_.]+)\.|_([^\W_]+)_)")
"""Header whose brackets a program has replaced: ``U..kV.`` by R, ``U_kV_`` by MATLAB."""
_DOUBTFUL = re.compile("F|l|(?i:in|ft|foot|feet|yd|dm|kp|dyn|kip|ksi|turns?)")
"""Units recognised in brackets only, because names have these endings, too: of forces and lengths, ``u_in``, ``kp``."""
_MINIMUM = re.compile(r"(?<![^\W_])min(?![^\W_])")
_OF_NODE = re.compile(r"(?:[vV]\((?![mnuk]?V\))|[iI]\((?![mnpuk]?A\)))\w+\)")
"""Voltage of a node or current of a part, as circuit simulators name them: ``V(in)`` is in no inches."""
_TEN_TO = r"1[eE][-+]?\d+|10\s?(?:\^|\*\*)\s?\(?[-+]?\d+\)?|10[⁺⁻]?[⁰¹²³⁴-⁹]+"
_POWER = rf"(?:{_TEN_TO}|10+(?![\d.]))"
_FACTOR = re.compile(
    "|".join(
        (
            rf"(?<=[\s_()\[\]])[xX]\s?(?:{_POWER}|\d{{3,}})",  # HV x1000, HV (x10)
            r"(?<=[A-Z])x10{2,}(?!\d)",  # HVx100, unlike max100 and index100
            rf"(?<=.)[×*·⋅]\s?(?:{_TEN_TO})",  # U2 · 10^3
            r"(?<!\d)(?<!\d\s)[×*·⋅]\s?\d[\d.]*",  # U*2.5
            rf"(?<![\w.]){_POWER}\s?[×*·⋅](?!\s?\d)",  # 1000*U
            r"(?<![\w.])10+[xX×](?!\w)",  # 100x
            r"(?<![\d.:/])1\s?[:/]\s?10+(?!\d|[:/]\d|\s?(?:Hz|s)\b)",  # 1:1000 and 1/100, unlike dates and 1/10 s
            r"(?<![\d:])10+\s?:\s?1(?!\d|:\d)",  # 1000:1, unlike times of day
            rf"(?:(?<=[^\d\s])|(?<=[^\W\d_]\d))\s?/\s?{_POWER}",  # U/100, U2/100
            r"÷\s?\d[\d.]*",
            r"(?i:(?<![^\W_])(?<!/)div(?:ided)?(?:[ _]?by)?[ _]?\d+)",  # x_mm_div10
            r"(?i:(?<![^\W_])(?:gain|factor|ratio|divider)[\s=:_,;]*\d{2}[\d.]*)",  # HV (V) gain 1000
        )
    )
)
"""Factor in the name of a column, of which nobody knows whether it was applied: ``HV x1000``, ``U/100``, ``1:1000``."""
_BEHIND = re.compile(r"[)\]][^()\[\]]*$")
_RATIO = re.compile(r"(?<![\d.])\d[\d.]*\s?([^\W\d_]+)\s?(/|=|≙|→|->|\bper\b|\bpro\b)\s?(?:\d[\d.]*\s?)?([^\W\d_]+)")
_SCALING = re.compile(
    r"(?i)gain|scal|skal|divid|teiler|multipl|monitor|verst|attenuat|volt|spannung"
    r"|(?<![^\W_])(?:ampl?|amplifier|factor|faktor|HV)(?![^\W_])"
)
"""Words of a remark in which a factor is one of signals, and not of a mixture, a lens or the first of ten runs."""
_OF_FIELD = re.compile(
    r"(?i:field|feld|champ|campo|strength|festigkeit|gradient|breakdown|durchschlag)|(?<![^\W_])E(?![^\W_])"
)
"""Words before a field, whose unit may also be that of a sensor: ``field 50 V/mm``."""
_SUPPLY = frozenset(UNITS[unit].si for unit in ("V", "A", "Hz", "F", "W", "ohm"))
"""Units in the ratings of a supply or a part: ``24 V / 5 A``."""
TIME_NAMES = ("time", "t", "zeit", "uhrzeit", "temps", "heure", "hora", "tiempo", "时间")
_LIKE_TIME = re.compile("(?i)time|stamp|clock|zeit|elapsed|temps|tiempo")
_SYMBOLS_OF = {"s": "m", "h": "m", "l": "m", "m": "kg", "F": "N", "T": "K", "C": "F", "W": "J"}
"""Symbols of quantities that are units, too, and the unit of the quantity: ``s/mm`` is a way, as ISO 80000 writes it."""
_NO_QUANTITIES = frozenset({"counts"})  # Words before a slash that belong to an unknown unit, as in ``counts/s``
_DIFFERENCE = re.compile(r"(?i:[Δ∆]|delta|diff(?!us)|d_?t(?![a-z])|(.*[^a-z]|temp)?(difference|rise|increase)\b)")
_LAST_WORD = (
    r"(?![^\W\d_])(?=[\W_]*(\d+|max|min|mean|rms)?$|[\W_]+(in|of|from|to|between|above|below|across|over)(?![a-z]))"
)
_CHANGE = re.compile(
    r"(?i:(.*[^a-z]|.*temp|.*temperature?|t)??(diff|delta|differenz|change|error|err|deviation|dev|rise|increase|decrease|"
    rf"drop|drift|offset|excess|over[ _-]?temp(erature)?|übertemperatur|abweichung){_LAST_WORD}"
    r"|.*(superheat|sub-?cool|subcooling|undercooling|supercooling)(?![a-z])(?!.*temp)|excess[ _]temp"
    r"|d[ _]?temp)|.*[a-z](Diff|Delta|Error|Change|Rise|Drop)(?![a-z])"
)
"""Name of a temperature with a word that makes it a difference. The word must end the name or precede a preposition,
unlike in *phase change material*."""
_ONE_TEMPERATURE = r"(?:[Tt](?:emp(?:erature)?)?(?:[_ ]?\d\w*|_\w+)|[Tϑθ](?:[a-z]{1,4})?)"
_MINUS = re.compile(
    rf"\(?(?:(?!T\s*[-−–]){_ONE_TEMPERATURE}\s*(?:[-−–]|minus)\s*{_ONE_TEMPERATURE}"
    r"|T\s*(?:[-−–]|minus)\s*T(?:_?(?:\d\w*|amb|ref|inf|env|set|sp|air)|_\w+))\)?"
)
"""Difference of two temperatures; ``T-Tank`` is the temperature of the tank."""
_CERTAIN_TEMPERATURE = re.compile(r"(?i:.*(temp|therm))")
_CHARGE = re.compile(r"(?i:.*(charge|coulomb|electric|ladung)|((delta|[dΔ∆])[_ ]?)?q(?![a-z]))")
_TEMPERATURE = re.compile(
    r"(?i:.*(?<![a-z])(film|air|ambient|room|oven|water|oil|coolant|dew ?point)(?![a-z])|[tϑθ](?![a-z]))|T[a-z]{1,4}\b"
)
_ACCELERATION = re.compile(r"(?i:.*acc(?![a-z])|.*accel|a(_?[xyz])?$)")


def split_unit(header: str) -> tuple[str, str]:
    """Return name and unit of a column header; the unit is empty if it is unknown or may belong to the name.

    It is unknown beside a factor: readings of ``HV x1000 (V)`` may be those of the monitor, or of the high voltage.

    >>> split_unit("HV (kV)"), split_unit("HV x1000 (V)")
    (('HV', 'kV'), ('HV x1000', ''))
    """
    if len(header) > LONGEST:
        return header, ""
    name, unit = _split(header)
    return name, "" if _factor(name, header) else unit


def split_units(headers: Sequence[str]) -> list[tuple[str, str]]:
    """Return names and units of the headers of a table; beside a maximum, ``min`` is no minute.

    >>> split_units(["x_mm_min", "x_mm_max"]), split_units(["v_mm_min"])
    ([('x_min', 'mm'), ('x_max', 'mm')], [('v', 'mm/min')])
    >>> split_units(["F min (N)", "F max (N)"])
    [('F min', 'N'), ('F max', 'N')]
    """
    above = {header: _MINIMUM.sub("max", header) for header in headers}
    split = {header: split_unit(header) for header in headers}
    found = []
    for header in headers:
        name, unit = split.get(above[header], split[header])
        if unit != split[header][1]:  # of the maximum, where the minimum seems to be in minutes
            found.append(("min".join(name.rsplit("max", 1)), unit) if unit else (header, ""))
        else:
            found.append(split[header])
    return found


def _factor(name: str, header: str) -> str:
    """Return the factor in the name of a column, or the scale of its monitor, such as ``1 V = 1 kV``; else an empty text."""
    name = header if name.endswith("per") else name  # what seems to be the unit ends a scale, as in 1kV_per_V
    whole = header.translate(FULL_WIDTH)
    behind = _BEHIND.search(whole)
    for text in (name, behind[0] if behind else ""):
        for match in _FACTOR.finditer(text):
            if match[0] in whole:  # unlike x 10 in the name of pos_x (mm) 10
                return match[0].strip(" _")
    return next((match[0] for match in _ratios(name)), "")


def _ratios(text: str) -> Iterator[re.Match[str]]:
    """Yield the ratios of units in a text that may be scales: of a voltage or a current, and of no field or rate."""
    for match in _RATIO.finditer(text.replace("_", " ")):
        above, below = (UNITS[find_unit(part)].si for part in (match[1], match[3]))
        electric = ("V", "A")
        field = match[1] in ("kV", "MV") or f"{match[1]}/{find_unit(match[3])}" == "V/um"
        if above and below and below != "s" and (below in electric or (above in electric and not field)):
            yield match


def scale_in(remark: str) -> str:
    """Return a scale or a factor in a remark above the samples; else an empty text.

    >>> scale_in("# 1 V = 10 kV (Trek)"), scale_in("# gain 2000"), scale_in("# v = 10 mm/s, 12:00:00, C:/a/100.csv")
    ('1 V = 10 kV', 'gain 2000', '')
    >>> scale_in("# Sylgard 184, 10:1"), scale_in("# 10 kV / 10 mA"), scale_in("# laser: 10 mm / 10 V")
    ('', '', '10 mm / 10 V')
    >>> scale_in("# field 50 V/mm"), scale_in("# field 2 V/mm, sensor 0.5 V/mm")
    ('', '0.5 V/mm')
    """
    for ratio in _ratios(remark):
        below = re.search(r"/\s?(\d[\d.]*)", ratio[0])
        units = {UNITS[find_unit(ratio[k])].si for k in (1, 3)}
        rated = below and below[1] != "1" and len(units) > 1 and units <= _SUPPLY
        field = units == {"V", "m"} and _OF_FIELD.search(re.split("[,;]", remark[: ratio.start()])[-1])
        if not rated and not field:
            return ratio[0]
    found = _factor("", f"){remark}") if _SCALING.search(remark) else ""
    return "" if found.startswith("/") else found


def _split(header: str) -> tuple[str, str]:
    """Return name and unit of a column header, whatever else its name says."""
    header = without_latex(header).translate(FULL_WIDTH)
    if match := _ELEMENT.fullmatch(header):
        name, unit = _split(match[1])
        return f"{name}{match[2]}", unit
    if (match := _OTHER_BRACKETS.fullmatch(header)) and find_unit(said := match[2] or match[3]):
        header = f"{match[1]} [{said}]"
    if _OF_NODE.fullmatch(header):
        return header, ""
    match = _QUOTIENT.fullmatch(header)
    doubtful = match and not match[3] and any(map(_DOUBTFUL.fullmatch, (match[2], match[4])))
    if match and not doubtful and (unit := find_unit(f"{match[2]}/{match[4]}")):
        # N_m may mean N/m, a stiffness, or N m, a torque.
        either = not match[3] and find_unit(f"{match[2]} {match[4]}")
        return (header, "") if either else (match[1], unit)
    for form in _FORMS:
        match = form.fullmatch(header)
        if not match or _is_doubtful(form, match[1], match[2]):
            continue
        unit = find_unit(match[2])
        if unit and not (form is _DIVIDED and _is_rate(match[1], unit)):
            return match[1], for_name(match[1], unit)
    if (match := _APART.fullmatch(header)) and (unit := find_unit(match[2])):
        return match[1], for_name(match[1], unit)
    match = _BEFORE.fullmatch(header)
    if match and (unit := find_unit(match[1])) and not _DOUBTFUL.fullmatch(match[1][1:-1]):
        return match[2], for_name(match[2], unit)
    if (match := _FIRST.fullmatch(header)) and not _is_longer_unit(header):
        return match[2], for_name(match[2], find_unit(match[1]))
    for worded in (_PLURAL, _GLUED):
        if (match := worded.fullmatch(header)) and (unit := find_unit(match[2])):
            return match[1], for_name(match[1], unit)
    if (found := _among_parts(header))[1]:
        return found
    if match := _MANGLED.fullmatch(header):
        found = _split(f"{match[1]} ({match[2]})" if match[2] else f"{match[1]}_{match[3]}")
        if found[1]:
            return found
    if match := _TIMES.fullmatch(header):
        return match[1], find_unit((match[2] or match[3]).lower())
    if _TIME_WORD.fullmatch(header):
        return header, find_unit(header.lower())
    if (match := _UNIT_ALONE.fullmatch(header)) and (unit := find_unit(match[1])):
        return header, unit
    if (match := _REMARK.fullmatch(header)) and (found := split_unit(match[1]))[1]:
        return f"{found[0]} {match[2]}", found[1]
    if (match := _AMID.fullmatch(header)) and (found := split_unit(f"{match[1]} {match[2]}"))[1]:
        return f"{found[0]} {match[3]}", found[1]
    if (match := _TAIL.fullmatch(header)) and not find_unit(match[3].lstrip("_.#:/ ")) and not _OF_NODE.match(header):
        found = split_unit(f"{match[1]} {match[2]}")
        if found[1]:
            return f"{found[0]}{match[3]}", found[1]
    match = _IN_BRACKETS.fullmatch(header)
    return (match[1] if match and _unknown_unit(header) == match[2].strip("()[] ") else header), ""


def _among_parts(header: str) -> tuple[str, str]:
    """Return name and unit of a header in parts, of which one before the last is a unit: ``U_kV_set``.

    >>> _among_parts("U_kV_set"), _among_parts("kV_set"), _among_parts("x_10_mm_left"), _among_parts("mV_per_kV_1")
    (('U_set', 'kV'), ('set', 'kV'), ('x_10_mm_left', ''), ('mV_per_kV_1', ''))
    """
    parts = header.split("_") if re.fullmatch(r"[\w°]+", header) else []
    places = [k for k, part in enumerate(parts) if SURE.fullmatch(part)]
    if len(places) != 1 or not all(parts) or (place := places[0]) == len(parts) - 1:
        return header, ""
    before, after = parts[:place], parts[place + 1 :]
    other = _OTHER_QUANTITY.intersection(map(str.lower, parts)) or find_unit(after[0])
    if other or (before and before[-1].isdecimal()):  # a quotient, a scale, or a place such as x = 10 mm
        return header, ""
    name = "_".join([*before, *after])
    return name, for_name(name, find_unit(parts[place]))


def _is_doubtful(form: re.Pattern[str], name: str, unit: str) -> bool:
    """Return whether the end of a header may belong to the name, although it is a unit: ``x_min`` is a minimum."""
    other = form is _LAST_PART and unit in ("min", "h") and not _is_time(name)
    return other or (form is not _IN_BRACKETS and _DOUBTFUL.fullmatch(unit) is not None)


def _is_longer_unit(header: str) -> bool:
    """Return whether a header begins with two or more words that are one unit, such as ``mm Hg``."""
    words = header.split()
    return any(find_unit(" ".join(words[:count])) for count in range(2, len(words) + 1))


def _is_time(name: str) -> bool:
    """Return whether a name in front of a unit is that of a time."""
    return name.lower() in TIME_NAMES or _LIKE_TIME.search(name) is not None


def for_name(name: str, unit: str) -> str:
    """Return the unit that is meant behind a name, where the name decides between two.

    >>> for_name("temperature", "C"), for_name("temperature rise", "C"), for_name("charge", "C"), for_name("x", "C")
    ('°C', 'Δ°C', 'coulomb', 'C')
    >>> for_name("accel_x", "g"), for_name("mass", "g")
    ('gn', 'g')
    >>> for_name("Timestamp", "N s"), for_name("impulse", "N s")
    ('ns', 'N s')
    """
    if unit == "N s" and _is_time(name):  # written Ns
        return "ns"
    if unit == "C":
        unit = _celsius_or_coulomb(name)
    if unit == "F" and _celsius_or_coulomb(name) == "°C":
        unit = "°F"
    if unit == "°C" and (_DIFFERENCE.match(name) or _CHANGE.match(name) or _MINUS.fullmatch(name.strip())):
        return "Δ°C"
    return unit + "n" if unit in ("g", "mg", "ug") and _ACCELERATION.match(name) else unit


def without_unit(header: str, unit: str) -> str:
    """Return the name in a header that gives exactly this unit, known or not; an empty text where it does not."""
    own = re.escape(unit)
    forms = [rf"(.+?)\s*(?:\(\s*{own}\s*\)|\[\s*{own}\s*\])"]
    if unit not in ("", "1"):  # speed_1 may be the first of several speeds
        forms += [rf"(.+?)\s*_{own}", rf"(.+?)\s+in\s+{own}"]
    return next(
        (match[1] for form in forms if (match := re.fullmatch(form, header)) and not _factor(match[1], header)), ""
    )


def said_unit(header: str) -> str:
    """Return the unit in a header as written, if it is unknown; else an empty text.

    >>> said_unit("count [lines/min]"), said_unit("command_Mv"), said_unit("U_cmd"), said_unit("x (1)")
    ('lines/min', 'Mv', '', '')
    >>> said_unit("HV x1000 (V)"), said_unit("U(V)*1000"), said_unit("HV, 1 kV/V")
    ('x1000 V', '*1000 V', '1 kV/V')
    """
    name, unit = _split(header)
    if factor := _factor(name, header):
        at = header.find(factor)
        rest = header[:at].rstrip(" _(") + header[at + len(factor) :].lstrip(" _)") if at >= 0 else ""
        return factor if _RATIO.fullmatch(factor) else f"{factor} {unit or _split(rest)[1]}".strip()
    return _unknown_unit(header)


def _unknown_unit(header: str) -> str:
    """Return the unit in a header as written, if it is unknown and no factor stands beside it; else an empty text."""
    for form in () if _OF_NODE.fullmatch(header) else _FORMS:
        if match := form.fullmatch(without_latex(header).translate(FULL_WIDTH)):
            said = match[2].strip("()[] ")
            if _is_doubtful(form, match[1], said) or find_unit(said):
                continue
            if form is _IN_BRACKETS and re.search(r"[^\W\d_]|[%°]|\d\s*:\s*\d", said):
                return said
            multiple = form is _IN_WORDS and (parts := _MULTIPLE.fullmatch(said)) and find_unit(parts[1])
            if is_misspelt(said) or multiple or _PEAK.fullmatch(said):
                return said
    return ""


def is_misspelt(unit: str) -> bool:
    """Return whether an unknown unit differs from a known one only in upper and lower case."""
    return len(unit) > 1 and unit.lower() in _LOWERED and not find_unit(unit)


def _celsius_or_coulomb(name: str) -> str:
    """Return the unit that C means after a name; C itself if the name does not decide."""
    if _CERTAIN_TEMPERATURE.match(name):
        return "°C"
    if _CHARGE.match(name):
        return "coulomb"
    return "°C" if _TEMPERATURE.match(name) or _DIFFERENCE.match(name) else "C"


def _is_rate(before: str, unit: str) -> bool:
    """Return whether the text before a slash belongs to a unit; ``t/s`` and ``Zeit/s`` are times, any other ``/s`` is a
    rate.
    """
    if _SYMBOLS_OF.get(before) == UNITS[unit].si:
        return False
    rate = UNITS[unit].si == "s" and not _is_time(before)
    return rate or bool(find_unit(before)) or before in _NO_QUANTITIES
