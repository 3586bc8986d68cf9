"""How a command tells how far it is: a bar on a terminal, plain lines elsewhere, nothing when it is quiet."""

import io
import re
import signal
import sys
import threading
import time
from contextlib import suppress

import pytest

from deatwin.plant.interrupts import obey
from deatwin.studies import voice
from deatwin.studies.interrupts import ORDINARY, forward_signals
from deatwin.studies.voice import PlainProgress, Voice, print_lines


class Clock:
    """Time that passes when somebody waits; the work ends at the last call."""

    def __init__(self, waits: int) -> None:
        self.now, self.waits = 1000.0, waits

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> bool:
        self.now += seconds
        self.waits -= 1
        return self.waits < 0


def test_a_line_comes_every_half_minute(capsys):
    clock = Clock(waits=3)
    progress = PlainProgress("reading", clock)
    progress.tell(0.0, "calibrating the model")
    told: list[float] = []

    def wait(seconds: float) -> bool:
        told.append(seconds)
        ended = clock.wait(seconds)
        progress.tell((0.2, 0.25, 0.6, 1.0)[len(told) - 1], "calibrating the model")
        return ended

    print_lines(progress, wait)
    out, err = capsys.readouterr()
    assert out == ""
    assert told == [30.0] * 4  # the last one was ended
    # A fifth in 30 s: the rest takes 4 times as long; a quarter in 60 s: 3 times, of which a quarter more than before
    # is told, as the least; 0.6 in 90 s: 2/3 of it.
    assert err.splitlines() == [
        "calibrating the model, 20 % done, about 2 min left",
        "calibrating the model, 25 % done, at least 2 min left",
        "calibrating the model, 60 % done, about 60 s left",
    ]


def test_the_time_left_grows_by_a_quarter_at_most_while_nothing_is_told():
    clock = Clock(waits=0)
    progress = PlainProgress("reading", clock)
    progress.tell(0.0, "fitting")
    clock.now += 10.0
    progress.tell(0.5, "fitting")
    assert progress.line == "fitting, 50 % done, about 10 s left"
    clock.now += 30.0  # at this pace 40 s
    assert progress.line == "fitting, 50 % done, at least 12 s left"
    clock.now += 30.0
    assert progress.line == "fitting, 50 % done, at least 16 s left"


@pytest.mark.parametrize(
    ("begun", "seconds", "told", "line"),
    [
        ((0.8, "cases"), 60.0, (0.9, "cases"), "cases, 90 % done, about 60 s left"),  # a tenth a minute, continued
        ((0.0, "cases"), 360.0, (0.01, "cases"), "cases, 1 % done, about 10 h left"),  # a hundredth in 6 min: 9.9 h
        ((0.0,), 60.0, (1.0, "done"), "done, 100 % done"),
        ((0.0,), 100.0, (0.5, "5 of 10, about 7 min left"), "5 of 10, about 7 min left, 50 % done"),  # told by the work
    ],
)
def test_the_time_left_is_judged_by_what_this_run_did(begun, seconds, told, line):
    clock = Clock(waits=0)
    progress = PlainProgress("study", clock)
    progress.tell(*begun)
    clock.now += seconds
    progress.tell(*told)
    assert progress.line == line


def test_no_time_is_guessed_from_nothing():
    clock = Clock(waits=0)
    progress = PlainProgress("reading", clock)
    assert progress.line == "reading, 0 % done, unknown time left"
    progress.tell(0.0, "checking the recordings")
    clock.now += 100.0
    progress.tell(0.02, "calibrating")
    assert progress.line == "calibrating, 2 % done, unknown time left"


def test_control_characters_do_not_pass():
    progress = PlainProgress("one\ntwo")
    progress.tell(0.0, "a\x1b[2Kb\r\nc\x07")
    assert progress.line.startswith("a [2Kb c, 0 % done")
    assert progress.line.isprintable()


@pytest.mark.parametrize("as_json", [False, True])
def test_off_a_terminal_lines_go_to_stderr_while_the_work_runs(as_json, monkeypatch, capsys):
    monkeypatch.setattr(voice, "EVERY", 0.01)
    with Voice(as_json=as_json).progress("reading") as tell:
        tell(0.25, "fitting")
        lines = seen(capsys)
    out, err = capsys.readouterr()
    assert out == ""
    for line in (lines + err).splitlines():
        assert re.fullmatch(r"(reading, 0|fitting, 25) % done, unknown time left", line)
    time.sleep(0.05)
    assert capsys.readouterr().err == ""  # with the work the lines end


