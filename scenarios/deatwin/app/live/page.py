"""The page of the live view, in NiceGUI; the modules beside do the work.

NiceGUI needs no front end of our own, has no telemetry, and brings all scripts and fonts in its wheel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from nicegui import run, ui

from deatwin.app.live.desk import MEGABYTE, UPLOADS, Desk, free_name, keep_upload
from deatwin.app.live.glance import Glance, glance
from deatwin.app.live.jobs import Board, Job, Order, State
from deatwin.app.live.verdicts import MOST, Verdict, compare
from deatwin.plant.errors import DeatwinError
from deatwin.plant.readoptions import ReadOptions

REFRESH = 0.5  # Seconds between two updates of the jobs
INVITATION = """
<div class="invite">
  <label class="relative-position">Drop recordings or a rig file (TOML) here, up to %s MB
    <q-uploader-add-trigger /></label>
  <q-btn flat dense no-caps color="primary" label="Choose files" @click="props.pickFiles" />
</div>
"""
"""Replaces Quasar's own header, whose button has no name for users who cannot see it."""
SHOWN = 3  # Most results that are compared when the page opens


def application(board: Board, *, most_bytes: int, send_file: Callable[[str], Any]) -> FastAPI:
    """Build the page and the application that serves it."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.get("/results/{name:path}")(send_file)

    @ui.page("/", title=f"{board.root.name} – deatwin", language="en-US", dark=None)
    async def page() -> None:
        ui.add_css(_style())
        View(board, most_bytes)

    ui.run_with(app, tailwind=False, show_welcome_message=False, reconnect_timeout=10.0)
    return app


class View:
    """One browser tab: its choices, the jobs of all tabs, and a comparison."""

    def __init__(self, board: Board, most_bytes: int) -> None:
        self.board = board
        self.most_bytes = most_bytes
        self.cards: dict[Job, JobCard] = {}
        self.glance: Glance | None = None
        with ui.element("header").classes("top"):
            ui.html("<h1>deatwin live view</h1>", sanitize=False)
            ui.label(str(board.root)).classes("quiet path")
        with ui.element("main").classes("page"):
            with ui.element("div").classes("two"):
                with _section("Recordings and rig"):
                    self._build_form()
                with ui.element("div").classes("stack"):
                    with _section("Running and done"):
                        self.idle = ui.label("No command is running.").classes("quiet")
                        self.jobs = ui.element("div").classes("jobs").props('aria-live="polite"')
                    with _section("What is in the recording"):
                        self.seen = ui.html("Choose or drop a recording to see it.", sanitize=False).classes("full")
            with _section("Verdicts side by side"):
                self._build_comparison()
        self.look()
        self.compared.set_value(self.compared.options[:SHOWN])
        self.watch()
        ui.timer(REFRESH, self.watch)

    def _build_form(self) -> None:
        megabytes = self.most_bytes / MEGABYTE
        self.upload = (
            ui.upload(
                multiple=True,
                auto_upload=True,
                max_file_size=self.most_bytes,
                on_upload=self.take,
                on_rejected=lambda: self.complain(
                    f"this file was refused: it is larger than {megabytes:g} MB (--upload-limit), or its name ends in none of {', '.join(UPLOADS)}"
                ),
            )
            .props(f'accept="{",".join(UPLOADS)}" flat color="transparent" text-color="inherit"')
            .classes("drop")
        )
        self.upload.add_slot("header", INVITATION % f"{megabytes:g}")
        self.recordings = _choice("Recordings of one experiment", multiple=True)
        self.recordings.on_value_change(self.show)
        self.rig = _choice("Rig file or calibrated model")
        self.rig.on_value_change(self.show)
        self.out = _field(ui.input("Name for the results"))
        with ui.expansion("Columns, clock, units", value=False).props("dense").classes("full") as self.details:
            fields = ui.element("div").classes("fields")
        with fields:
            self.columns = {
                role: _field(ui.input(label, autocomplete=[]))
                for role, label in (
                    ("input_column", "Input, if not command_V"),
                    ("output_column", "Output, if not displacement_mm"),
                    ("time_column", "Times, if not time_s"),
                )
            }
            self.units = {
                role: _field(ui.input(label))
                for role, label in (
                    ("input_column", "Unit of the input, if not stated"),
                    ("output_column", "Unit of the output, if not stated"),
                )
            }
            self.clock = {
                name: _field(ui.number(label, min=0))
                for name, label in (
                    ("dt", "Sample time (s), without times"),
                    ("resample", "Resample to (s), if uneven"),
                )
            }
            self.allow_gaps = ui.checkbox("Accept gaps, and split the recording there")
            self.seed = _field(ui.number("Seed", value=0, min=0, precision=0))
            ui.button("Read again", on_click=self.show).props("flat dense no-caps")
        self.fault = ui.label().classes("fault").props('role="alert"')
        self.fault.set_visibility(False)
        with ui.row():
            ui.button("Diagnose", on_click=self.diagnose).props("unelevated no-caps")
            ui.button("Plan an experiment", on_click=self.plan).props("outline no-caps")
            ui.button("Read the folder again", on_click=self.look).props("flat no-caps")

    def _build_comparison(self) -> None:
        self.compared = _choice(f"Results, up to {MOST}", multiple=True)
        self.compared.on_value_change(self.lay_out)
        self.table = ui.html("", sanitize=False).classes("full")

    def complain(self, text: str) -> None:
        """Show an error; an empty text removes it."""
        self.fault.set_text(text)
        self.fault.set_visibility(bool(text))

    def look(self) -> None:
        """List the folder, and keep choices that still exist."""
        desk = Desk.look(self.board.root)
        for choice, names in ((self.recordings, desk.recordings), (self.compared, desk.results)):
            choice.set_options(list(names), value=[name for name in choice.value or [] if name in names])
        rigs = list(desk.rigs)
        self.rig.set_options(rigs, value=self.rig.value if self.rig.value in rigs else None)
        if not self.out.value:
            self.out.set_value(free_name(self.board.root))
        if not desk.whole:
            self.complain("the folder holds too many files, so these lists are incomplete; choose a smaller folder")

    async def take(self, event: Any) -> None:
        """Save a file that was dropped on the page."""
        self.upload.reset()  # so that the same file can be dropped again
        try:
            content = await event.file.read()
            name = await run.io_bound(
                keep_upload, self.board.root, event.file.name, content, most_bytes=self.most_bytes, asked=self.asked()
            )
        except (DeatwinError, OSError) as error:
            self.complain(_told(error))
            return
        self.complain("")
        self.look()
        if str(name).lower().endswith(".toml"):
            self.rig.set_value(name)
        else:
            self.recordings.set_value([*self.recordings.value, name])  # which also shows it

    def asked(self) -> ReadOptions:
        """Return the reading options entered in the fields."""
        named = {role: field.value or None for role, field in self.columns.items()}
        for role, field in self.units.items():
            column = named[role] or self._place(role)
            if field.value and column:
                named[role] = f"{column}={field.value}"
        clock: dict[str, Any] = {
            name: float(field.value) if field.value else None for name, field in self.clock.items()
        }
        return ReadOptions(**named, **clock, allow_gaps=bool(self.allow_gaps.value))

    def _place(self, role: str) -> str | None:
        """Return the position of the column that was last read in a role."""
        columns = () if self.glance is None else self.glance.columns
        return next((f"#{c.place}" for c in columns if f"{c.role}_column" == role), None)

    async def show(self) -> None:
        """Describe the recording chosen last, and ask for what it does not say."""
        name = (self.recordings.value or [None])[-1]
        if name is None:
            return
        try:
            found = await run.io_bound(glance, self.board.root, name, self.asked(), self.rig.value or "")
        except (DeatwinError, OSError) as error:
            self.seen.set_content("")
            self.complain(_told(error))
            return
        if found is None:  # the page is being closed
            return
        self.glance = found
        headers = [column.header for column in found.columns]
        for role, field in self.columns.items():
            field.set_autocomplete(headers)
            if column := getattr(found.further, role):
                field.set_value(column)
        for option, number in self.clock.items():
            if value := getattr(found.further, option):
                number.set_value(value)
        self.allow_gaps.set_value(self.allow_gaps.value or found.further.allow_gaps)
        if found.refused:
            self.details.open()
        self.seen.set_content(f"<p><strong>{escape(name)}</strong></p>{found.html()}")

    def diagnose(self) -> None:
        """Start the chosen diagnosis."""
        self.start("diagnose", self.recordings.value or ())

    def plan(self) -> None:
        """Start a plan with the commands of the first chosen recording, or for a suggested input."""
        self.start("plan", (self.recordings.value or ())[:1])

    def start(self, command: str, recordings: Sequence[str]) -> None:
        """Start a job."""
        try:
            self.board.start(
                Order(
                    command=command,
                    rig=self.rig.value or "",
                    recordings=tuple(recordings),
                    out=self.out.value.strip(),
                    reading=self.asked(),
                    seed=int(self.seed.value or 0),
                )
            )
        except (DeatwinError, OSError) as error:
            self.complain(_told(error))
            return
        self.complain("")
        self.out.set_value(free_name(self.board.root))
        self.watch()

    def watch(self) -> None:
        """Update the cards of the jobs."""
        for job in reversed(self.board.jobs):
            if job not in self.cards:
                with self.jobs:
                    self.cards[job] = JobCard(job)
                self.cards[job].box.move(target_index=0)
        self.idle.set_visibility(not self.cards)
        if any([card.update() for card in self.cards.values()]):
            self.look()
            done = [job.order.out for job in self.board.jobs if job.state is State.DONE]
            fresh = [name for name in done if name in self.compared.options and name not in self.compared.value]
            self.compared.set_value([*self.compared.value, *fresh][-MOST:])

    async def lay_out(self) -> None:
        """Draw the comparison."""
        chosen = list(self.compared.value or [])[:MOST]
        content = await run.io_bound(_compared, self.board.root, chosen) if chosen else ""
        self.table.set_content(content or "")


class JobCard:
    """The card that shows one job."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._last: State | None = None
        with ui.element("article").classes("job") as self.box:
            with ui.row().classes("head"):
                ui.label(job.order.out).classes("name")
                self.state = ui.label().classes("verdict")
            ui.label(", ".join(job.order.files)).classes("quiet")
            self.bar = ui.linear_progress(0.0, show_value=False).props(f'aria-label="progress of {job.order.out}"')
            self.text = ui.label()
            self.steps = ui.label().classes("quiet steps")
            with ui.row():
                self.stop = ui.button("Cancel", on_click=job.cancel).props("flat dense no-caps")
                self.report = ui.link("Open the report", f"results/{job.order.out}/report.html", new_tab=True)

    def update(self) -> bool:
        """Show the state of the job; return whether it has just ended."""
        job, state = self.job, self.job.state
        self.bar.set_value(round(job.share, 3))
        self.text.set_text(job.sentence if state is not State.RUNNING else _on_its_way(job))
        self.steps.set_text(", ".join(f"{step} (since {at:.0f} s)" for step, at in job.steps))
        if state is self._last:
            return False
        ended = self._last is State.RUNNING
        self._last = state
        self.state.set_text(state.value)
        tone = {State.DONE: "good", State.FAILED: "bad"}.get(state, "doubt")
        self.state.classes(remove="good doubt bad", add=tone)
        self.stop.set_visibility(state is State.RUNNING)
        self.report.set_visibility(state is State.DONE)
        return ended


