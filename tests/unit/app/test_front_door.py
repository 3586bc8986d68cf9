"""Every error message of the command line, as `error_messages.txt` lists them, and that the list is whole."""

import ast
import gzip
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from designed import DESIGNED
from made_narx import trained_on
from rig_files import RIG
from scipy.io import savemat
from typer.main import get_command

from deatwin.app.cli import app, main
from deatwin.ident.narx import NarxModel
from deatwin.plant.sources import load_plant
from deatwin.studies import provenance
from deatwin.studies.voice import complain

ROOT = Path(__file__).parents[3]
HEADER = "time_s,command_V,displacement_mm"
PLANTS = """\
import sys
from deatwin.plant import Coupon, Plant, Reading

def strip():
    return Plant(rig=Coupon(sample_time=0.1))

class Seen(Coupon):
    def write(self, build):
        return build.watch("output", super().write(build))

def seen():
    return Plant(rig=Seen(sample_time=0.02, further=(Reading(name="output", noise=1.0),)))

class Ratio(Coupon):
    output_unit = "1"

def ratio():
    return Plant(rig=Ratio(sample_time=0.1))

class Counter(Coupon):
    output_unit = "ticks"

def counter():
    return Plant(rig=Counter(sample_time=0.1))

class Turning(Coupon):
    output_unit = "rad/s"

def turning():
    return Plant(rig=Turning(sample_time=0.1))

def number():
    return 3

def fails():
    raise ValueError("the drawer is locked")

def leaves():
    sys.exit("usage: plants.py FILE")
"""


def table(header: str = HEADER, samples: int = 40, **changed: str) -> str:
    """A recording at 50 Hz; ``row_8="0.12,nan,0.3"`` changes a row, counted as an editor does, or takes it out."""
    rows = [header]
    for k in range(samples):
        rows.append(f"{0.02 * k:.2f},{2 + 0.5 * math.sin(k):.4f},{0.3 + 0.01 * math.sin(k):.5f}")
    for name, text in changed.items():
        rows[int(name.removeprefix("row_")) - 1] = text
    return "".join(f"{row}\n" for row in rows if row)


def decimals(*rows: str, header: str = "time_s;command_V") -> str:
    """A recording with semicolons."""
    return "\n".join([header, *rows]) + "\n"


def stamped(form: str) -> str:
    """Samples at whole seconds of a minute."""
    return "".join(f"{form.format(k)},{2 + math.sin(k):.4f},0.3\n" for k in range(10))


