"""Reduce the folders that commands wrote to what the gallery of the site draws.

``python tests/tools/gallery.py RESULTS docs`` reads ``docs/gallery/entries.toml``, takes what is found below RESULTS and
writes ``docs/data/gallery.json``; entries without results stay as they are. Reports of entries with ``report`` are packed
into ``docs/gallery``.
"""

from __future__ import annotations

import argparse
import csv
import json
import lzma
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from signatures import outline

POINTS = 300
"""Groups of samples along a picture, each shown by its smallest and its largest value."""


def columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table of a figure, each of shape (n,)."""
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    return dict(zip(head, table.T, strict=True))


def drawn(table: dict[str, np.ndarray], names: list[str]) -> dict[str, Any]:
    """Series of columns whose names begin with `names`; the rest of a name is the unit."""
    found = {name: next(key for key in table if key.startswith(name + "_")) for name in names}
    time = table["time_s"]
    return {
        "seconds": [float(time.min()), float(time.max())],
        "unit": next(iter(found.values())).removeprefix(names[0] + "_").replace("um", "µm"),
        "series": {name: outline(table[key], POINTS) for name, key in found.items()},
    }


def residual(folder: Path) -> dict[str, Any]:
    """Measured minus simulated reading, before and after, of a diagnosis."""
    table = columns(folder / "figures" / "time.csv")
    unit = next(key for key in table if key.startswith("measured_")).removeprefix("measured_")
    left = {"time_s": table["time_s"]}
    for label, name in (("calibrated model", "base"), ("amended model", "amended")):
        if f"{name}_{unit}" in table:
            left[f"{label}_{unit}"] = table[f"measured_{unit}"] - table[f"{name}_{unit}"]
    return drawn(left, [key.removesuffix(f"_{unit}") for key in left if key != "time_s"])


def entry(told: dict[str, Any], folder: Path, pictures: Path) -> dict[str, Any]:
    """What is kept of one folder of results."""
    if "figure" in told:
        shutil.copyfile(folder / told["figure"], pictures / f"{told['name']}.svg")
        return {}
    if "table" in told:
        return drawn(columns(folder / "figures" / told["table"]), told["columns"])
    found = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    return {"verdict": found["verdict"], "sentence": found["sentence"], **residual(folder)}


def packed(report: str) -> bytes:
    """A report without links to the files beside it, which the site does not have."""
    return lzma.compress(re.sub(r'<a href="(?!#|https?:)[^"]*">(.*?)</a>', r"\1", report).encode("utf-8"), preset=9)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("docs", type=Path)
    args = parser.parse_args()
    target = args.docs / "data" / "gallery.json"
    kept = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    told = tomllib.loads((args.docs / "gallery" / "entries.toml").read_text(encoding="utf-8"))["entry"]
    for one in told:
        folder = args.results / (one.get("results") or f"{one['record']}/found")
        table = f"figures/{one['table']}" if "table" in one else "diagnosis.json"
        if (folder / one.get("figure", table)).exists():
            kept[one["name"]] = entry(one, folder, args.docs / "gallery")
        if one.get("report") and (folder / "report.html").exists():
            packet = packed((folder / "report.html").read_text(encoding="utf-8"))
            (args.docs / "gallery" / f"{one['name']}.html.xz").write_bytes(packet)
    target.write_text(json.dumps({one["name"]: kept[one["name"]] for one in told if one["name"] in kept}) + "\n")
    print(target, len(kept), "of", len(told))


if __name__ == "__main__":
    main()
