# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of README and getting started run twice in a row as they are written.

The usual run shortens the drive and leaves out what other tests run; ``make first-use`` does not.
"""

import os
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from tests.system.processes import Starter

ROOT = Path(__file__).parents[2]
WHOLE = os.environ.get("FIRST_USE") == "whole"
SHORTER = {
    "duration:=60.0": "duration:=2.0",
    "ros2 run terrain_estimator selftest": "true",  # test_selftest.py
    "terrain_estimator dashboard": "terrain_estimator dashboard --ros-args -p port:=0",
}
BLOCKS = {
    "README": ("README.md", "The nodes by hand"),
    "sample": ("docs/getting_started.md", "Demo and sample recording"),
    "first drive": ("docs/getting_started.md", "A first drive"),
}
USUAL = ("README",)  # the first drive has the same commands, and the sample's are among them


def commands(page: str, heading: str) -> str:
    """Return the first block of code under a heading."""
    tokens = MarkdownIt("commonmark").parse((ROOT / page).read_text(encoding="utf-8"))
    contents = [token.content for token in tokens]
    after = tokens[contents.index(heading) :]
    return next(token.content for token in after if token.type == "code_block")


@pytest.mark.parametrize("which", BLOCKS if WHOLE else USUAL)
def test_the_commands_of_a_page_run_twice_in_a_row(
    start: Starter, tmp_path: Path, which: str
) -> None:
    place, text = tmp_path / "clone", commands(*BLOCKS[which])
    (place / "bags").mkdir(parents=True)
    (place / "bags/sample").symlink_to(ROOT / "bags/sample")
    for name in ("ros2_ws", ".venv"):
        (place / name).symlink_to(ROOT / name)
    for before, after in () if WHOLE else SHORTER.items():
        text = text.replace(before, after)
    # as in a terminal: jobs have numbers and take SIGINT
    script = f"set -em; trap 'kill -9 $(jobs -p) 2>/dev/null || true' EXIT; cd {place}\n{text}"
    for times in (1, 2):
        process = start.command("bash", "-c", script)
        assert process.wait(180.0 if WHOLE else 60.0) == 0, process.output
        reports = [*place.glob("out/*/report.html")]
        assert len(reports) == (1 if which == "sample" else times)
        if which != "sample":
            assert "terrain_estimate is identical to live" in process.output
    assert (ROOT / "bags/sample/metadata.yaml").is_file()
