"""The server of the live view: one process, on the loopback address, until Ctrl-C."""

from __future__ import annotations

import errno
import hmac
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from deatwin.app.live.desk import MEGABYTE, inside
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


LOOPBACK = "127.0.0.1"
HOSTS = (LOOPBACK, "localhost")
ENVELOPE = 100_000  # Most bytes of a form beside the file in it

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
_Headers = defaultdict[str, list[str]]  # All values of each request header


class Guard:
    """An ASGI application that forwards only permitted requests to another one."""

    def __init__(self, app: App, *, port: int, key: str, most_bytes: int) -> None:
        self.app = app
        self.key = key
        self.most_bytes = most_bytes + ENVELOPE
        self.cookie = f"deatwin-{port}"  # browsers send cookies to all ports of a host
        self.hosts = {host if port == 80 else f"{host}:{port}" for host in HOSTS}
        self.origins = {f"http://{host}" for host in self.hosts}
        self.policy = _policy(self.hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse the request, or forward it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers: _Headers = defaultdict(list)
        for name, value in scope["headers"]:
            headers[name.lower().decode("latin-1")].append(value.decode("latin-1"))
        status, reason = self._refusal(scope, headers)
        if status:
            await _refuse(scope, send, status, reason)
        elif self._brings_key(scope):
            cookie = f"{self.cookie}={self.key}; Path=/; HttpOnly; SameSite=Lax"
            await _answer(send, 303, [(b"location", b"/"), (b"set-cookie", cookie.encode())], b"")
        elif not self._knows_key(headers):
            await _refuse(scope, send, 403, "open the address that deatwin view printed: it contains the key")
        else:
            await self.app(scope, receive, self._with_policy(send))

    def _refusal(self, scope: Scope, headers: _Headers) -> tuple[int, str]:
        """Return status and reason for refusing a request; status 0 if it is permitted."""
        if headers["host"] not in [[host] for host in self.hosts]:
            return 421, "this server only answers requests to its loopback address (127.0.0.1)"
        if any(origin not in self.origins for origin in headers["origin"]):
            return 403, "requests from pages of other sites are refused"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            length = headers["content-length"]
            if headers["transfer-encoding"] or len(length) != 1 or not length[0].isdecimal():
                return 411, "the request must state its length (Content-Length)"
            if int(length[0][:20]) > self.most_bytes:
                return 413, "the file is too large"
        return 0, ""

    def _brings_key(self, scope: Scope) -> bool:
        if scope["type"] != "http" or scope["path"] != "/":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("key", [""])[0]
        return self._is_key(given)

    def _knows_key(self, headers: _Headers) -> bool:
        for text in headers["cookie"]:
            try:
                held = SimpleCookie(text).get(self.cookie)
            except CookieError:
                continue
            if held is not None and self._is_key(held.value):
                return True
        return False

    def _is_key(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.key.encode())

    def _with_policy(self, send: Send) -> Send:
        """Add a content policy to answers of the other application that set none."""

        async def sending(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                set_already = {name.lower() for name, _ in message.get("headers", [])}
                added = [(name, value) for name, value in self.policy if name not in set_already]
                message = {**message, "headers": [*message.get("headers", []), *added]}
            await send(message)

        return sending


def _policy(hosts: Iterable[str]) -> list[tuple[bytes, bytes]]:
    sockets = " ".join(f"ws://{host}" for host in sorted(hosts))
    content = (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' {sockets}; "
        "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    )
    return [
        (b"content-security-policy", content.encode()),
        (b"x-content-type-options", b"nosniff"),
        (b"referrer-policy", b"no-referrer"),
        (b"cross-origin-resource-policy", b"same-origin"),
    ]


async def _refuse(scope: Scope, send: Send, status: int, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": reason})
    else:
        await _answer(send, status, [(b"content-type", b"text/plain; charset=utf-8")], f"{reason}\n".encode())


async def _answer(send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes) -> None:
    headers = [*headers, (b"content-length", str(len(body)).encode()), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
