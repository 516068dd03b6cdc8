# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the web server: bodies, ages and numbers of connections, questions, log lines."""

import asyncio
import logging
import socket
import time

import pytest
from tornado.httpclient import AsyncHTTPClient
from tornado.iostream import IOStream

from terrain_estimator.dashboard import web
from terrain_estimator.dashboard.connections import Connections
from terrain_estimator.dashboard.log_limit import LENGTH, LINES, PERIOD_S, LimitedLog, limited_log
from terrain_estimator.dashboard.model import Cursor
from terrain_estimator.dashboard.web import VIEWERS, WebServer, cursor_of
from tests.terrain_estimator.dashboard.test_web import deaf_viewer, frame, served, viewer

HEAD = "POST / HTTP/1.1\r\nHost: localhost\r\n"


async def ends(connection: socket.socket, within_s: float) -> bool:
    """Return whether the server closes a connection in time, whatever it sends before."""
    connection.settimeout(0.0)
    loop, end_s = asyncio.get_running_loop(), time.monotonic() + within_s
    try:
        while await asyncio.wait_for(
            loop.sock_recv(connection, 65536), max(end_s - time.monotonic(), 0.01)
        ):
            pass
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True
    return True


@pytest.mark.parametrize(
    "rest",
    [
        "Content-Length: 900\r\n\r\n",
        "Content-Length: 1000000000\r\n\r\n" + 1000 * "x",
        "Transfer-Encoding: chunked\r\n\r\n3\r\nab",
    ],
)
def test_a_request_with_a_body_ends_whether_the_body_comes_or_not(rest: str) -> None:
    async def check(server: WebServer) -> None:
        address = ("127.0.0.1", int(server.url.rstrip("/").rpartition(":")[2]))
        waiting = [socket.create_connection(address) for _ in range(20)]
        for each in waiting:
            each.sendall((HEAD + rest).encode())
        assert [await ends(each, 2.0) for each in waiting] == [True] * 20
        for each in waiting:
            each.close()

    served(check)


def test_headers_that_do_not_come_end_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "REQUEST_S", 0.2)

    async def check(server: WebServer) -> None:
        address = ("127.0.0.1", int(server.url.rstrip("/").rpartition(":")[2]))
        with socket.create_connection(address) as slow:
            slow.sendall(b"GET / HTTP/1.1\r\nHo")
            assert await ends(slow, 2.0)
        with socket.create_connection(address) as wordy:
            wordy.sendall(b"GET / HTTP/1.1\r\n" + 400 * (b"X: " + 60 * b"x" + b"\r\n"))
            assert await ends(wordy, 2.0)

    served(check)


def test_connections_are_few_and_short_and_a_viewers_is_not_among_them() -> None:
    async def check() -> None:
        near, far = zip(*(socket.socketpair() for _ in range(4)), strict=True)
        streams, connections = [IOStream(each) for each in near], Connections(2, 10.0)
        for time_s, stream in enumerate(streams[:3]):
            connections.add(stream, float(time_s))
        assert [each.closed() for each in streams] == [True, False, False, False]
        connections.release(streams[1])
        connections.add(streams[3], 3.0)
        connections.close_old(12.5)
        assert [each.closed() for each in streams] == [True, False, True, False]
        streams[3].close()
        connections.close_old(12.6)
        assert len(connections) == 0
        for each in (*streams, *far):
            each.close()

    asyncio.run(check())


def test_an_idle_viewer_gives_its_place_to_a_new_one_and_an_active_one_keeps_its(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(web, "IDLE_S", 0.3)

    async def check(server: WebServer) -> None:
        crowd = [await viewer(server) for _ in range(VIEWERS)]
        await asyncio.sleep(0.5)
        for each in crowd[1:]:
            await each.write_message("{}")
            assert await each.read_message()
        late = await viewer(server)
        await late.write_message("{}")
        assert await late.read_message()
        assert await crowd[0].read_message() is None
        assert crowd[0].close_code == 1013
        assert len(server.viewers.open) == VIEWERS
        for each in (*crowd, late):
            each.close()

    served(check)


@pytest.mark.parametrize("sent", [frame("{}"), bytes([0x89, 0x81, 0, 0, 0, 0]) + b"x"])
def test_a_flood_of_questions_or_of_pings_ends_the_connection(sent: bytes) -> None:
    async def check(server: WebServer) -> None:
        with deaf_viewer(server) as flooding:
            flooding.sendall(500 * sent)
            assert await ends(flooding, 2.0)

    served(check)


def test_a_file_is_sent_compressed_or_plain_and_not_again_to_a_browser_that_has_it() -> None:
    async def check(server: WebServer) -> None:
        url, client = server.url + "Chart.bundle.js", AsyncHTTPClient()
        plain = await client.fetch(url, decompress_response=False)
        packed = await client.fetch(url, headers={"Accept-Encoding": "gzip"})
        assert len(plain.body) > 100_000
        assert plain.body == packed.body
        assert "Content-Encoding" not in plain.headers
        assert packed.headers["X-Consumed-Content-Encoding"] == "gzip"
        again = await client.fetch(
            url, headers={"If-None-Match": plain.headers["Etag"]}, raise_error=False
        )
        assert (again.code, again.body) == (304, b"")

    served(check)


def test_a_question_nested_deeply_asks_for_everything() -> None:
    assert cursor_of("[" * 100_000) == Cursor()


def test_the_log_has_a_few_different_lines_and_the_number_of_the_others() -> None:
    written: list[str] = []
    now_s = 1000.0
    log = LimitedLog(written.append, lambda: now_s)
    for k in range(100):
        for text in ("again", f"number {k}\n\x1b[2J{'x' * 10_000}"):
            log.handle(logging.LogRecord("tornado", logging.ERROR, "", 1, text, (), None))
    assert len(written) == LINES
    assert all(line.isprintable() and len(line) <= LENGTH for line in written)
    now_s += PERIOD_S
    log.report()
    assert written[LINES:] == [
        f"web server: {200 - LINES} more lines were left out in the last 60 s"
    ]


def test_an_exception_in_the_event_loop_is_one_line_with_its_place() -> None:
    written: list[str] = []

    async def fail() -> None:
        asyncio.get_running_loop().call_soon(lambda: 1 / 0)
        await asyncio.sleep(0)

    with limited_log(written.append):
        asyncio.run(fail())
    assert len(written) == 1
    assert "ZeroDivisionError in" in written[0]
