# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Web server of the live page: a handful of files, and a socket for each viewer.

It is bounded in bytes, seconds and connections: a request has no body, its headers arrive within
``REQUEST_S``, a connection that is not a viewer's is closed after a while (``connections``), and a
viewer that makes no progress gives its place to a new one.
"""

import asyncio
import errno
import gzip
import hashlib
import ipaddress
import json
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from importlib.resources import files
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rover_parameters.records import ConfigError
from terrain_estimator.dashboard.connections import BACKLOG, Connections
from terrain_estimator.dashboard.model import Cursor, LiveModel
from terrain_estimator.pages.page import page

VIEWERS = 32
HEARTBEAT_S = 1.0
"""[s] Longest time between answers, to distinguish a silent rover from a dead node."""
PING_S = 20.0
"""[s] Time after which a viewer that answers no ping is dropped."""
IDLE_S = 3.0
"""[s] Time without a question after which a viewer gives its place to a new one, if all are taken.

A page that is in sight asks once a second.
"""
REQUEST_S = 10.0
"""[s] Time in which the headers of a request have to arrive."""
GOODBYE_S = 0.5
_LONGEST_QUESTION = 1000  # bytes
_LONGEST_HEADERS = 16 * 1024  # bytes; a browser sends the cookies of all servers of one host
_PART = 32 * 1024  # bytes
_MOST_QUESTIONS = 100
"""Number of questions of a viewer while one answer is under way; the page asks one."""
_POLICY = (
    "default-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors"
    " 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cache-Control": "no-cache",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Server": "dashboard",
    "X-Content-Type-Options": "nosniff",
}
_SETTINGS: dict[str, Any] = {
    "websocket_ping_interval": PING_S,
    "websocket_ping_timeout": PING_S,
    "websocket_max_message_size": _LONGEST_QUESTION,
    "log_function": lambda _: None,
}


@dataclass(frozen=True)
class File:
    """Content served under one path."""

    kind: str
    content: bytes

    @cached_property
    def compressed(self) -> bytes:
        """The content as gzip; compressed once, and not for every request."""
        return gzip.compress(self.content, mtime=0)

    @cached_property
    def tag(self) -> str:
        """Tag by which a browser asks whether the content that it keeps is still the same."""
        return f'W/"{hashlib.sha256(self.content).hexdigest()[:16]}"'


def page_files() -> dict[str, File]:
    """Return all files of the page by path; ConfigError where the plotting library is missing."""
    try:
        library = files("chartkick") / "django/static/chartkick/Chart.bundle.js"
    except ModuleNotFoundError as error:
        raise ConfigError(
            "the page draws with Chart.js of the package chartkick: python -m pip install"
            " chartkick==1.2.0"
        ) from error
    own, style = (
        files("terrain_estimator.dashboard") / "static",
        files("terrain_estimator.pages") / "templates/style.css",
    )
    served = {"/": File("text/html; charset=utf-8", page("dashboard.html").encode())}
    for source in (library, style, *own.iterdir()):
        kind = {"js": "text/javascript", "css": "text/css"}[source.name.rpartition(".")[2]]
        served[f"/{source.name}"] = File(f"{kind}; charset=utf-8", source.read_bytes())
    return served


class Viewers:
    """Open viewers of the page; each gets what is new since its last answer when it asks."""

    def __init__(self, model: LiveModel, connections: Connections) -> None:
        """Start without viewers."""
        self._model, self._connections = model, connections
        self.open: set[Live] = set()

    def admit(self, viewer: "Live", now_s: float) -> bool:
        """Return whether there is a place for a viewer; an idle one gives up its own."""
        if len(self.open) >= VIEWERS:
            idle = min(self.open, key=lambda each: each.progress_s)
            if now_s - idle.progress_s <= IDLE_S:
                return False
            idle.close(1013, "a viewer that asked for nothing gave its place to another")
            self.open.discard(idle)
        viewer.progress_s = now_s
        if viewer.stream is not None:
            self._connections.release(viewer.stream)
        self.open.add(viewer)
        return True

    def answer(self, now_s: float) -> None:
        """Answer all viewers that have asked and received their last answer; never wait for one.

        ``now_s`` is the time by the steady clock.
        """
        texts: dict[Cursor, str] = {}
        for viewer in list(self.open):
            if viewer.is_due(self._model.revision, now_s) and viewer.asked is not None:
                cursor = viewer.asked
                if cursor not in texts:
                    texts[cursor] = self._model.update(cursor, now_s)
                viewer.send(texts[cursor], self._model.revision, now_s)


class _Guarded(RequestHandler):
    """Handler that refuses host names other than this machine's.

    A foreign page whose name resolves to this address could otherwise read along (DNS rebinding).
    """

    def set_default_headers(self) -> None:
        """Set the headers of every answer."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse a foreign host name."""
        if not is_own_name(self.request.host_name):
            raise HTTPError(
                403, reason="Unknown Host: use an address, localhost or the name of the machine"
            )


class Page(_Guarded):
    """Handler of one file."""

    def initialize(self, content: File) -> None:
        """Keep the file's content."""
        self._content = content

    async def get(self) -> None:
        """Send the file as fast as the browser reads it: one part at a time is in memory."""
        content = self._content.content
        self.set_header("Etag", self._content.tag)
        self.set_header("Vary", "Accept-Encoding")
        if self.check_etag_header():
            self.set_status(304)
            return
        self.set_header("Content-Type", self._content.kind)
        if "gzip" in self.request.headers.get("Accept-Encoding", ""):
            self.set_header("Content-Encoding", "gzip")
            content = self._content.compressed
        self.set_header("Content-Length", str(len(content)))
        with suppress(StreamClosedError):
            for begin in range(0, len(content), _PART):
                self.write(content[begin : begin + _PART])
                await self.flush()


