# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Take the pictures of the live page and of a found effect: `make pictures`, three minutes.

The simulator drives for a minute at twice real time, in a ROS domain of its own, while chromium
shows the live page. The report is the one of `make discover ARGS="--seed 2026"`.
"""

import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from shutil import which

from PIL import Image
from playwright.sync_api import FloatRect, Page, sync_playwright

from terrain_estimator.demonstration.processes import Program, executable

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/images"
_PORT, _DOMAIN = 8097, "77"
_WIDTH, _FIRST_FOLD, _TO_WHEELS = 960, 770, 1108
_FRAME_MS, _LAST_FRAME_MS, _COLOURS = 350, 3000, 64
_DRIVE = {
    "soil": "loose_sand",
    "schedule": "S1",
    "duration": "60.0",
    "real_time_factor": "2.0",
    "wait_for_subscribers": "2",
}
_SEED = "2026"
_DISCOVER = ("tests.terrain_estimator.discovery.discover", "--seed", _SEED, "--out")


def main() -> int:
    """Write the pictures; returns the exit code."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=which("chromium") or which("google-chrome"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": _WIDTH, "height": 1290})
        _save(_live(page))
        with tempfile.TemporaryDirectory() as found:
            subprocess.run([sys.executable, "-m", *_DISCOVER, found], check=True, cwd=ROOT)  # noqa: S603
            _report(browser.new_page(viewport={"width": 900, "height": 900}), Path(found) / _SEED)
        browser.close()
    return 0


def _live(page: Page) -> list[Image.Image]:
    """Return pictures of the live page during a drive, from the first estimate on."""
    frames = []
    with tempfile.TemporaryDirectory() as logs, ExitStack() as running:
        environment = os.environ | {"ROS_DOMAIN_ID": _DOMAIN}

        def start(package: str, name: str, **values: str) -> Program:
            given = [each for key, value in values.items() for each in ("-p", f"{key}:={value}")]
            command = [executable(package, name), "--ros-args", *given]
            return Program(command, Path(logs, name), environment)

        for name in ("estimator", "planner"):
            running.callback(start("terrain_estimator", name).stop)
        running.callback(start("terrain_estimator", "dashboard", port=str(_PORT)).stop)
        time.sleep(5.0)
        page.goto(f"http://127.0.0.1:{_PORT}")
        page.locator("#whole").click()
        drive = start("rover_sim_node", "simulator", **_DRIVE)
        while drive.running:
            picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
            if page.get_by_text("identified").count() and drive.running:
                frames.append(picture)
            page.wait_for_timeout(900)
    return frames[1:-2]  # empty charts at first; the last ones may show the end of the data


def _save(frames: list[Image.Image]) -> None:
    """Write a still, and a moving picture that begins with its end, for viewers that show one."""
    still = frames[-1].crop((0, 0, _WIDTH, _TO_WHEELS))
    still.save(FOLDER / "dashboard.png", optimize=True)
    palette = still.quantize(_COLOURS)
    moving = [
        frame.crop((0, 0, _WIDTH, _FIRST_FOLD)).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in (frames[-1], *frames[:-1])
    ]
    moving[0].save(
        FOLDER / "live.gif",
        save_all=True,
        append_images=moving[1:],
        duration=[_LAST_FRAME_MS] + [_FRAME_MS] * (len(moving) - 1),
        loop=0,
    )


def _report(page: Page, folder: Path) -> None:
    """Write the verdict at the top of the report in a folder, and the part about the ground."""
    page.goto((folder / "report.html").as_uri())
    tops = {
        str(text): float(top)
        for text, top in page.evaluate(
            "[...document.querySelectorAll('h2, h3')]"
            ".map(each => [each.textContent, each.getBoundingClientRect().top + scrollY])"
        )
    }
    names = list(tops)
    ground = next(index for index, name in enumerate(names) if "searched runs" in name)
    for name, top, bottom in (
        ("discovery_verdict", 24.0, tops[names[1]] - 22),
        ("discovery_ground", tops[names[ground]] - 14, tops[names[ground + 1]] - 34),
    ):
        clip = FloatRect(x=0.0, y=top, width=900.0, height=bottom - top)
        page.screenshot(path=FOLDER / f"{name}.png", full_page=True, clip=clip)


if __name__ == "__main__":
    raise SystemExit(main())
