# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet on workers of this machine: the results of replay, each content once, in any order."""

import io
import math
import re
import shutil
from contextlib import redirect_stderr
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from terrain_estimator.cli.fleet import main
from terrain_estimator.offline.cluster import cluster
from tests.terrain_estimator.fleet.fleets import rows, tables, write_bags
from tests.terrain_estimator.offline.replays import estimates, run

BAGS = 4
COUNT = re.compile(
    r"fleet: \d+%, \d+ s left \d+ done, \d+ damaged, \d+ equal, \d+( and more)? left"
)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of four bags, a copy of one, a file that is no bag, and one of a rock."""
    folder = tmp_path_factory.mktemp("fleet")
    first = write_bags(folder / "week", BAGS)[0]
    shutil.copytree(first, folder / "again" / "other_name")
    (folder / "broken.mcap").write_bytes(b"no bag")
    return folder


def test_two_workers_give_what_one_gives_and_what_replay_gives(
    bags: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("terrain_estimator.console.progress.LINE_PERIOD_S", 0.0)
    for workers in ("1", "2"):
        assert main(["replay", str(bags), "--workers", workers, "--out", str(tmp_path / workers)])
        told = capsys.readouterr()
        assert told.err.count(f"fleet: {bags}/broken.mcap is not an MCAP file") == 1
        assert "has the content of" in told.err
        counts = [line for line in told.err.splitlines() if COUNT.fullmatch(line)]
        assert counts[-1] == "fleet: 100%, 0 s left 4 done, 1 damaged, 1 equal, 0 left"
        assert len(set(counts)) > 2, "it counts while it works"
        assert "6 bags: 4 with an estimate, 1 equal to another, 1 damaged" in told.out
    assert tables(tmp_path / "1") == tables(tmp_path / "2")

    table = {Path(row["bag"]).name: row for row in rows(tmp_path / "1")}
    assert [*table] == sorted(table, key=lambda name: str(table[name]["bag"]))
    assert len(table) == BAGS + 2
    # the first name of two has the estimate
    assert table["drive_000"]["outcome"] == "equal"
    assert table["drive_000"]["equal_to"] == f"{bags}/again/other_name"
    assert table["drive_000"]["cohesion_pa"] is None
    assert table["broken.mcap"]["outcome"] == "damaged"
    assert f"{bags}/broken.mcap" in table["broken.mcap"]["message"]

    code, summary = run(tmp_path / "replay", bags / "week/drive_001")
    assert code == 0
    alone, row = summary["bags"][0], table["drive_001"]
    same = ("status", "estimates", "used", "span_s", "seconds_taken", "seconds_refused", "runtime")
    assert {name: row[name] for name in same} == {name: alone[name] for name in same}
    assert row["configuration_sha256"] == alone["configuration_sha256"]
    assert row["model_sha256"] == summary["model_sha256"]
    for name, deviation in (("cohesion_pa", "cohesion_sd_pa"), ("tan_phi", "tan_phi_sd")):
        assert row[name] == alone["estimate"][name]["mean"]
        assert row[deviation] == alone["estimate"][name]["sd"]

    messages = estimates(tmp_path / "replay/drive_001_estimates")
    last = {each.header.stamp.sec: each for each in messages}
    seconds = pq.read_table(tmp_path / "1/seconds.parquet").to_pylist()
    ours = [each for each in seconds if each["bag"] == row["bag"]]
    assert len(ours) == len(last) > 5
    for each, message in zip(ours, last.values(), strict=True):
        assert (each["cohesion_pa"], each["tan_phi"]) == (message.cohesion, message.tan_phi)
        assert each["stamp_ns"] % 10**9 == message.header.stamp.nanosec
        assert [each[name] for name in ("cohesion_variance_pa2", "covariance_pa")] == list(
            message.covariance[:2]
        )
    assert math.isclose(
        row["correlation"],
        ours[-1]["covariance_pa"] / (row["cohesion_sd_pa"] * row["tan_phi_sd"]),
    )
    assert {each["bag"] for each in seconds} == {
        row["bag"] for row in table.values() if row["outcome"] == "estimate"
    }


def test_the_same_command_takes_up_what_is_new_and_another_one_is_refused(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "bags"
    shutil.copytree(bags / "week/drive_000", source / "drive_000")
    command = ["replay", str(source), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    first = tables(tmp_path / "out")

    shutil.copytree(bags / "week/drive_001", source / "drive_001")
    assert main([*command, "-p", "use_imu:=false"]) == 2
    assert "use_imu was true, is false" in capsys.readouterr().err
    assert tables(tmp_path / "out") == first
    assert main(command) == 0
    assert [row["outcome"] for row in rows(tmp_path / "out")] == ["estimate", "estimate"]
    second = tables(tmp_path / "out")
    assert main(command) == 0
    assert tables(tmp_path / "out") == second
    assert not (tmp_path / "out/parts").exists()


def test_a_folder_with_other_files_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/bags.parquet").write_text("mine")
    assert main(["replay", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "give a new or empty folder" in capsys.readouterr().err
    assert (tmp_path / "out/bags.parquet").read_text() == "mine"


def test_a_source_that_is_not_there_is_a_wrong_argument(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "nowhere"
    assert main(["replay", str(source), "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    assert str(source) in capsys.readouterr().err


def in_a_worker(arguments: list[str]) -> tuple[int, str]:
    """Run the command in this process; return its exit code and what it says of errors."""
    said = io.StringIO()
    with redirect_stderr(said):
        return main(arguments), said.getvalue()


def test_it_runs_inside_a_daemonic_worker_and_starts_no_others(bags: Path, tmp_path: Path) -> None:
    def command(name: str, *more: str) -> list[str]:
        return ["replay", str(bags / "week"), "--out", str(tmp_path / name), *more]

    with cluster("", workers=1) as on:
        code, _ = on.result(on.start(in_a_worker, command("within")))
        assert code == 0
        code, said = on.result(on.start(in_a_worker, command("two", "--workers", "2")))
    assert (code, said) == (2, "fleet: --workers: this process may start no others: leave it out\n")
    assert main(command("alone", "--workers", "1")) == 0
    assert tables(tmp_path / "within") == tables(tmp_path / "alone")
