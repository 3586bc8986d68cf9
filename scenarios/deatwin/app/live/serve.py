"""The server of the live view: one process, on the loopback address, until Ctrl-C."""

from __future__ import annotations

import errno
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deatwin.app.live.desk import MEGABYTE, inside
from deatwin.app.live.guard import LOOPBACK, Guard
from deatwin.app.live.jobs import Board
from deatwin.plant.errors import DataError, DeatwinError

SERVED = {
    ".html": "text/html; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".nc": "application/x-netcdf",
}
"""Endings of the result files that are served, and their media types."""
SANDBOX = "sandbox allow-scripts allow-downloads allow-popups"
"""Policy for reports, which may come from anyone and therefore run without the rights of the live view."""
PATIENCE = 2  # Seconds that open connections have when the server stops


def serve(
    root: Path,
    *,
    port: int = 0,
    upload_limit: float = 50.0,
    open_browser: bool = True,
    started: Callable[[str], None] = print,
) -> None:
    """Serve a folder until the process is asked to stop, then end the running jobs."""
    try:
        import uvicorn

        from deatwin.app.live.page import application
    except ImportError as error:
        raise DataError(
            f'the live view needs NiceGUI ({error.name} is missing): install it with pip install "nicegui>=3.18,<4"'
        ) from None
    board = Board(root)
    most_bytes = round(upload_limit * MEGABYTE)
    with _listening(port) as listener:
        taken = int(listener.getsockname()[1])
        key = secrets.token_urlsafe(24)
        app = application(board, most_bytes=most_bytes, send_file=_sender(root))
        guard = Guard(app, port=taken, key=key, most_bytes=most_bytes)
        server = uvicorn.Server(
            uvicorn.Config(
                guard, log_level="error", access_log=False, server_header=False, timeout_graceful_shutdown=PATIENCE
            )
        )
        address = f"http://{LOOPBACK}:{taken}/?key={key}"
        started(address)
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        _stop_cleanly(server)
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:  # the usual way to stop; the server has already closed its connections
            pass
        finally:
            board.close()


def _listening(port: int) -> socket.socket:
    """Open a socket that only this machine can reach."""
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise DataError(
                f"port {port}: another program uses this port; give another port, or 0 for any free port"
            ) from None
        raise DataError(
            f"port {port}: this port cannot be opened: {error.strerror}; give 0 for any free port"
        ) from None


def _stop_cleanly(server: Any) -> None:
    """End the jobs if the process is asked to stop or its terminal is closed."""
    if threading.current_thread() is not threading.main_thread():
        return

    def leave(number: int, _: object) -> None:  # uvicorn raises the signal again when it has stopped
        sys.exit(128 + number)

    def stop(*_: object) -> None:
        server.should_exit = True

    signal.signal(signal.SIGTERM, leave)
    if hasattr(signal, "SIGHUP"):  # absent on Windows
        signal.signal(signal.SIGHUP, stop)


def _sender(root: Path) -> Callable[[str], Any]:
    """Return the handler that sends a file of results."""
    from starlette.responses import FileResponse, PlainTextResponse

    def send(name: str) -> Any:
        try:
            path = inside(root, name)
        except DeatwinError as error:
            return PlainTextResponse(f"{error}\n", 403)
        kind = SERVED.get(path.suffix.lower())
        if kind is None or not path.is_file():
            return PlainTextResponse(f"{name}: there is no such file of results\n", 404)
        shown = path.suffix.lower() == ".html"
        return FileResponse(
            path,
            media_type=kind,
            filename=path.name,
            content_disposition_type="inline" if shown else "attachment",
            headers={"Content-Security-Policy": SANDBOX, "Cache-Control": "no-store"},
        )

    return send
