# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Open pages in the system's chromium; tests that need it are skipped where there is none."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.system.waiting import PATIENCE_S

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
expect.set_options(timeout=1000.0 * PATIENCE_S)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium on this machine: sudo apt-get install chromium"
)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser without a window."""
    # Chromium refuses its sandbox to root, as whom containers often run.
    arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@dataclass(frozen=True, slots=True)
class Opened:
    """A page, its console messages, and its requests."""

    page: Page
    said: list[str] = field(default_factory=list)
    asked_for: list[str] = field(default_factory=list)


@contextmanager
def opened(
    browser: Browser, source: Path | str, width: int, scheme: str = "light"
) -> Iterator[Opened]:
    """Open a file without a network, or an address, in a window of that width."""
    context = browser.new_context(
        viewport={"width": width, "height": 800},
        offline=isinstance(source, Path),
        color_scheme="dark" if scheme == "dark" else "light",
    )
    context.set_default_timeout(1000.0 * PATIENCE_S)
    result = Opened(context.new_page())
    result.page.on("console", lambda message: result.said.append(message.text))
    result.page.on("pageerror", lambda error: result.said.append(str(error)))
    result.page.on("request", lambda request: result.asked_for.append(request.url))
    result.page.on("websocket", lambda socket: result.asked_for.append(socket.url))
    result.page.goto(source.as_uri() if isinstance(source, Path) else source)
    yield result
    context.close()
