# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The web server in this process: admission, and no waiting for slow viewers."""

import asyncio
import json
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from typing import Any

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from rover_parameters.records import ConfigError
from terrain_estimator.config.dashboard import ShownConfig
from terrain_estimator.dashboard.model import Cursor, LiveModel
from terrain_estimator.dashboard.web import VIEWERS, WebServer, cursor_of, is_own_name

RATE_HZ = 50.0
LENGTH = 8_000_000
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "x",
}


class Long(LiveModel):
    """A model with an answer to a certain cursor that no socket can buffer."""

    def update(self, cursor: Cursor, now_s: float) -> str:
        return json.dumps("x" * LENGTH) if cursor.recent == 7 else super().update(cursor, now_s)


def served(
    check: Callable[[WebServer], Awaitable[None]],
    kind: type[LiveModel] = LiveModel,
    rate_hz: float = RATE_HZ,
) -> int:
    """Run a check next to a server with ever-changing data; return the number of its updates."""

    async def both() -> int:
        model, stop = kind("one", ShownConfig()), threading.Event()
        server = WebServer(model, "127.0.0.1", 0)

        def take() -> None:
            model.revision += 1

        serving = asyncio.create_task(server.serve(stop, rate_hz, take))
        try:
            await check(server)
        finally:
            stop.set()
            await serving
        return model.revision

    return asyncio.run(both())


async def viewer(server: WebServer) -> WebSocketClientConnection:
    return await websocket_connect(server.url.replace("http", "ws") + "live")


def test_the_page_names_no_other_place_and_every_answer_forbids_to_fetch_from_one() -> None:
    async def check(server: WebServer) -> None:
        client = AsyncHTTPClient()
        for path in ("", "dashboard.js", "Chart.bundle.js", "style.css", "nowhere"):
            answer = await client.fetch(server.url + path, raise_error=False)
            assert answer.code == (404 if path == "nowhere" else 200)
            assert answer.headers["Content-Security-Policy"].startswith("default-src 'self'; ")
            assert "unsafe" not in answer.headers["Content-Security-Policy"]
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
            if path != "Chart.bundle.js":  # its comments name the homes of its parts
                assert b"//" not in answer.body.replace(b"// ", b"").replace(
                    b"://${location.host}", b""
                )

    served(check)


def test_foreign_names_and_foreign_pages_are_refused() -> None:
    async def check(server: WebServer) -> None:
        for path, headers in (
            ("", {"Host": "evil.example"}),
            ("live", {"Host": "evil.example"}),
            ("live", {"Origin": "http://evil.example"}),
        ):
            with pytest.raises(HTTPClientError, match="403"):
                await AsyncHTTPClient().fetch(
                    HTTPRequest(server.url + path, headers=UPGRADE | headers)
                )

    served(check)
    assert all(
        is_own_name(name)
        for name in (
            "127.0.0.1",
            "::1",
            "192.168.1.20",
            "localhost",
            "LOCALHOST",
            socket.gethostname(),
        )
    )
    assert not any(
        is_own_name(name)
        for name in ("evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "")
    )


def test_what_is_no_cursor_asks_for_everything() -> None:
    mine = Cursor("here", 1, 2, 3)
    assert cursor_of(json.dumps(asdict(mine))) == mine
    for wrong in (
        b"\xff",
        "",
        "[]",
        "7",
        '{"recent": "1"}',
        '{"recent": true}',
        '{"unknown": 1}',
        '{"of": null}',
    ):
        assert cursor_of(wrong) == Cursor()


def deaf_viewer(server: WebServer) -> socket.socket:
    """Connect by the protocol and never read."""
    address = ("127.0.0.1", int(server.url.rstrip("/").rpartition(":")[2]))
    deaf = socket.create_connection(address)
    lines = [
        "GET /live HTTP/1.1",
        "Host: localhost",
        *(f"{name}: {value}" for name, value in UPGRADE.items()),
        "",
        "",
    ]
    deaf.sendall("\r\n".join(lines).encode())
    return deaf


def frame(text: str) -> bytes:
    """Return a short text as a WebSocket frame, masked with zeros."""
    return bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text.encode()


def waiting_bytes(one: Any) -> int:
    return len(one.ws_connection.stream._write_buffer)


def test_a_viewer_that_reads_nothing_gets_one_answer_and_slows_nobody() -> None:
    async def check(server: WebServer) -> None:
        with deaf_viewer(server) as deaf:
            quick = await viewer(server)
            delays = []
            for _ in range(20):
                deaf.sendall(frame(json.dumps(asdict(Cursor("mine", 7)))))
                asked = time.monotonic()
                await quick.write_message("{}")
                assert json.loads(await quick.read_message() or "")["recent"] == []
                delays.append(time.monotonic() - asked)
            waiting = sum(waiting_bytes(one) for one in server.viewers.open)
            assert 0 < waiting <= LENGTH + 100, "one answer, not twenty"
            assert sorted(delays)[10] < 10.0 / RATE_HZ
            quick.close()

    served(check, Long)


def test_it_takes_and_answers_at_its_rate() -> None:
    async def check(_: WebServer) -> None:
        await asyncio.sleep(0.4)

    often, seldom = (served(check, rate_hz=rate) for rate in (50.0, 5.0))
    assert often > 2 * seldom


def test_there_is_a_limit_to_viewers() -> None:
    async def check(server: WebServer) -> None:
        crowd = [await viewer(server) for _ in range(VIEWERS + 1)]
        assert await crowd[-1].read_message() is None
        assert crowd[-1].close_code == 1013
        assert len(server.viewers.open) == VIEWERS
        for each in crowd:
            each.close()

    served(check)


def test_a_taken_port_and_an_address_of_another_machine_are_named() -> None:
    async def listen(address: str, port: int) -> None:
        WebServer(LiveModel("one", ShownConfig()), address, port)

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(
            ConfigError, match=rf"port {port} of 127\.0\.0\.1 is taken.*-p port:={port + 1}"
        ):
            asyncio.run(listen("127.0.0.1", port))
    with pytest.raises(ConfigError, match=r"parameter address: cannot listen on '192\.0\.2\.1'"):
        asyncio.run(listen("192.0.2.1", 0))