LVM = """\
LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t.
X_Columns\tNo
***End_of_Header***\t
Channels\t2\t\t
Y_Unit_Label\tV\tmm\t
X_Dimension\tTime\tTime\t
X0\t0.0\t0.0\t
Delta_X\t0.02\t0.02\t
***End_of_Header***\t\t\t
X_Value\tcommand\tdisplacement\tComment
\t1.0\t0.5
\t2.0\t0.6
"""
DESCRIPTION = '# deatwin/recording/1 {"schema": "%s", "sample_time": 0.02, "signals": [], "provenance": {}}\n' + table()
DATED = (
    '# deatwin/recording/1 {"schema": "deatwin/recording/1", "sample_time": 0.02, "signals": '
    '[{"role": "input", "name": "command", "unit": "V", "header": "command_V"}, '
    '{"role": "output", "name": "displacement", "unit": "m", "header": "displacement_mm"}], '
    '"provenance": {"wf_start_time": "%s"}}\n'
)
FILES = {
    "good.csv": table(),
    "lab.jsonl": '{"time_s": 0.1, "command_V": 2.0, "displacement_mm": 0.3}\n' * 12
    + '{"time_s": 0.2}\n{"time_s": 0.3, "command_V": 2.0, "displacement_mm": 0.3}\n',
    "coarse.csv": "time_s,time_ms,command_V,displacement_mm\n"
    + "".join(f"{k // 50},{20 * k},2,0.3\n" for k in range(99)),
    "single.csv": "".join(f"{math.sin(k):.4f}\n" for k in range(40)),
    "misspelt.csv": table("time_s,comand_V,displacement_mm"),
    "output.csv": table("time_s,command_V,displacment_mm"),
    "clockless.csv": table("number,command_V,displacement_mm"),
    "unit.csv": table("time_s,command_mm,displacement_mm"),
    "mega.csv": table("time_s,command_MV,displacement_mm"),
    "numbered.csv": "0,1,2\n" + "".join(f"{0.02 * k:.2f},{2 + math.sin(k):.4f},0.3\n" for k in range(40)),
    "counts.csv": table("time_s,DAC counts,displacement_mm"),
    "scaled.csv": table("time_s,HV (V/kV),displacement_mm"),
    "celsius.csv": table("time_s,command_V,level_C"),
    "unitless.csv": table("t,voltage,disp"),
    "volts.csv": table("t,voltage,disp_V"),
    "both.csv": table("t,disp_V,disp_mm"),
    "turns.csv": table("t,voltage,speed (1/min)"),
    "parsecs.csv": table("t,voltage,disp (parsecs)"),
    "extra.csv": table("time_s,command_V,displacement_mm,curent_uA"),
    "double.csv": table("time_s,command_V,command_V"),
    "outage.csv": table(**{f"row_{k}": "" for k in range(20, 30)}),
    "ratio.csv": table("time_s,extension,stretch_mm"),
    "changes.csv": table(**{f"row_{k}": f"{0.02 * (k - 2):.2f},,0.3" for k in range(3, 42) if k % 4}),
    "gap.csv": table(row_22="", row_23="", row_24=""),
    "constant.csv": HEADER + "".join(f"\n{0.02 * k:.2f},2.0,0.3" for k in range(40)),
    "nan.csv": table(row_8="0.12,nan,0.3"),
    "inf.csv": table(row_8="0.12,inf,0.3"),
    "hole.csv": table(row_8="0.12,,0.3"),
    "text.csv": table(row_8="0.12,off,0.3"),
    "over.csv": table(row_8="0.12,9.9E+37,0.3"),
    "minutes.csv": table("time,command_V,displacement_mm", samples=0)
    + "".join(f"14{k:02}00,{2 + math.sin(k):.4f},0.3\n" for k in range(40)),
    "factors.csv": table(HEADER + "\nx1,x1,x0.001"),
    "rows.csv": "time_s,0,0.1,0.2,0.3\ncommand_V,1,2,3,4\ndisplacement_mm,2,3,4,5\n",
    "timeless.csv": table(row_8=",2.0,0.3"),
    "short.csv": table(row_8="0.12"),
    "rated.csv": "# sample rate: 50 Hz\ncommand_V,displacement_mm\n" + "2,3\n1,4\n" * 9,
    "blocks.csv": 2 * "trace_names,,u,x\nunit,s,V,mm\ntrace_values,0,1,2\n,0.1,2,3\n,0.2,3,4\n,0.3,4,5\n",
    "untimed.csv": table("command_V,displacement_mm,time_s", row_8="2.0,0.3"),
    "long.csv": table(row_8="0.12,2.0,0.3,9"),
    "marks.csv": table(row_8="0.12,2_0,0.3"),
    "unsorted.csv": table(row_8="0.04,2.0,0.3"),
    "uneven.csv": table(row_8="0.127,2.0,0.3"),
    "drifting.csv": HEADER + "".join(f"\n{0.02 * k + 4e-6 * k * k:.7f},{2 + math.sin(k):.4f},0.3" for k in range(60)),
    "started.csv": "time,command_V,displacement_mm\n"
    + "".join(f"10:11:12,{2 + math.sin(k):.4f},0.3\n" for k in range(40)),
    "jiffies.csv": table("time (jiffies),command_V,displacement_mm"),
    "serials.csv": table("time,command_V,displacement_mm", samples=0)
    + "".join(f"{45000 + 2e-7 * k:.7f},{2 + math.sin(k):.4f},0.3\n" for k in range(40)),
    "ticks.csv": "Timestamp,command_V,displacement_mm\n" + stamped("{}00"),
    "bare.dat": "".join(f"{0.1 * k + 0.02 * (k % 2):.2f} {2 + math.sin(k):.4f} 0.3\n" for k in range(20)),
    "one.csv": table(samples=1),
    "header.csv": HEADER + "\n",
    "headless.csv": table().partition("\n")[2],
    "blanks.csv": table("time_s,command_V").replace(",", " "),
    "holes.dat": table(row_8="0.12,0.3").replace(",", " "),
    "numbers.csv": table("time,1,2"),
    "clocks.csv": table("time,t,command_V"),
    "naive.csv": table("time,command_V,displacement_mm", samples=0) + stamped("2024-05-01 12:00:0{}"),
    "zoned.csv": table("time,command_V,displacement_mm", samples=0) + stamped("2024-05-01T13:00:0{}Z"),
    "dates.csv": table("time,command_V,displacement_mm", samples=0)
    + stamped("2024-05-01 12:00:0{}")
    + "soon,1,2\n2024-05-01 12:00:11,1,2\n",
    "means.csv": table() + "Mean,1,2\n",
    "day.csv": table("time,command_V,displacement_mm", samples=0) + stamped("5/6/24 12:00:0{}"),
    "days.csv": table("time,command_V,displacement_mm", samples=0) + "5/6/24 23:59:59,1,2\n6/6/24 00:00:00,1,2\n",
    "bar.lvm": LVM.replace("Tab", "Bar"),
    "frequency.lvm": LVM.replace("Time\tTime\t", "Frequency\tFrequency\t"),
    "milli.lvm": LVM.replace("X_Dimension", "X_Unit_Label\tms\tms\t\nX_Dimension"),
    "labels.lvm": LVM.replace("\tcommand\t", "\tcommand_mV\t"),
    "apart.lvm": LVM.replace(
        "X_Dimension", "Date\t2024/05/01\t2024/05/01\t\nTime\t12:00:00.5\t12:00:02\t\nX_Dimension"
    ),
    "steps.lvm": LVM.replace("Delta_X\t0.02", "Delta_X\t0.01"),
    "others.lvm": LVM + LVM.partition("***End_of_Header***")[2].replace("displacement", "force"),
    "multi.lvm": LVM.replace("X_Columns\tNo", "X_Columns\tMulti")
    .replace("command\tdis", "command\tX_Value\tdis")
    .replace("\n\t", "\n0.1\t")
    .replace("\t1.0\t", "\t1.0\t0.2\t"),
    "old.xls": "not a recording",
    "packed.7z": "not a recording",
    "fake.zip": "not a recording",
    "fake.xlsx": "not a recording",
    "nameless.csv": table("time_s,command_V"),
    "name.csv": table('time_s,"command_V,displacement_mm'),
    "blank.csv": "",
    "modal.txt": "    -1\n    58\nforce\n    -1\n",
    "rates.csv": "t1_s,command_V,t2_s,y\n"
    + "".join(f"{0.02 * k:.2f},{k}" + (f",{0.04 * k:.2f},{k}\n" if k < 20 else ",,\n") for k in range(40)),
    "aside.csv": "t1_s,command_V,t2_s,displacement_mm\n"
    + "".join(f"{0.02 * k:.2f},{k % 3},{0.04 * k:.2f},{k % 5}\n" for k in range(40)),
    "copied.csv": HEADER + "\n" + "".join(2 * f"{0.02 * k:.2f},{k % 3},{k % 5}\n" for k in range(40)),
    "appended.csv": table() + "time_s,displacement_mm,command_V\n1,2,3\n",
    "series.csv": "time_s,field,value\n" + "".join(f"{0.02 * k:.2f},u,{k}\n{0.02 * k:.2f},y,{k}\n" for k in range(20)),
    "skipped.csv": "Date,time,command_V\n"
    + "".join(f"2024-05-0{1 + 2 * (k > 4)},12:00:0{k},{k % 3}\n" for k in range(10)),
    "parted.csv": "time_s,command_V,note\n"
    + "".join(f"{0.02 * k:.2f},{'1,002' if k == 6 else k},\n" for k in range(40)),
    "points.csv": decimals(*(f"{0.02 * k:.2f};{'999' if k % 2 else '1.125'}" for k in range(40))),
    "clock.csv": table("time,command_V,displacement_mm", samples=0) + stamped("12:00:0{}"),
    "film.csv": HEADER + "".join(f"\n{0.02 * k:.2f},{2000 + k},0.3" for k in range(40)),
    "few.csv": table(samples=8),
    "high.csv": HEADER + "".join(f"\n{0.02 * k:.2f},{2 + 0.06 * k:.2f},0.3" for k in range(200)),
    "slow.csv": HEADER + "".join(f"\n{5 + 0.04 * k:.2f},{2 + math.sin(k):.4f},0.3" for k in range(40)),
    "sums.csv": decimals("0,00;2,5", "0,02;1.002,5", "0,04;2.6"),
    "thousands.csv": decimals(*(f"{k};2,{k:03}" for k in range(100, 140))),
    "swiss.csv": decimals("0.00;2.5", "0.02;1'002 500.5", "0.04;2.6"),
    "settings.csv": decimals("Scale;0.005", *(f"{k};{k}" for k in range(40)), header="sample;command_V"),
    "mixed.csv": decimals("0,00;2,5", "0,02;2.5", "0,04;2,6"),
    "quoted.csv": table(row_8='0.12,"2.0\n",0.3'),
    "delimiters.csv": "time_s;command_V,x\n1;a,3\n2;b,4\n3;b,5\n",
    "units.csv": "time_s,command_V\n(s),(mV)\n0.00,1\n0.02,2\n0.04,1\n",
    "damaged.csv": "# deatwin/recording/1 {\n" + table(),
    "schema.csv": DESCRIPTION % "deatwin/recording/9",
    "wide.csv": "\n".join([",".join(f"c{k}" for k in range(10_001)), *[",".join(["1"] * 10_001)] * 2]),
    "quotes.csv": table(row_8='0.12,"' + "2" * 140_000 + '",0.3'),
    "dated.csv": DATED % "soon" + table(),
    "later.csv": DATED % "later" + table(),
    "note.docx": "not a recording",
    "bare": "no table\n",
    "fake.mat": "not a recording, whatever its name says" * 9,
    "fake.nc": "not a recording",
    "half.nc": "CDF\x01",
    "fake.tdms": "not a recording",
    "rig.toml": RIG,
    "key.toml": RIG.replace("prestretch", "prestrech"),
    "lid.toml": RIG.replace("mass_g = 3.0", "mass_g = 3.0\nlid = 1"),
    "moved.toml": RIG.replace("mass_g = 3.0", "mass_g = 3.0\nnoise_um = 1"),
    "missing.toml": RIG.replace("gain = 800.0\n", ""),
    "number.toml": RIG.replace("= 3.5", '= "3.5"'),
    "word.toml": RIG.replace('"VHB 4905"', "4905"),
    "empty.toml": RIG.replace('"VHB 4905"', '""'),
    "material.toml": RIG.replace("VHB 4905", "VHB 4906"),
    "zero.toml": RIG.replace("zero volts", "rest"),
    "range.toml": RIG.replace("= 3.5", "= 350"),
    "section.toml": RIG.replace("[load]", "[lode]"),
    "cut.toml": RIG.partition("[sensor]")[0],
    "value.toml": "film = 3\n[load]" + RIG.partition("[load]")[2],
    "mistakes.toml": RIG.replace("= 0.5", "= 0.0005").replace("gain = 800.0\n", "").replace("mass_g", "mas_g"),
    "electrode.toml": RIG.replace("= 35.0", "= 90.0"),
    "contact.toml": RIG.replace("= 6.0", "= 36.0"),
    "ranged.toml": RIG.replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 0\ncommand_max_V = 3"),
    "kilovolts.toml": RIG.replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 0\ncommand_max_V = 12000"),
    "unborne.toml": RIG.replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 0\ncommand_max_V = 15"),
    "inner.toml": RIG.replace("[load]", "[rig.load]"),
    "windows.toml": RIG.replace("VHB 4905", r"C:\new\vhb.toml"),
    "commands.toml": RIG.replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 4\ncommand_max_V = 3"),
    "metres.toml": RIG.replace("= 0.5", "= 0.0005"),
    "huge.toml": RIG.replace("800.0", "8000000"),
    "comma.toml": RIG.replace("= 3.5", "= 3,5"),
    "digits.toml": RIG.replace("800.0", "9" * 5000),
    "called.toml": 'Kind = "diaphragm"\n' + RIG,
    "curly.toml": RIG.replace('"VHB 4905"', "“VHB 4905”"),
    "hoop.toml": RIG + "[hoop]\n",
    "three.toml": "readings = 3\n" + RIG,
    "curent.toml": RIG + '[readings.curent]\nunit = "nA"\nnoise = 1\n',
    "same.toml": RIG + '[readings.current]\ncolumn = "displacement_mm"\nunit = "nA"\nnoise = 1\n',
    "monitor.toml": RIG + '[readings.current]\ncolumn = "I_mon"\nunit = "nA"\nnoise = 1\n',
    "monitor.csv": HEADER + ",I_mon" + "".join(f"\n{0.02 * k:.2f},{k % 3},0.3,5" for k in range(40)),
    "above.toml": "gain = 800.0\n" + RIG,
    "disk.toml": 'kind = "disk"\n' + RIG.replace("contact_diameter_mm = 6.0\n", ""),
    "twice.toml": RIG + '[material]\nname = "RTV 615"\n',
    "energy.toml": RIG.replace('material = "VHB 4905"\n', "") + '[material]\nname = "mine"\nenergy = "gnet"\n',
    "started.toml": RIG.replace("gain = 800.0", 'gain = 800.0\nstart = "unknown"'),
    "filed.toml": RIG.replace("VHB 4905", "absent.toml"),
    "rigged.toml": RIG.replace("VHB 4905", "rig.toml"),
    "gnet.toml": RIG.replace("VHB 4905", "energy.toml"),
    "limits.toml": RIG.replace("gain = 800.0", 'input = "film voltage"\ncurrent_limit_uA = 200'),
    "tests.toml": '[[tests]]\nkind = "tensile"\nfile = "good.csv"\n',
    "lengthless.toml": '[[tests]]\nkind = "tension"\nfile = "good.csv"\ndisplacement = "#3"\nstress = "#2"\n',
    "strainless.toml": '[[tests]]\nkind = "tension"\nfile = "good.csv"\nstrain = "#1"\nstress = "#2"\n',
    "contrary.toml": '[[tests]]\nkind = "tension"\nfile = "good.csv"\nstretch = "#3"\nstress = "#2=Pa"\n',
    "soft.toml": RIG.replace("= 3.5", "= 2.0"),  # pulls in at a few kilovolts
    "deep.toml": "a = " + "[" * 100_000,
    "plants.py": PLANTS,
    "broken.py": "def strip(:\n",
    "huge.json": '{"schema": "deatwin/narx/1", "sample_time_s": 1e400}',
    "truncated.json": '{"schema": "deatwin/narx/1", "ter',
    "deep.json": "[" * 100_000,
    "list.json": "[1]",
    "run.json": '{"schema": "deatwin/run/1"}',
    "bare_narx.json": '{"schema": "deatwin/narx/1"}',
    "states.json": '{"schema": "deatwin/nonlinear-states/1"}',
    "bare_plant.json": '{"schema": "deatwin/plant/1"}',
    "undesigned.json": '{"schema": "deatwin/check/1", "controller": null}',
    "file": "no folder\n",
}
BYTES = {
    "binary.csv": bytes(range(256)),
    "utf16.csv": table().encode("utf-16")[:-2] + b"\x00\xd8\x00\x00",
    "half.csv.gz": gzip.compress(table().encode(), mtime=0)[:-20],
    "latin.toml": RIG.replace("VHB", "Élastomère").encode("latin-1"),
}
DATA = ("data/vhb4910", "data/emps", "data/silverbox")  # without recordings
NOBODY = 65534
FRONT_DOOR = (
    "scenarios/deatwin/app/*.py",
    "scenarios/deatwin/studies/*.py",
    "scenarios/deatwin/scenarios/*.py",
    "scenarios/deatwin/app/commands/*.py",
    "plant/deatwin/plant/sources.py",
    "plant/deatwin/plant/imported.py",
    "plant/deatwin/plant/documents.py",
    "plant/deatwin/plant/checks.py",
    "plant/deatwin/plant/rigs/rigfile.py",
    "plant/deatwin/plant/rigs/tomlfile.py",
    "plant/deatwin/plant/rigs/rigmistakes.py",
    "plant/deatwin/plant/files/*.py",
    "plant/deatwin/plant/files/formats/*.py",
)
ERRORS = {"DataError", "RigError", "ModelError", "SimulationError", "ControlError", "BadParameter", "Mistake"}
NOT_FROM_THE_COMMAND_LINE = {
    "recordings.py: allow_gaps divides a file at its gaps": "a command reads all parts; test_files.py makes it",
    "assemble.py: dt is": "typer refuses --dt first",
    "checks.py: give a recording with the values in": "commands read files in the plant's units; test_survey.py makes it",
    "checks.py: put the row of that reading first": "readers put the rig's first reading first; test_several_readings.py makes it",
    "checks.py: inputs, but the plant takes one": "commands read the rig's one input; plant/test_refusals.py makes it",
    "csvtable.py: only an archive of one text file": "test_files_stored.py packs others",
    "csvtable.py: it unpacks to more than": "a text of 1 GB; test_files_stored.py lowers the limit",
    "csvtable.py: cannot be read as numbers": "the last resort of a reader that knows no such cell",
    "csvtable.py: lines; at most": "a file of 40 MB; test_safe_read.py makes it",
    "missing_physics.py: without its evidence": "stories diagnose anew, and so have the evidence",
    "documents.py: numbers, texts and lists; at most": "a file of 60 MB; test_safe_read.py makes it",
    "arrays.py: columns; at most": "as of a CSV",
    "lvm.py: columns; at most": "as of a CSV",
    "lvm.py: lines; at most": "as of a CSV",
    "xlsx.py: sheets hold cells": "a workbook, which test_files_xlsx.py makes",
    "xlsx.py: no sheet": "as above",
    "xlsx.py: unpacks to": "as above",
    "unpacked.py: more entries of a cell or struct": "no library writes such a file; test_safe_read.py does",
    "unpacked.py: no element can be of type": "no library writes such a file; test_readers_fuzzed.py does",
    "apart.py: .*: .*": "what crashes a library today need not tomorrow; test_apart.py makes it",
    "unpacked.py: more samples than it holds": "no library writes such a file; test_safe_read.py does",
    "tdms.py: samples and has": "no library writes such a file",
    "table.py: it must be positive and finite": "readers pass over such a clock, or call the description damaged",
    "recordings.py: columns must be one-dimensional": "commands write columns of one length",
    "recordings.py: holds a comma": "commands write headers of their own",
    "replacing.py: cannot be written": "the place is looked at first; afterwards only a full disk does this",
    "simulate.py: the simulation stopped:": "known plants stop at a time and a command",
}
"""By module and words of the message: why no row can show it."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the table."""

    status: int
    given: str
    says: str
    lacks: str | None

    @property
    def arguments(self) -> list[str]:
        words = shlex.split(self.given)
        has_none = "--out" in words or words[0] in ("view", "doctor")
        return [*words, *(["--out", "new"] if self.status == 1 and not has_none else [])]

    @property
    def pattern(self) -> str:
        return re.escape(self.says).replace("…", ".*")


