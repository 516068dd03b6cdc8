# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bounded set of connections that are not yet viewers."""

import asyncio
import logging
import socket
import time
from collections.abc import Callable

from tornado.iostream import IOStream

MOST = 256
"""Number of open connections beside those of the viewers."""
PACE_S = 0.002
"""[s] Time between two new connections while all are taken.

Each then lives at least ``MOST * PACE_S``, in which a browser's request is read and answered;
others wait in the kernel.
"""
LIFETIME_S = 30.0
"""[s] Longest life of such a connection; a browser opens another when it needs one."""
BACKLOG = 1024
"""Number of connections that the kernel keeps while the node is busy."""
_RECEIVED = 64 * 1024  # bytes in the buffer of one connection
_AGAIN_S = 0.1
_log = logging.getLogger(__name__)


class Connections:
    """Connections in the order of their arrival; a new one replaces the oldest where all are taken.

    A program that opens connections and sends nothing, or never reads an answer, can therefore
    neither use up the descriptors of the process nor keep a browser out: a browser sends its
    request at once, and is answered before its connection is the oldest.
    """

    def __init__(self, most: int = MOST, lifetime_s: float = LIFETIME_S) -> None:
        """Start without connections."""
        self._most, self._lifetime_s = most, lifetime_s
        self._since_s: dict[IOStream, float] = {}

    def __len__(self) -> int:
        """Return the number of open connections."""
        return len(self._since_s)

    def add(self, stream: IOStream, now_s: float) -> None:
        """Add a connection; ``now_s`` is the time by the steady clock."""
        self.close_old(now_s)
        if len(self._since_s) >= self._most:
            self.close_oldest()
        self._since_s[stream] = now_s

    def release(self, stream: IOStream) -> None:
        """Remove a connection that has become a viewer's, and leave it open."""
        self._since_s.pop(stream, None)

    def close_old(self, now_s: float) -> None:
        """Close the connections that have reached their lifetime, and forget closed ones."""
        for stream, since_s in list(self._since_s.items()):
            if now_s - since_s > self._lifetime_s:
                stream.close()
            if stream.closed():
                del self._since_s[stream]

    def close_oldest(self) -> None:
        """Close the oldest connection, where there is one."""
        for stream in list(self._since_s)[:1]:
            stream.close()
            del self._since_s[stream]

    async def accept(
        self, listening: socket.socket, serve: Callable[[IOStream, tuple[str, int]], object]
    ) -> None:
        """Accept connections for ever, and hand each one with its address to ``serve``."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, address = await loop.sock_accept(listening)
            except OSError as error:  # no descriptor is left, for instance
                _log.warning("a connection is not accepted: %s", error.strerror or error)
                self.close_oldest()
                await asyncio.sleep(_AGAIN_S)
                continue
            stream = IOStream(connection, max_buffer_size=_RECEIVED)
            self.add(stream, time.monotonic())
            serve(stream, address)
            if len(self) >= self._most:
                _log.warning("%d connections are open: a new one replaces the oldest", self._most)
                await asyncio.sleep(PACE_S)
