# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The live page under connections that send too little, too much, or never read."""

import resource
import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

from terrain_estimator.dashboard.connections import MOST
from terrain_estimator.dashboard.log_limit import LINES
from terrain_estimator.dashboard.web import IDLE_S, VIEWERS
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

DESCRIPTORS = 1024  # the usual limit of a process
SLOW = 1000
UPGRADE = (
    "GET /live HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: x\r\n\r\n"
)
BEGINNINGS = (
    "POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 900\r\n\r\n",
    "POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nab",
    "GET / HTTP/1.1\r\nHo",
    "GET /Chart.bundle.js HTTP/1.1\r\nHost: localhost\r\n\r\n",
    UPGRADE,
)


def connect(url: str, beginning: str) -> socket.socket:
    address = urlsplit(url)
    connection = socket.create_connection((address.hostname, address.port), 10.0)
    connection.sendall(beginning.encode())
    return connection


def descriptors(process: Process) -> int:
    return len(list(Path(f"/proc/{process.pid}/fd").iterdir()))


def frame(text: str) -> bytes:
    """Return a short text as a WebSocket frame, masked with zeros."""
    return bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text.encode()


def is_answered(url: str) -> bool:
    """Return whether a new viewer gets an answer to its first question."""
    with connect(url, UPGRADE) as viewer, suppress(TimeoutError):
        viewer.settimeout(5.0)  # the machine is busy with a thousand others
        viewer.sendall(frame("{}"))
        received = b""
        while part := viewer.recv(65536):
            received += part
            if b'"cursor"' in received:
                return True
    return False


def test_a_thousand_slow_connections_leave_the_page_reachable_and_the_log_short(
    start: Starter,
) -> None:
    process = start("terrain_estimator", "dashboard", "--ros-args", "-p", "port:=0")
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS))
    url = process.wait_for_output(r"ready: (\S+)", timeout=60.0)[1]
    before, lines = descriptors(process), len(process.output.splitlines())
    with ExitStack() as open_ones:
        for _ in range(VIEWERS):
            idle = open_ones.enter_context(connect(url, UPGRADE))
            assert b"101 Switching" in idle.recv(1000)
        for k in range(SLOW):
            open_ones.enter_context(connect(url, BEGINNINGS[k % len(BEGINNINGS)]))
        for path in ("", "dashboard.js", "Chart.bundle.js"):
            with urlopen(url + path, timeout=10.0) as answer:
                assert len(answer.read()) > 1000
        wait_until(lambda: is_answered(url), "a new viewer has a place", IDLE_S + 20.0)
        # what is refused is closed a moment after it was taken
        most = before + MOST + VIEWERS
        wait_until(lambda: descriptors(process) <= most, f"at most {most} descriptors are open")
    written = process.output.splitlines()[lines:]
    assert 0 < len(written) <= LINES + 5, written  # five of the silent topics
    assert process.interrupt(60.0) == 0
    assert "Traceback" not in process.output