def seen(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said on stderr as soon as a line of the work is there."""
    text, end = "", time.monotonic() + 10
    while "fitting" not in text and time.monotonic() < end:
        time.sleep(0.01)
        text += capsys.readouterr().err
    assert "fitting" in text
    return text


def test_a_quiet_command_says_nothing(monkeypatch, capsys):
    monkeypatch.setattr(voice, "EVERY", 0.01)
    with Voice(quiet=True).progress("reading") as tell:
        tell(0.25, "fitting")
        time.sleep(0.05)
    assert capsys.readouterr() == ("", "")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_there_is_a_bar_and_no_line(monkeypatch):
    monkeypatch.setattr(voice, "EVERY", 0.01)
    monkeypatch.setenv("TERM", "xterm")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Voice().progress("reading") as tell:
        tell(0.25, "fitting")
        time.sleep(0.05)
    assert "25%" in terminal.getvalue() and "fitting" in terminal.getvalue()
    assert "% done" not in terminal.getvalue()


def test_lines_that_nobody_takes_do_not_end_the_work(monkeypatch):
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    print_lines(PlainProgress("reading"), Clock(waits=2).wait)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("quiet", [True, False])
def test_an_interrupt_that_was_dropped_ends_the_work_at_its_next_word(quiet, number, heard):
    with forward_signals(*ORDINARY), Voice(quiet=quiet).progress("work") as tell:
        tell(0.1, "solving")
        with suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            tell(0.2, "solved")
    with forward_signals(*ORDINARY), Voice(quiet=quiet).progress("more work") as tell:
        tell(0.1, "solving")  # what ended one command does not end the next
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


class Finalised:
    """An interrupt comes while it is taken away, where Python can only print it."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_that_a_callback_swallows_is_obeyed_and_not_printed(heard):
    hook, printed = sys.unraisablehook, []
    sys.unraisablehook = printed.append
    try:
        with pytest.raises(KeyboardInterrupt), forward_signals(*ORDINARY):
            Finalised()
            obey()
        assert printed == []
    finally:
        sys.unraisablehook = hook


def test_errors_of_threads_are_printed_but_not_of_those_that_an_interrupt_leaves(monkeypatch, heard):
    printed = []
    monkeypatch.setattr(threading, "excepthook", printed.append)
    asked, workers_gone = threading.Event(), threading.Event()

    def fail(*late):
        thread = threading.Thread(target=lambda: [event.wait() for event in late].index(None))  # it is not in the list
        thread.start()
        return thread

    with pytest.raises(KeyboardInterrupt), forward_signals(*ORDINARY):
        fail().join()
        assert [told.exc_type for told in printed] == [ValueError]
        during, later = fail(asked), fail(workers_gone)  # as threads that send jobs to workers
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            asked.set()
            during.join()
    workers_gone.set()
    later.join()
    assert len(printed) == 1
    fail().join()  # as in a notebook, which goes on
    assert len(printed) == 2


def test_what_casadi_makes_of_an_interrupt_is_one_only_where_one_was_asked_for(heard):

    def asked_and(error: Exception) -> None:
        with forward_signals():
            with suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            raise error

    with pytest.raises(KeyboardInterrupt):
        asked_and(SystemError("DM.__array__ returned a result with an exception set"))
    with pytest.raises(OSError, match="disk is full"):  # what became of the work is told nevertheless
        asked_and(OSError("the disk is full"))
    with pytest.raises(SystemError, match="of its own"), forward_signals():
        raise SystemError("of its own")


def test_a_batch_system_is_heard_where_ctrl_c_is_ignored(heard):
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as of what a shell runs in the background
    with forward_signals(*ORDINARY), Voice().progress("work") as tell:
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            tell(0.1, "solved")


def test_a_worker_leaves_what_kills_it_alone():
    with forward_signals():
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_where_interrupts_are_ignored_they_stay_so(number):
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with forward_signals(*ORDINARY), Voice().progress("work") as tell:
            signal.raise_signal(number)
            tell(0.1, "solving")
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)
