# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Web server of the live page: a handful of files, and a socket for each viewer."""

import asyncio
import errno
import ipaddress
import json
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from importlib.resources import files
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rover_parameters.records import ConfigError
from terrain_estimator.dashboard.model import Cursor, LiveModel
from terrain_estimator.pages.page import page

VIEWERS = 32
HEARTBEAT_S = 1.0
"""[s] Longest time between answers, to distinguish a silent rover from a dead node."""
PING_S = 20.0
"""[s] Time after which a viewer that answers no ping is dropped."""
GOODBYE_S = 0.5
_LONGEST_QUESTION = 1000  # bytes
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
    "compress_response": True,
    "websocket_ping_interval": PING_S,
    "websocket_ping_timeout": PING_S,
    "websocket_max_message_size": _LONGEST_QUESTION,
    "log_function": lambda _: None,
}


@dataclass(frozen=True, slots=True)
class File:
    """Content served under one path."""

    kind: str
    content: bytes


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

    def __init__(self, model: LiveModel) -> None:
        """Start without viewers."""
        self._model = model
        self.open: set[Live] = set()

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

    def get(self) -> None:
        """Send the file."""
        self.set_header("Content-Type", self._content.kind)
        self.finish(self._content.content)


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
        self._sending: asyncio.Future[None] | None = None
        self._revision, self._sent_s = -1, 0.0

    def open(self, *_: str, **__: str) -> None:
        """Admit the viewer unless there are too many."""
        if len(self._viewers.open) >= VIEWERS:
            self.close(1013, f"all {VIEWERS} places for viewers are taken")
            return
        self._viewers.open.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Take the viewer's question, its cursor; anything else asks for everything."""
        self.asked = cursor_of(message)

    def on_close(self) -> None:
        """Forget the viewer."""
        self._viewers.open.discard(self)

    def is_due(self, revision: int, now_s: float) -> bool:
        """Return whether to answer: it has asked, and there is news or the heartbeat is due."""
        free = self._sending is None or self._sending.done()
        return (
            free
            and self.asked is not None
            and (revision != self._revision or now_s - self._sent_s >= HEARTBEAT_S)
        )

    def send(self, text: str, revision: int, now_s: float) -> None:
        """Start sending an answer."""
        self.asked, self._revision, self._sent_s = None, revision, now_s
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
    except (ValueError, TypeError):
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
        files_served, listening = page_files(), _listening(address, port)
        self.viewers = Viewers(model)
        paths: list[Any] = [
            (path, Page, {"content": content}) for path, content in files_served.items()
        ]
        application = Application(
            [*paths, ("/live", Live, {"viewers": self.viewers})],
            default_handler_class=NotThere,
            **_SETTINGS,
        )
        self._server = HTTPServer(
            application, max_body_size=_LONGEST_QUESTION, idle_connection_timeout=PING_S
        )
        listening.settimeout(0.0)
        self._server.add_socket(listening)
        shown = f"[{address}]" if ":" in address else address
        self.url = f"http://{shown}:{listening.getsockname()[1]}/"

    async def serve(self, stop: threading.Event, rate_hz: float, take: Callable[[], None]) -> None:
        """Call ``take`` and answer the viewers at this rate until ``stop`` is set; then close."""
        while not stop.is_set():
            take()
            self.viewers.answer(time.monotonic())
            await asyncio.sleep(1.0 / rate_hz)
        self._server.stop()
        for viewer in list(self.viewers.open):
            viewer.close(1001, "the node ends")
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.close_all_connections(), GOODBYE_S)


def _listening(address: str, port: int) -> socket.socket:
    try:
        return socket.create_server(
            (address, port), family=socket.AF_INET6 if ":" in address else socket.AF_INET
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
