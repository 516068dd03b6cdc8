# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The runtime of a replay: that of the parameter, and by itself that of the live node."""

import json
from pathlib import Path

import pytest

from terrain_estimator.bags import BagReader
from terrain_estimator.cli import replay
from terrain_estimator.compiled import finding
from terrain_estimator.compiled.core import CoreError
from tests.terrain_estimator.offline.replays import estimates, identical, run, with_estimates

RUNTIMES = ("compiled", "torchscript")


@pytest.fixture(scope="module")
def recorded(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return recordings of a live node with each runtime."""
    folder = tmp_path_factory.mktemp("recorded")
    for name in RUNTIMES:
        code, _ = run(folder / f"of_{name}", bag, "-p", f"runtime:={name}")
        assert code == 0
        with_estimates(folder / name, bag, folder / f"of_{name}/drive_estimates")
    return {name: folder / name for name in RUNTIMES}


def no_core(*_: object) -> None:
    raise CoreError("no core here")


def test_a_replay_runs_what_the_parameter_says_and_by_itself_what_the_live_node_ran(
    bag: Path, recorded: dict[str, Path], tmp_path: Path
) -> None:
    for name in RUNTIMES:
        code, summary = run(tmp_path / name, recorded[name], "--compare")
        assert code == 0
        result = summary["bags"][0]
        assert (result["runtime"], result["identical_to_live"]) == (name, True)
        live = estimates(recorded[name])[0]
        assert result["configuration_sha256"] == live.configuration_sha256
        with BagReader(tmp_path / f"{name}/{name}_estimates") as reader:
            origin = json.loads(reader.metadata["terrain_estimator"]["configuration"])
        assert origin["runtime"] == name
    both = [tmp_path / f"{name}/{name}_estimates" for name in RUNTIMES]
    assert not identical(*both)
    for one, other in zip(*map(estimates, both), strict=True):
        assert one.cohesion == pytest.approx(other.cohesion, rel=1e-8)
        assert one.tan_phi == pytest.approx(other.tan_phi, rel=1e-8)
    assert run(tmp_path / "of_inputs", bag)[1]["bags"][0]["runtime"] == "compiled"


def test_without_a_core_torchscript_replays_and_says_that_bytes_differ(
    recorded: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(finding, "find_core", no_core)
    code, summary = run(tmp_path / "out", recorded["compiled"], "--compare")
    assert code == replay.DIFFERENT
    result = summary["bags"][0]
    assert result["runtime"] == "torchscript"
    assert "its live estimates are of the compiled core" in " ".join(result["notes"])
    assert "no core here" in capsys.readouterr().out
    code, summary = run(tmp_path / "same", recorded["torchscript"], "--compare")
    assert (code, summary["bags"][0]["notes"]) == (0, [])


@pytest.mark.parametrize(
    ("value", "words"), [("compiled", "no core here"), ("fast", "auto, compiled, torchscript")]
)
def test_a_runtime_that_cannot_be_had_is_refused(
    bag: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    value: str,
    words: str,
) -> None:
    monkeypatch.setattr(finding, "find_core", no_core)
    assert run(tmp_path / "out", bag, "-p", f"runtime:={value}")[0] == replay.WRONG
    said = capsys.readouterr().err
    assert "parameter runtime" in said
    assert words in said
