"""Help, options that several commands share, completion, colour: what the commands have in common."""

import inspect
import json
import os
import pty
import re
import shlex
import subprocess
import sys
from types import SimpleNamespace
from typing import Any, get_type_hints

import pytest
from strips import COLUMNS
from typer.main import get_command

from deatwin.app import frequency_report, options
from deatwin.app import stories as app_stories
from deatwin.app.cli import app, main
from deatwin.app.options import fold_experiments
from deatwin.app.stories import stories
from deatwin.plant.effects import catalogue
from deatwin.studies.stories import Setting, Story

COMMANDS: dict[str, Any] = get_command(app).commands
PROGRAM = "import sys; from deatwin.app.cli import main; sys.exit(main())"
SHARED = {
    "quiet": options.Quiet,
    "as_json": options.Json,
    "jobs": options.Jobs,
    "seed": options.Seed,
    "allow_gaps": options.AllowGaps,
    "dt": options.SampleTime,
    "input_column": options.InputColumn,
    "output_column": options.OutputColumn,
    "time_column": options.TimeColumn,
}
COLOUR = re.compile(r"\x1b\[[0-9;]*(?:3[0-7]|9[0-7]|38;[0-9;]+)m")


def program(*arguments: str, **environment: str) -> list[str]:
    """Lines that a process prints."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    return done.stdout.splitlines()


def examples(command: Any) -> list[str]:
    """The lines of a command's help that begin with the program's name, behind a colon."""
    paragraphs = inspect.cleandoc(command.help).split("\n\n")
    return [found[1] for text in paragraphs if (found := re.search(r": (deatwin .*)", " ".join(text.split())))]


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_says_what_it_does_and_gives_an_example_that_parses(name):
    command = COMMANDS[name]
    assert re.match(r"[A-Z].*\.", command.help)
    assert examples(command)
    for line in examples(command):
        words = shlex.split(line)[1:]
        assert words[0] == name
        command.make_context(name, fold_experiments(words[1:]))  # raises where it does not parse


@pytest.mark.parametrize("name", COMMANDS)
def test_each_argument_and_option_says_what_it_is(name):
    for parameter in COMMANDS[name].params:
        assert parameter.name == "help" or re.search(r"\w.*\.$", parameter.help or ""), parameter.name


@pytest.mark.parametrize("shared", SHARED)
def test_a_shared_option_is_the_same_in_all_commands(shared):
    functions = [command.callback for command in app.registered_commands if command.callback]
    having = [function for function in functions if shared in inspect.signature(function).parameters]
    assert having
    assert all(get_type_hints(function, include_extras=True)[shared] == SHARED[shared] for function in having)
    assert len({inspect.signature(function).parameters[shared].default for function in having}) == 1


def test_every_command_can_be_silent_and_speak_to_machines():
    for name, command in COMMANDS.items():
        assert {"quiet", "as_json"} <= {p.name for p in command.params}, name


@pytest.fixture(scope="module")
def identified(bench):
    """A model beside the recordings."""
    files = [str(bench / "pulls.csv"), "--out", str(bench / "model.json")]
    assert main(["identify", *files, *COLUMNS, "--method", "frols", "--quiet"]) == 0


@pytest.fixture
def at_work(on_bench, identified, monkeypatch):
    """A folder with a rig, commands and a model, and one story that is told at once."""

    def run(setting: Setting) -> dict[str, Any]:
        setting.folder.text("table.csv", "a\n1\n")
        return {"sentence": "it is so", "seed": setting.seed, "jobs": setting.jobs}

    monkeypatch.setitem(sys.modules, "story_of_mine", SimpleNamespace(run=run))
    mine = Story(name="mine", line="told at once", minutes=0, module="story_of_mine")
    theirs = [SimpleNamespace(load=lambda: (mine,))]  # an entry point of somebody else's package
    monkeypatch.setattr(app_stories, "entry_points", lambda group: theirs)
    return on_bench


QUICK = [
    "simulate rig.toml first.csv --out out.csv",
    "identify pulls.csv --input-column stretch --output-column force_N --method frols --out narx.json",
    "frequency model.json --out response",
    "export model.json --to c --out model.c",
    "scenario mine --seed 7 --jobs 2 --out told",
    "scenarios",
    "doctor",
]  # the others take minutes; their tests are in test_diagnose, test_demo and test_check_command


@pytest.mark.parametrize("line", QUICK)
def test_quiet_says_nothing_and_json_is_one_document(line, at_work, capsys, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))  # other tests draw
    arguments = shlex.split(line)
    assert main([*arguments, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    for wanted in (["--json"], ["--quiet", "--json"]):
        assert main([*arguments, *wanted]) == 0
        out, error = capsys.readouterr()
        assert isinstance(json.loads(out), dict) and error == ""
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert said and not said.startswith("{")


def test_seed_and_jobs_reach_the_story(at_work, capsys):
    assert main(["scenario", "mine", "--seed", "7", "--jobs", "2", "--out", "told", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"sentence": "it is so", "seed": 7, "jobs": 2}
    assert main(["scenario", "mine", "--out", "told", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"sentence": "it is so", "seed": 0, "jobs": -1}


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("deatwin scenario ", set(stories())),
        ("deatwin demo --effect electrode_r", {"electrode_rc"}),
        ("deatwin demo --effect ", {effect.name for effect in catalogue()}),
        ("deatwin simulate rig.toml in.csv --effect cre", {"creep"}),
        ("deatwin scenario vhb4910 --size ", set()),
        ("deatwin scenario --size t", {"tiny"}),
        ("deatwin scenario concealed-physics --size ", {"tiny", "long", "standard", "full"}),
        ("deatwin identify --method s", {"svb", "semp"}),
        ("deatwin sce", {"scenario", "scenarios"}),
    ],
)
def test_bash_is_offered_names(typed, offered, capsys, monkeypatch):
    monkeypatch.setenv("_DEATWIN_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split()) - (not typed.endswith(" "))))
    assert main([]) == 0
    assert set(capsys.readouterr().out.split()) == offered


def test_zsh_is_offered_stories_with_their_lines():
    said = "\n".join(program(_DEATWIN_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="deatwin scenario vhb"))
    assert '"vhb4910":' in said and "finds the relaxation" in said


@pytest.mark.parametrize(("shell", "line"), [("bash", "complete -o default -F"), ("zsh", "compdef")])
def test_the_shell_gets_a_script(shell, line):
    lines = program("--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert any(text.startswith(line) for text in lines)
    assert "_DEATWIN_COMPLETE" in "\n".join(lines)


def on_a_terminal(**environment: str) -> str:
    """What the help looks like where a terminal reads it."""
    master, slave = pty.openpty()
    clean = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "check", "--help"],
        stdout=slave,
        stderr=slave,
        env={**clean, "TERM": "xterm-256color", **environment},
    )
    os.close(slave)
    shown = b""
    try:
        while part := os.read(master, 65536):
            shown += part
    except OSError:  # the terminal's other end is closed
        pass
    os.close(master)
    assert process.wait(timeout=60) == 0
    return shown.decode()


def test_colour_is_for_terminals_that_want_it():
    assert COLOUR.search(on_a_terminal())
    assert not COLOUR.search(on_a_terminal(NO_COLOR="1"))
    assert "\x1b" not in "\n".join(program("check", "--help"))
