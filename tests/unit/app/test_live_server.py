"""The live view's server without a browser: whom it answers, and the command that starts it."""

import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
from http.client import HTTPConnection
from typing import Any

import pytest

from deatwin.app.cli import main
from deatwin.app.live.serve import Guard

pytestmark = pytest.mark.extras

# Who may ask


def ask(kind: str = "http", method: str = "GET", query: str = "", path: str = "/", **headers: str) -> tuple[int, str]:
    """Status and text of what a guard answers; 200 where it lets the request pass."""
    said: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        said.append(message)

    async def receive() -> Any:
        return {}

    sent = {"host": "127.0.0.1:8000", "cookie": "deatwin-8000=secret", **headers}
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.replace("_", "-").encode(), text.encode()) for name, text in sent.items() if text],
    }
    guard = Guard(app, port=8000, key="secret", most_bytes=1000)
    asyncio.run(guard(scope, receive, send))
    first = said[0]
    if first["type"] == "websocket.close":
        return first["code"], first["reason"]
    return first["status"], str(dict(first["headers"])) + str(said[1:])


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_browser_here_that_has_the_key_is_answered(kind, host):
    status, text = ask(kind, host=host, origin=f"http://{host}")
    assert status == 200 and "default-src 'self'" in text and "frame-ancestors 'none'" in text


@pytest.mark.parametrize("host", ["evil.example:8000", "127.0.0.1:8001", "127.0.0.1", "localhost.evil.org:8000", ""])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_another_host_is_refused_also_with_the_key(kind, host):
    assert ask(kind, host=host)[0] == (421 if kind == "http" else 1008)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:8001", "https://127.0.0.1:8000"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_another_origin_is_refused_also_with_the_key(kind, origin):
    assert ask(kind, origin=origin)[0] == (403 if kind == "http" else 1008)


@pytest.mark.parametrize("cookie", ["", "deatwin-8000=wrong", "deatwin-8001=secret", "deatwin-8000=", "\x01;;=\xfc"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_the_key_nothing_is_shown(kind, cookie):
    assert ask(kind, cookie=cookie)[0] == (403 if kind == "http" else 1008)


def test_the_key_in_the_address_becomes_a_cookie():
    status, text = ask(query="key=secret", cookie="")
    assert status == 303 and "deatwin-8000=secret; Path=/; HttpOnly; SameSite=Lax" in text
    assert ask(query="key=wrong", cookie="")[0] == 403
    assert ask("websocket", query="key=secret", cookie="")[0] == 1008


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"content_length": "900"}, 200),
        ({"content_length": "200000"}, 413),
        ({"content_length": "9" * 30}, 413),
        ({}, 411),
        ({"content_length": "-1"}, 411),
        ({"content_length": "10", "transfer_encoding": "chunked"}, 411),
    ],
)
def test_no_more_is_taken_than_the_limit(headers, status):
    assert ask(method="POST", **headers)[0] == status


# The command


@pytest.fixture
def server(root):
    """The command in a process of its own, and what it printed."""
    pytest.importorskip("nicegui", reason="the live view needs the extra `view`")
    code = "import sys; from deatwin.app.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["view", str(root), "--no-browser", "--json", "--upload-limit", "1"]
    process = subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True)
    try:
        text = ""
        while not text.endswith("}\n"):
            line = process.stdout.readline()
            assert line, "it ended"
            text += line
        yield process, json.loads(text)
    finally:
        process.kill()
        process.communicate()


def test_the_server_answers_here_only_and_ends_with_ctrl_c(server, root):
    process, printed = server
    port = int(re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?key=\S{32}", printed["address"])[1])
    (root / "report.html").write_text("<p>found</p>", encoding="utf-8")

    def get(path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> tuple[int, Any, str]:
        connection = HTTPConnection("127.0.0.1", port, timeout=30)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read().decode()

    assert get("/", Host="evil.example")[0] == 421
    assert get("/")[0] == 403
    status, headers, _ = get(printed["address"].partition(f":{port}")[2])
    assert status == 303
    cookie = {"Cookie": headers["Set-Cookie"].partition(";")[0]}
    status, headers, page = get("/", **cookie)
    assert status == 200 and "connect-src 'self'" in headers["Content-Security-Policy"]
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", page)
    assert get("/", Origin="http://evil.example", **cookie)[0] == 403
    declared = {"Content-Length": "2000000", **cookie}  # refused before any of it is sent
    assert get("/_nicegui/client/x/upload/1", "POST", None, **declared)[0] == 413
    status, headers, text = get("/results/report.html", **cookie)
    assert (status, text) == (200, "<p>found</p>") and headers["Content-Security-Policy"].startswith("sandbox ")
    assert get("/results/rig.toml", **cookie)[0] == 404
    assert get("/results/..%2Fsecret.csv", **cookie)[0] == 403
    with pytest.raises(ConnectionRefusedError):  # another address of this machine
        socket.create_connection(("127.0.0.2", port), timeout=5)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 0


def test_a_port_that_is_taken_is_said(root, capsys):
    pytest.importorskip("nicegui", reason="the live view needs the extra `view`")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["view", str(root), "--no-browser", "--port", str(port)]) == 1
    said = capsys.readouterr().err
    assert said == f"error: port {port}: another program uses this port; give another port, or 0 for any free port\n"