def listed() -> Iterator[Row]:
    """The rows of the table."""
    for line in (Path(__file__).parent / "error_messages.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            status, given, says = line.split(" | ", 2)
            hidden = re.fullmatch(r"lacks (\w+): (.*)", given)
            lacks, given = hidden.groups() if hidden else (None, given)
            yield Row(status=int(status), given=given, says=says, lacks=lacks)


ROWS = list(listed())


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with everything that can be given wrongly."""
    desk = tmp_path_factory.mktemp("desk")
    for name, text in FILES.items():
        (desk / name).write_text(text, encoding="utf-8", newline="")
    for name, content in BYTES.items():
        (desk / name).write_bytes(content)
    for name in ("folder", "folder.csv", "folder.toml", "folder.json", "locked", "spoilt", *DATA):
        (desk / name).mkdir(parents=True)
    (desk / "spoilt" / "diagnosis.json").write_text("{}")
    (desk / "locked").chmod(0o555)
    for ending in ("csv", "toml", "json"):
        os.mkfifo(desk / f"pipe.{ending}")
        (desk / f"link.{ending}").symlink_to(f"gone.{ending}")
        with open(desk / f"large.{ending}", "wb") as file:
            file.truncate(10 * 2**30)  # sparse
    desk.chmod(0o755)
    write_models(desk)
    write_recordings(desk)
    return desk


def write_models(desk: Path) -> None:
    """NARX models and plants, sound and not."""
    trained = trained_on((1.0, 3.0), (0.0, 2.0), output_centre=1.2)
    terms = {"y(k-1)": 0.8, "u(k-1)": 0.1, "u(k-1)^2": 0.02}
    narx = replace(NarxModel.from_terms(terms, sample_time=0.02), operating=trained)
    narx.save(desk / "narx.json")
    replace(narx, provenance={"excited_band_Hz": "wide"}).save(desk / "banded.json")
    bent = NarxModel.from_terms({"y(k-1)": 0.5, "|u(k-1)|": 0.1}, sample_time=0.02)
    replace(bent, operating=trained).save(desk / "functions.json")
    two = NarxModel.from_terms({"y(k-1)": 0.5, "u1(k)": 1.0, "u2(k)": 1.0}, sample_time=0.02)
    two.save(desk / "two.json")
    load_plant(desk / "rig.toml").save(desk / "model.json")
    (desk / "designed.json").write_text(json.dumps(DESIGNED), encoding="utf-8")
    for name, source, key, value in (
        ("terms.json", "narx.json", "terms", 3),
        ("ragged.json", "narx.json", "theta_cov", [[1.0], [1.0, 2.0]]),
        ("indefinite.json", "narx.json", "theta_cov", [[1.0, 1.5, 0.0], [1.5, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        ("lopsided.json", "narx.json", "theta_cov", [[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        ("effect.json", "model.json", "effects", ["crep"]),
        ("negative.json", "model.json", "noise", -1.0),
        ("bogus.json", "model.json", "calibration", {"names": ["bogus"], "covariance": [[1.0]]}),
    ):
        document = json.loads((desk / source).read_text(encoding="utf-8"))
        assert key in document
        (desk / name).write_text(json.dumps({**document, key: value}), encoding="utf-8")


def write_recordings(desk: Path) -> None:
    """Recordings in other formats."""
    from h5py import ExternalLink, File
    from nptdms import ChannelObject, TdmsWriter
    from xarray import Dataset

    clock = 0.02 * np.arange(40)
    sound = {"time_s": clock, "command_V": 2 + np.sin(clock), "displacement_mm": np.cos(clock)}
    spoilt, endless = sound["command_V"].copy(), sound["command_V"].copy()
    spoilt[6], endless[6] = np.nan, np.inf
    timeless = {name: values for name, values in sound.items() if name != "time_s"}
    for name, content in {
        "vectors.mat": {"remark": "none"},
        "complex.mat": {**sound, "command_V": sound["command_V"] + 1j},
        "nan.mat": {**sound, "command_V": spoilt},
        "inf.mat": {**sound, "command_V": endless},
        "uneven.mat": {**sound, "displacement_mm": sound["displacement_mm"][1:]},
        "over.mat": {**sound, "command_V": 1e30 * sound["command_V"]},
        "attribute.mat": {**sound, "units": {"command_V": "mV"}},
        "rates.mat": {**timeless, "ts": 0.02, "fs": 100.0},
        "clock.mat": {**timeless, "ts": 0.02},
    }.items():
        savemat(desk / name, content, oned_as="column")
    Dataset({"time_s": ("row", clock), "command_V": ("none", [])}).to_netcdf(desk / "empty.nc", engine="h5netcdf")
    for name, made in (
        ("hollow.nc", lambda file: file.create_dataset("time_s", shape=(10**9,), dtype="f8")),
        ("elsewhere.nc", lambda file: file.__setitem__("time_s", ExternalLink("other.nc", "/time_s"))),
    ):
        with File(desk / name, "w") as file:
            made(file)
    with File(desk / "gained.h5", "w") as file:
        file["command"] = np.arange(40)
        file["command"].attrs.update({"units": "V", "gain": 0.005})
    with File(desk / "limits.h5", "w") as file:
        file["command"] = np.arange(40)
        file["command"].attrs["valid_range"] = "0 to 5"
    hertz = {"wf_increment": 0.02, "wf_xunit_string": "Hz"}
    with TdmsWriter(desk / "spectrum.tdms") as file:
        file.write_segment([ChannelObject("one", name, values, hertz) for name, values in timeless.items()])
    with TdmsWriter(desk / "clocks.tdms") as file:
        file.write_segment(
            [
                ChannelObject("one", name, values, {"wf_increment": 0.02, "wf_start_offset": start})
                for start, (name, values) in enumerate(timeless.items())
            ]
        )


@contextmanager
def without_rights() -> Iterator[None]:
    """As a user who may not write everywhere, whoever runs the tests."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def said(text: str) -> str:
    """What an error text says, out of its frame, in one line."""
    words = " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())
    usage = re.fullmatch(r"(?:Usage: .* )?Error:? (.*)", words)
    return usage[1] if usage else words.removeprefix("error: ")


@pytest.fixture
def at_desk(desk, monkeypatch, in_one_process):
    """The same, as the working folder, without public recordings; results of a test do not stay."""
    monkeypatch.chdir(desk)
    monkeypatch.delenv("DEATWIN_DATA", raising=False)
    monkeypatch.setenv("COLUMNS", "300")
    yield desk
    shutil.rmtree(desk / "new", ignore_errors=True)
    (desk / "new").unlink(missing_ok=True)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.given)