def _on_its_way(job: Job) -> str:
    step = job.steps[-1][0] if job.steps else "starting"
    left = "" if job.seconds_left is None else f", about {job.seconds_left:.0f} s left"
    return f"{step}: {100 * job.share:.0f} % after {job.seconds:.0f} s{left}"


def _compared(root: Path, names: list[str]) -> str:
    return compare([Verdict.read(root, name) for name in names]).html()


def _told(error: Exception) -> str:
    """Write one line for a reader, as on the command line."""
    text = f"{error.filename or 'the system'}: {error.strerror or error}" if isinstance(error, OSError) else str(error)
    return " ".join(text.split())


def _choice(label: str, *, multiple: bool = False) -> Any:
    """Make a list of names with a search field."""
    chosen: Any = [] if multiple else None
    choice = _field(ui.select([], label=label, value=chosen, multiple=multiple, with_input=True))
    return choice.props("options-dense" + (" use-chips" if multiple else ""))


def _field(element: Any) -> Any:
    return element.props("outlined dense").classes("full")


def _section(title: str) -> Any:
    section = ui.element("section").classes("card").props(f'aria-label="{title}"')
    with section:
        ui.html(f"<h2>{title}</h2>", sanitize=False)
    return section


def _style() -> str:
    """Return the style of the page, in the colours of the report."""
    from deatwin.studies.report.drawing import COLOURS
    from deatwin.studies.report.rendering import templates

    return templates("deatwin.app.live").get_template("view.css.j2").render(colours=COLOURS)
