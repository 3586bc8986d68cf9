"""Every error message of the command line in one table: what was given, the exit status, and what is said.

A message is written out as it appears; ``…`` stands for what another library or the system says, and for lists that
grow with the catalogue. Messages of wrong usage (status 2) are typer's, whose wording differs between its versions.
The last test finds every message in the code of the front door and asks for its row.
"""

import ast
import csv
import json
import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.operating import OperatingRange
from deatwin.plant import Diaphragm, Plant
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.scenarios.cli import main
from deatwin.scenarios.commands import doctor as doctor_module

ROOT = Path(__file__).parents[3]
HEADER = "time_s,command_V,displacement_mm"
RIG = """\
[film]
material = "VHB 4905"
thickness_mm = 0.5
prestretch = 3.5
frame_diameter_mm = 80.0
electrode_diameter_mm = 35.0
[load]
mass_g = 3.0
contact_diameter_mm = 6.0
[drive]
gain = 800.0
start_ramp_s = 2.0
start_hold_s = 3.0
[sensor]
sample_rate_Hz = 50.0
noise_um = 2.0
zero = "displacement at zero volts"
"""
PLANTS = """\
import sys
from deatwin.plant import Coupon, Plant

def strip():
    return Plant(rig=Coupon(sample_time=0.1))

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


DESCRIPTION = '# deatwin/recording/1 {"schema": "%s", "sample_time": 0.02, "signals": [], "provenance": {}}\n' + table()
FILES = {
    "good.csv": table(),
    "misspelt.csv": table("time_s,comand_V,displacement_mm"),
    "output.csv": table("time_s,command_V,displacment_mm"),
    "clockless.csv": table("number,command_V,displacement_mm"),
    "unit.csv": table("time_s,command_mm,displacement_mm"),
    "extra.csv": table("time_s,command_V,displacement_mm,curent_uA"),
    "double.csv": table("time_s,command_V,command_V"),
    "gap.csv": table(row_22="", row_23="", row_24=""),
    "constant.csv": HEADER + "".join(f"\n{0.02 * k:.2f},2.0,0.3" for k in range(40)),
    "nan.csv": table(row_8="0.12,nan,0.3"),
    "hole.csv": table(row_8="0.12,,0.3"),
    "text.csv": table(row_8="0.12,off,0.3"),
    "short.csv": table(row_8="0.12"),
    "long.csv": table(row_8="0.12,2.0,0.3,9"),
    "marks.csv": table(row_8="0.12,2_0,0.3"),
    "unsorted.csv": table(row_8="0.04,2.0,0.3"),
    "uneven.csv": table(row_8="0.127,2.0,0.3"),
    "drifting.csv": HEADER + "".join(f"\n{0.02 * k + 4e-6 * k * k:.7f},{2 + math.sin(k):.4f},0.3" for k in range(60)),
    "one.csv": table(samples=1),
    "header.csv": HEADER + "\n",
    "headless.csv": table().partition("\n")[2],
    "blank.csv": "",
    "film.csv": HEADER + "".join(f"\n{0.02 * k:.2f},{2000 + k},0.3" for k in range(40)),
    "later.csv": table().replace("0.00,", "0.00,", 1),
    "slow.csv": HEADER + "".join(f"\n{5 + 0.04 * k:.2f},{2 + math.sin(k):.4f},0.3" for k in range(40)),
    "thousands.csv": decimals(*(f"{k};2,{k:03}" for k in range(100, 140))),
    "mixed.csv": decimals("0,00;2,5", "0,02;2.5", "0,04;2,6"),
    "quoted.csv": table(row_8='0.12,"2.0\n",0.3'),
    "delimiters.csv": "time_s;command_V,x\n1;2,3\n2;3,4\n3;4,5\n",
    "units.csv": "time_s,command_V\n(s),(mV)\n0.00,1\n0.02,2\n0.04,1\n",
    "damaged.csv": "# deatwin/recording/1 {\n" + table(),
    "schema.csv": DESCRIPTION % "deatwin/recording/9",
    "note.docx": "not a recording",
    "bare": table(),
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
    "value.toml": "film = 3\n",
    "electrode.toml": RIG.replace("= 35.0", "= 90.0"),
    "contact.toml": RIG.replace("= 6.0", "= 36.0"),
    "commands.toml": RIG.replace("gain = 800.0", "gain = 800.0\ncommand_min_V = 4\ncommand_max_V = 3"),
    "deep.toml": "a = " + "[" * 100_000,
    "plants.py": PLANTS,
    "broken.py": "def strip(:\n",
    "truncated.json": '{"schema": "deatwin/narx/1", "ter',
    "deep.json": "[" * 100_000,
    "list.json": "[1]",
    "run.json": '{"schema": "deatwin/run/1"}',
    "bare_narx.json": '{"schema": "deatwin/narx/1"}',
    "bare_plant.json": '{"schema": "deatwin/plant/1"}',
    "undesigned.json": '{"schema": "deatwin/check/1", "controller": null}',
    "file": "no folder\n",
}
BYTES = {
    "binary.csv": bytes(range(256)),
    "utf16.csv": table().encode("utf-16")[:-1],
    "latin.toml": RIG.replace("VHB", "Élastomère").encode("latin-1"),
}
NO_FILE = "No such file or directory"
USAGE = "…"  # typer's own words
EFFECTS = "(known: amplifier_offset, …)"
READABLE = ".csv, .txt, .tsv, .mat, .tdms, .nc"

# What is given (with `--out out.csv`, `out.json` or `out` behind it if it names none), exit status, what is said.
ROWS = [
    # The rig.
    ("simulate absent.toml good.csv", 1, f"absent.toml: the rig file cannot be read: {NO_FILE}"),
    ("simulate rgi.toml good.csv", 1, f'rgi.toml: the rig file cannot be read: {NO_FILE}; did you mean "rig.toml"?'),
    ("simulate cannot good.csv", 1, "cannot: no such rig; give a rig file (.toml), a model.json or module:function"),
    ("simulate folder.toml good.csv", 1, "folder.toml: the rig file cannot be read: Is a directory"),
    ("simulate good.csv good.csv", 1, "good.csv: not TOML: …(at line 1, column 7)"),
    ("simulate latin.toml good.csv", 1, "latin.toml: not UTF-8 text at byte 19; save the rig file as UTF-8"),
    ("simulate deep.toml good.csv", 1, "deep.toml: not a rig file: lists in lists, too deep"),
    ("simulate key.toml good.csv", 1, 'key.toml, [film]: unknown key "prestrech"; did you mean "prestretch"?'),
    ("simulate lid.toml good.csv", 1, 'lid.toml, [load]: unknown key "lid"; known are mass_g, contact_diameter_mm'),
    ("simulate moved.toml good.csv", 1, 'moved.toml, [load]: unknown key "noise_um"; it belongs into [sensor]'),
    ("simulate missing.toml good.csv", 1, 'missing.toml, [drive]: the key "gain" is missing'),
    ("simulate number.toml good.csv", 1, 'number.toml, [film] prestretch: "3.5" is a text; it must be a number'),
    ("simulate word.toml good.csv", 1, "word.toml, [film] material: 4905 is a number; it must be a text in quotes"),
    ("simulate empty.toml good.csv", 1, "empty.toml, [film] material: the text is empty"),
    ("simulate material.toml good.csv", 1,
     "material.toml: unknown material 'VHB 4906'; did you mean \"VHB 4910\"? (known: VHB 4905, …)"),
    ("simulate zero.toml good.csv", 1,
     'zero.toml, [sensor] zero: "displacement at rest" is not known; it must be "displacement at zero volts"'),
    ("simulate range.toml good.csv", 1, "range.toml, [film] prestretch: 350 is out of range; it must be from 1 to 10"),
    ("simulate section.toml good.csv", 1, 'section.toml: unknown section [lode]; did you mean "load"?'),
    ("simulate cut.toml good.csv", 1,
     "cut.toml: the section [sensor] is missing; it must hold sample_rate_Hz, noise_um, zero"),
    ("simulate value.toml good.csv", 1, "value.toml: film is a number; it must be a section [film]"),
    ("simulate electrode.toml good.csv", 1,
     "electrode.toml, [film] electrode_diameter_mm: 90 is out of range; it must be below frame_diameter_mm, 80"),
    ("simulate contact.toml good.csv", 1,
     "contact.toml, [load] contact_diameter_mm: 36 is out of range; it must be below electrode_diameter_mm, 35"),
    ("simulate commands.toml good.csv", 1,
     "commands.toml, [drive] command_min_V: 4 is out of range; it must be below command_max_V, 3"),
    # A plant of the user's own.
    ("simulate nowhere:strip good.csv", 1,
     "nowhere:strip: cannot be imported: No module named 'nowhere'; give module:function"),
    ("simulate :strip good.csv", 1, ":strip: cannot be imported: Empty module name; give module:function"),
    ("simulate broken:strip good.csv", 1, "broken:strip: broken raised SyntaxError: …(broken.py, line 1)"),
    ("simulate plants:strap good.csv", 1,
     "plants:strap: plants has no 'strap'; did you mean \"strip\"?; give module:function"),
    ("simulate plants:number good.csv", 1, "plants:number: returned int; it must return a Plant"),
    ("simulate plants:fails good.csv", 1,
     "plants:fails: raised ValueError: the drawer is locked; it must return a Plant"),
    ("simulate plants:leaves good.csv", 1,
     "plants:leaves: raised SystemExit: usage: plants.py FILE; it must return a Plant"),
    ("diagnose plants:strip good.csv", 1,
     'good.csv: no column "stretch"; the file has "time_s", "command_V", "displacement_mm"'),
    # A model.
    ("simulate absent.json good.csv", 1, "absent.json: there is no such file"),
    ("simulate folder.json good.csv", 1, "folder.json: cannot be read: Is a directory"),
    ("simulate narx.json good.csv", 1, "narx.json: schema is 'deatwin/narx/1'; 'deatwin/plant/1' is needed"),
    ("simulate bare_plant.json good.csv", 1, "bare_plant.json: the key 'calibration' is missing"),
    ("simulate effect.json good.csv", 1,
     f"effect.json: there is no effect 'crep'; did you mean \"creep\"? {EFFECTS}"),
    ("frequency truncated.json", 1, "truncated.json: not a readable JSON file (Unterminated string …)"),
    ("frequency good.csv", 1, "good.csv: not a readable JSON file (…)"),
    ("frequency deep.json", 1, "deep.json: not a readable JSON file (lists in lists, too deep)"),
    ("frequency list.json", 1, "list.json: it names no schema; 'deatwin/narx/1' is needed"),
    ("frequency model.json", 1, "model.json: schema is 'deatwin/plant/1'; 'deatwin/narx/1' is needed"),
    ("frequency bare_narx.json", 1, "bare_narx.json: the key 'inputs' is missing"),
    ("frequency terms.json", 1, "terms.json: not a valid deatwin/narx/1 file: …"),
    # A recording.
    ("simulate rig.toml goood.csv", 1, 'goood.csv: no such file; did you mean "good.csv"?'),
    ("simulate rig.toml folder.csv", 1, "folder.csv: cannot be read: Is a directory"),
    ("simulate rig.toml note.docx", 1, f'note.docx: files ".docx" cannot be read; known are {READABLE}'),
    ("simulate rig.toml bare", 1, f'bare: files "" cannot be read; known are {READABLE}'),
    ("simulate rig.toml binary.csv", 1, "binary.csv: not a text file; save the table as CSV in UTF-8"),
    ("simulate rig.toml utf16.csv", 1, "utf16.csv: UTF-16 text that breaks off at byte …; save it again"),
    ("simulate rig.toml blank.csv", 1,
     f"blank.csv: the file is empty; it must hold a header ({HEADER}) and samples"),
    ("simulate rig.toml header.csv", 1, "header.csv: a header but no samples"),
    ("simulate rig.toml headless.csv", 1, "headless.csv, row 1: …"),
    ("simulate rig.toml one.csv", 1, "one.csv, row 2: one sample only; a recording needs at least two"),
    ("simulate rig.toml misspelt.csv", 1,
     'misspelt.csv: no column "command_V"; the file has "time_s", "comand_V", "displacement_mm"; did you mean '
     '"comand_V"? (rename it, or name the one to use: --input-column)'),
    ("identify output.csv", 1,
     'output.csv: no column "displacement_mm"; the file has "time_s", "command_V", "displacment_mm"; did you mean '
     '"displacment_mm"? (rename it, or name the one to use: --output-column)'),
    ("identify good.csv --output-column displacement", 1, ""),
    ("identify good.csv --output-column displaced_mm", 1,
     'good.csv: no column "displaced_mm"; the file has "time_s", "command_V", "displacement_mm"; did you mean '
     '"displacement_mm"?'),
    ("simulate rig.toml good.csv --input-column #9", 1, "good.csv: no column #9; the file has 3 columns"),
    ("simulate rig.toml double.csv --input-column command_V", 1,
     'double.csv: the column "command_V" stands 2 times; name one by its place, for example #2'),
    ("simulate rig.toml clockless.csv", 1,
     'clockless.csv: no column "time_s"; the file has "number", "command_V", "displacement_mm" (the times need this '
     "name, or a unit: (s) behind or below their name; for evenly sampled values without times give the sample time "
     "in seconds: --dt, in Python dt)"),
    ("simulate rig.toml unit.csv", 1,
     'unit.csv: the column "command_mm" has the unit mm; it must be one like V, as in "command_V"'),
    ("simulate rig.toml units.csv", 1,
     'units.csv, column "command_V": its name says V, the line below (mV); correct one'),
    ("simulate rig.toml extra.csv", 1, 'extra.csv: unknown column "curent_uA"; did you mean "current_uA"?'),
    ("simulate rig.toml gap.csv", 1,
     "gap.csv, row 22: a gap from 0.38 s to 0.46 s, missing samples of 0.02 s: 3; fill it, or split the record there "
     "(--allow-gaps, in Python allow_gaps=True)"),
    ("simulate rig.toml nan.csv", 1, 'nan.csv, row 8, column "command_V": nan is not a finite number'),
    ("simulate rig.toml hole.csv", 1, 'hole.csv, row 8, column "command_V": the cell is empty; it must be a number'),
    ("simulate rig.toml text.csv", 1, 'text.csv, row 8, column "command_V": "off" is not a number'),
    ("simulate rig.toml marks.csv", 1, 'marks.csv, row 8, column "command_V": "2_0" is not a number'),
    ("simulate rig.toml short.csv", 1, 'short.csv, row 8, column "command_V": the row has 1 cells, the header 3'),
    ("simulate rig.toml long.csv", 1, "long.csv, row 8: 4 cells, but the header has 3"),
    ("simulate rig.toml quoted.csv", 1,
     "quoted.csv: a quoted cell with a line break in it; write each sample on one line"),
    ("simulate rig.toml delimiters.csv", 1,
     "delimiters.csv, row 2: the columns may be delimited by comma or semicolon; use only one of them"),
    ("simulate rig.toml thousands.csv", 1,
     'thousands.csv, row 2, column "command_V": "2,100" may mean thousands or a decimal comma, and no number of the '
     "file tells; write it with a decimal point"),
    ("simulate rig.toml mixed.csv", 1,
     'mixed.csv, row 3, column "command_V": "2.5" has a decimal point, other numbers of the file have a comma; use '
     "one decimal sign and no marks between thousands"),
    ("simulate rig.toml unsorted.csv", 1, "unsorted.csv, row 8: times do not increase: 0.04 s follows 0.1 s"),
    ("simulate rig.toml uneven.csv", 1,
     "uneven.csv, row 8: uneven sampling: time 0.127 s is 0.027 s after the row before, where 0.02 s is usual "
     "(tolerance 0.0011 s); resample the record evenly"),
    ("simulate rig.toml drifting.csv", 1,
     "drifting.csv, row …: uneven sampling: time … s is … s off the even clock of … s (tolerance … s); resample the "
     "record evenly"),
    ("simulate rig.toml good.csv --dt 0.01", 1,
     "good.csv, row 2: the times do not keep the stated sample time of 0.01 s; they go on by 0.02 s; correct one of "
     "the two"),
    ("simulate rig.toml film.csv", 1,
     "film.csv: command 2039 V, first outside at 0 s; the rig's commands are from -37.5 V to 37.5 V; these look like "
     "film volts: 2039 V / gain 800 = 2.54875 V, so divide the column by the gain"),
    ("simulate rig.toml damaged.csv", 1,
     "damaged.csv: its description (deatwin_recording) is damaged (…); take it out, and the headers tell what the "
     "columns are"),
    ("simulate rig.toml schema.csv", 1,
     'schema.csv: its description has the schema "deatwin/recording/9"; "deatwin/recording/1" can be read'),
    ("diagnose rig.toml constant.csv", 1,
     "constant.csv: the input is constant throughout; at least one recording must move it"),
    ("identify constant.csv", 1,
     "constant.csv: the input is constant throughout; at least one recording must move it"),
    ("identify few.csv", 1, "few.csv: 8 samples, but identification with a held-out part needs at least 10"),
    ("diagnose rig.toml good.csv good.csv", 1,
     "good.csv and good.csv: they overlap between 0 s and 0.8 s; recordings given together are one experiment on one "
     "running clock, so give separate experiments separately (--experiment)"),
    ("diagnose rig.toml good.csv slow.csv", 1,
     "good.csv and slow.csv: sample times 0.02 s and 0.04 s; the recordings of one experiment need the same"),
    ("diagnose rig.toml --experiment goood.csv", 1, 'goood.csv: no such file; did you mean "good.csv"?'),
]  # fmt: skip