class NotThere(_Guarded):
    """Handler of every other path."""

    def prepare(self) -> None:
        """Answer 404, after the check of the host name."""
        super().prepare()
        raise HTTPError(404)


class Live(_Guarded, WebSocketHandler):
    """Handler of one viewer: it asks with its cursor, and at most one answer is under way."""

    def initialize(self, viewers: Viewers) -> None:
        """Start without a question."""
        self._viewers = viewers
        self.asked: Cursor | None = None
        self.progress_s = 0.0  # time by the steady clock of the last question that could be taken
        self._sending: asyncio.Future[None] | None = None
        self._revision, self._sent_s = -1, 0.0
        self._questions = 0  # since the last answer

    @property
    def stream(self) -> IOStream | None:
        """Connection of the viewer; None after its end."""
        return getattr(self.ws_connection, "stream", None)

    def _drop(self) -> None:
        """End the connection of a program that is no page, without a farewell."""
        if self.stream is not None:
            self.stream.close()

    def open(self, *_: str, **__: str) -> None:
        """Admit the viewer unless there are too many."""
        if not self._viewers.admit(self, time.monotonic()):
            self.close(1013, f"all {VIEWERS} places for viewers are taken")

    def on_message(self, message: str | bytes) -> None:
        """Take the viewer's question, its cursor; anything else asks for everything."""
        self._questions += 1
        if self._questions > _MOST_QUESTIONS:
            self._drop()
            return
        if self._free:
            self.progress_s = time.monotonic()
        self.asked = cursor_of(message)

    def on_ping(self, data: bytes) -> None:
        """Close the connection: browsers send no pings, and answers to them could pile up."""
        del data
        self._drop()

    def on_close(self) -> None:
        """Forget the viewer."""
        self._viewers.open.discard(self)

    @property
    def _free(self) -> bool:
        return self._sending is None or self._sending.done()

    def is_due(self, revision: int, now_s: float) -> bool:
        """Return whether to answer: it has asked, and there is news or the heartbeat is due."""
        return (
            self._free
            and self.asked is not None
            and (revision != self._revision or now_s - self._sent_s >= HEARTBEAT_S)
        )

    def send(self, text: str, revision: int, now_s: float) -> None:
        """Start sending an answer."""
        self.asked, self._revision, self._sent_s = None, revision, now_s
        self._questions = 0
        try:
            self._sending = asyncio.ensure_future(self.write_message(text))
            # a viewer that has left needs no answer
            self._sending.add_done_callback(lambda sent: sent.cancelled() or sent.exception())
        except WebSocketClosedError:
            self._viewers.open.discard(self)


def cursor_of(question: str | bytes) -> Cursor:
    """Return the cursor in a viewer's question; an empty one where there is none."""
    try:
        given: dict[str, Any] = json.loads(question)
        cursor = Cursor(**given)
    except (ValueError, TypeError, RecursionError):
        return Cursor()
    kinds = all(type(getattr(cursor, item.name)) is item.type for item in fields(Cursor))
    return cursor if kinds else Cursor()


def is_own_name(host: str) -> bool:
    """Return whether a Host header names this machine: an address, localhost, or its name."""
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        own = socket.gethostname().lower()
        return host.lower() in {"localhost", own, f"{own.split('.')[0]}.local"}
    return True


class WebServer:
    """The page on a port."""

    def __init__(self, model: LiveModel, address: str, port: int) -> None:
        """Listen, within a running event loop.

        Raises ConfigError where the address is not this machine's or the port is taken.
        """
        files_served, self._listening = page_files(), _listening(address, port)
        self.connections = Connections()
        self.viewers = Viewers(model, self.connections)
        paths: list[Any] = [
            (path, Page, {"content": content}) for path, content in files_served.items()
        ]
        application = Application(
            [*paths, ("/live", Live, {"viewers": self.viewers})],
            default_handler_class=NotThere,
            **_SETTINGS,
        )
        self._server = HTTPServer(
            application,
            max_body_size=0,
            max_header_size=_LONGEST_HEADERS,
            idle_connection_timeout=REQUEST_S,
        )
        self._listening.settimeout(0.0)
        shown = f"[{address}]" if ":" in address else address
        self.url = f"http://{shown}:{self._listening.getsockname()[1]}/"

    async def serve(self, stop: threading.Event, rate_hz: float, take: Callable[[], None]) -> None:
        """Call ``take`` and answer the viewers at this rate until ``stop`` is set; then close."""
        accepting = asyncio.create_task(
            self.connections.accept(self._listening, self._server.handle_stream)
        )
        while not stop.is_set():
            take()
            now_s = time.monotonic()
            self.connections.close_old(now_s)
            self.viewers.answer(now_s)
            await asyncio.sleep(1.0 / rate_hz)
        accepting.cancel()
        self._listening.close()
        for viewer in list(self.viewers.open):
            viewer.close(1001, "the node ends")
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.close_all_connections(), GOODBYE_S)


def _listening(address: str, port: int) -> socket.socket:
    try:
        return socket.create_server(
            (address, port),
            family=socket.AF_INET6 if ":" in address else socket.AF_INET,
            backlog=BACKLOG,
        )
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ConfigError(
                f"port {port} of {address} is taken, perhaps by another dashboard: stop that"
                f" program, or use another port with -p port:={port + 1}; -p port:=0 chooses a free"
                " one"
            ) from error
        raise ConfigError(
            f"parameter address: cannot listen on {address!r}, port {port}:"
            f" {error.strerror or error}"
        ) from error