def test_what_is_wrong_is_said_in_one_line(row, at_desk, monkeypatch, capsys):
    if row.lacks:
        monkeypatch.setitem(sys.modules, row.lacks, None)
        monkeypatch.delitem(sys.modules, "deatwin.app.live.page", raising=False)  # which would have it already
    if "locked" in row.given:
        main([word.replace("locked", "file") for word in row.arguments])  # imports what nobody may not read
        capsys.readouterr()
    with without_rights() if "locked" in row.given else nullcontext():
        status = main(row.arguments)
    out, error = capsys.readouterr()
    assert re.fullmatch(row.pattern, said(error)), said(error)
    assert status == row.status
    # A look tells the columns of a file that cannot be read all the same.
    assert (out == "" or (row.arguments[0], status) == ("look", 1)) and "Traceback" not in error
    if status == 1:
        assert error.startswith("error: ") and error.count("\n") == 1
    assert not (at_desk / "new").exists()  # not even an empty folder


@pytest.mark.parametrize("given", ["simulate key.toml good.csv", "scenario"])
def test_a_process_says_the_same_and_ends_with_the_status(given, desk):
    row = next(row for row in ROWS if row.given == given)
    program = [sys.executable, "-c", "import sys; from deatwin.app.cli import main; sys.exit(main())"]
    done = subprocess.run([*program, *row.arguments], cwd=desk, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == row.status and done.stdout == ""
    assert re.fullmatch(row.pattern, said(done.stderr)), done.stderr


def test_a_full_disk_is_said_in_one_line(monkeypatch, capsys):
    def full(*arguments: object) -> dict[str, str]:
        raise OSError(28, "No space left on device", "results.csv")

    monkeypatch.setattr(provenance, "versions", full)
    assert main(["doctor"]) == 1
    assert capsys.readouterr().err == "error: results.csv: No space left on device\n"


def test_a_message_of_several_lines_becomes_one(capsys):
    complain("first\n  second")
    assert capsys.readouterr().err == "error: first second\n"


def messages(path: Path) -> Iterator[tuple[int, str]]:
    """Line and pattern of every message that a module makes into an error."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        texts = [*node.args[:1], *(word.value for word in node.keywords if word.arg == "text")]
        if name in ERRORS and texts and isinstance(texts[0], ast.Constant | ast.JoinedStr):
            parts = texts[0].values if isinstance(texts[0], ast.JoinedStr) else [texts[0]]
            yield (
                node.lineno,
                "".join(re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".*" for part in parts),
            )


def test_every_message_of_the_front_door_is_in_the_table():
    known = [row.says for row in ROWS]
    missing = []
    for path in sorted(path for pattern in FRONT_DOOR for path in ROOT.glob(pattern)):
        for line, pattern in messages(path):
            text = pattern.replace("\\", "")
            excused = any(
                path.name == name and words in text
                for name, words in (entry.split(": ", 1) for entry in NOT_FROM_THE_COMMAND_LINE)
            )
            if not excused and not any(re.search(pattern, row) for row in known):
                missing.append(f"{path.name}:{line}: {text}")
    assert not missing, "\n".join(missing)


def test_every_option_that_takes_a_value_is_given_wrongly_in_some_row():
    given = {(row.arguments[0], word) for row in ROWS for word in row.arguments}
    missing = [
        f"{name} {option.opts[0]}"
        for name, command in get_command(app).commands.items()
        for option in command.params
        if option.param_type_name == "option" and not getattr(option, "is_flag", False)
        if (name, option.opts[0]) not in given
    ]
    assert not missing, ", ".join(missing)
