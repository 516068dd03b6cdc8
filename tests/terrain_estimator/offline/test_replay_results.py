# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A replay replaces its own earlier results alone, and only when new ones are whole."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from terrain_estimator.cli import replay
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.model.model_file import load_model
from tests.terrain_estimator.offline.replays import run


def test_results_are_not_replaced_unless_asked_for(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, bag)[0] == 0
    assert run(tmp_path, bag)[0] == replay.WRONG
    assert (
        "drive_estimates exists from an earlier replay: give --overwrite, or another folder with"
        " --out" in capsys.readouterr().err
    )
    assert run(tmp_path, bag, "--overwrite")[0] == 0


@pytest.mark.parametrize("kind", ["link to a bag", "recording", "changed", "bag is unreadable"])
def test_overwrite_removes_nothing_that_an_earlier_replay_did_not_write(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    out, foreign = tmp_path / "out", tmp_path / "foreign"
    place = out / "drive_estimates"
    assert run(out, bag)[0] == 0
    shutil.copytree(bag, foreign)
    if kind == "link to a bag":
        shutil.rmtree(place)
        place.symlink_to(foreign)
        words = f"{place}: was not written by this suite"
    elif kind == "recording":
        shutil.rmtree(place)
        shutil.copytree(foreign, place)
        words = f"{place}/drive_0.mcap: was not written by this suite"
    elif kind == "changed":
        (place / "metadata.yaml").write_text("mine")
        words = f"{place}/metadata.yaml: has changed since"
    else:
        bag = tmp_path / "drive"
        bag.mkdir()
        (bag / "drive_0.mcap").write_bytes(b"torn")
        words = f"{bag}/drive_0.mcap"
    before = contents(tmp_path)
    capsys.readouterr()
    assert run(out, bag, "--overwrite")[0] == replay.WRONG
    assert words in capsys.readouterr().err
    assert contents(tmp_path) == before


def contents(folder: Path) -> dict[Path, bytes]:
    """Return all files, those behind links too."""
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def test_a_folder_of_something_else_gets_no_results(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    assert run(tmp_path, bag, "--overwrite") == (replay.WRONG, {})
    assert f"{tmp_path}: holds thesis.tex and no manifest.json" in capsys.readouterr().err
    for page, words in (
        (tmp_path / "thesis.tex", "the name must end with .html"),
        (tmp_path / "mine.html", "mine.html exists already"),
    ):
        (tmp_path / "mine.html").write_text("mine")
        code, summary = run(tmp_path / "out", bag, "--overwrite", "--report", page)
        assert (code, summary) == (replay.WRONG, {})
        assert words in capsys.readouterr().err
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "thesis.tex": "mine",
        "mine.html": "mine",
    }


def test_a_report_beside_the_results_is_replaced_with_them(bag: Path, tmp_path: Path) -> None:
    for _ in range(2):
        report = tmp_path / "out/report.html"
        assert run(tmp_path / "out", bag, "--overwrite", "--report", report)[0] == 0
        assert report.read_text().endswith("</html>")


def test_a_full_disk_leaves_no_half_of_a_result(bag: Path, tmp_path: Path) -> None:
    """Room for the estimates, then for no report: nothing else of the replay is left."""
    program = (
        "import resource, sys; from terrain_estimator.cli import replay\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)\n"
        "sys.exit(replay.main(sys.argv[2:]))"
    )
    out = tmp_path / "out"
    arguments = [str(bag), "--out", str(out), "--report", str(out / "report.html")]
    for room, left in ((200_000, {"drive_estimates", "manifest.json"}), (1000, set())):
        done = subprocess.run(
            [sys.executable, "-c", program, str(room), *arguments],
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == replay.WRONG
        assert "File too large" in done.stderr
        assert "Traceback" not in done.stderr
        assert {path.name for path in out.glob("*")} == left
        shutil.rmtree(out, ignore_errors=True)


def test_a_report_or_a_summary_that_cannot_be_written_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = replay._ReplayFiles(replay._parser().parse_args(["x", "--out", str(tmp_path / "out")]))
    output.report = tmp_path / "file/report.html"
    (tmp_path / "file").touch()
    assert not replay._tell(output, [], load_model(), EstimatorConfig())
    said = capsys.readouterr()
    assert f"{tmp_path}/file/report.html: cannot be written (Not a directory)" in said.err
    assert (tmp_path / "out/summary.json").exists()
    (tmp_path / "out/summary.json").write_text("the user's")
    assert not replay._tell(output, [], load_model(), EstimatorConfig())
    assert f"{tmp_path}/out/summary.json: has changed since" in capsys.readouterr().err
    assert (tmp_path / "out/summary.json").read_text() == "the user's"
