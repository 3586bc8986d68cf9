"""Who may ask the live view: a browser on this machine, at the page's own address, with the key of this run.

Pages of other sites in a browser here can reach the loopback address (DNS rebinding, requests across sites,
WebSockets), and so can other users of the machine. Hence host, origin and key of each request are checked.
"""

from __future__ import annotations

import hmac
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

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
