# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""fleet discover: the finding of find_missing_effect on the bags in folders, each once."""

import json
import shutil
from pathlib import Path

import pytest

from terrain_estimator.cli import find_missing_effect
from terrain_estimator.cli.fleet import main
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal

LIBRARY = ("--library", "drive_drag")


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of three short runs."""
    case = draw_cases(Plan((("drive_drag", 1.0),), soil="loose_sand", seconds=9.0), 1, seed=5)[0]
    folder = tmp_path_factory.mktemp("sealed")
    for number, bag in enumerate(list(seal(case, folder))[:3]):
        shutil.move(bag, folder / f"runs/day_{number}/{bag.name}")
    return folder / "runs"


def test_the_finding_is_that_of_the_bags_given_one_by_one(
    sealed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = [str(bag) for bag in sorted(sealed.glob("day_*/*"))]
    assert len(bags) == 3
    one, other = tmp_path / "one", tmp_path / "other"
    assert find_missing_effect.main([*bags, *LIBRARY, "--out", str(one)]) == 0
    shutil.copytree(bags[0], sealed / "day_9/copy")
    assert main(["discover", str(sealed), *LIBRARY, "--out", str(other)]) == 0
    assert f"day_9/copy has the content of {bags[0]}" in capsys.readouterr().err
    findings = [json.loads((out / "finding.json").read_text()) for out in (one, other)]
    assert findings[0] == findings[1]


def test_an_address_that_no_store_serves_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["discover", "nothing://rovers/fleet"]) == 2
    assert "nothing://rovers/fleet" in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["discover", str(tmp_path / "nowhere")]) == 2
    assert str(tmp_path / "nowhere") in capsys.readouterr().err
