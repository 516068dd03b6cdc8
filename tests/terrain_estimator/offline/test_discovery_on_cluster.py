# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect on a cluster: the same bytes, whatever is killed, and no piece twice."""

import json
import shutil
import signal
import sqlite3
import subprocess
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from terrain_estimator.bags import BagReader, BagWriter
from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.cli.model_by_wheel import main as model_by_wheel
from terrain_estimator.offline.cluster import cluster
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal
from tests.terrain_estimator.bags.support import corrupt
from tests.terrain_estimator.fleet.fleets import PATIENCE_S, Processes, free_port, kill, wait_for
from tests.terrain_estimator.offline import observed_pieces

ONE_EFFECT = ["--library", "drive_drag"]


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    case = draw_cases(Plan((("drive_drag", 1.0),), soil="loose_sand", seconds=18.0), 1, seed=5)[0]
    folder = tmp_path_factory.mktemp("sealed")
    found = [str(bag) for bag in seal(case, folder)]
    broken = folder / "broken"
    broken.mkdir()
    (broken / "broken_0.mcap").write_bytes(b"no bag")
    return [found[0], str(broken), *found[1:4]]


@pytest.fixture(scope="module")
def alone(bags: list[str], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the finding of one process."""
    return finding(bags, tmp_path_factory.mktemp("alone") / "out", "--workers", "1")


def command(bags: list[str], out: Path, *extra: str) -> list[str]:
    return [*bags[:-1], "--hold-out", bags[-1], *ONE_EFFECT, "--out", str(out), *extra]


def finding(bags: list[str], out: Path, *extra: str) -> bytes:
    assert main(command(bags, out, *extra)) == 0
    return (out / "finding.json").read_bytes()


def keys(out: Path) -> set[str]:
    """Return the finished pieces on the disk of a search that has ended."""
    with closing(sqlite3.connect(out / "search.sqlite")) as base:
        return {key for (key,) in base.execute("SELECT key FROM pieces")}


class Observed:
    """A scheduler and workers as processes of their own; what they compute is in a file."""

    def __init__(self, processes: Processes, folder: Path) -> None:
        self.address, self._processes, self._folder = f"127.0.0.1:{free_port()}", processes, folder
        self._log = folder / "log"
        self._log.touch()
        self.scheduler = self.start_scheduler()

    def start_scheduler(self) -> "subprocess.Popen[str]":
        port = self.address.rpartition(":")[2]
        arguments = ("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.scheduler = self._processes.start("dask", *arguments)
        return self.scheduler

    def start_worker(self) -> "subprocess.Popen[str]":
        place = ("--local-directory", self._folder / "scratch", "--no-dashboard", "--no-nanny")
        observed = ("--preload", Path(observed_pieces.__file__))
        return self._processes.start(
            "dask", "worker", self.address, "--nthreads", "1", *place, *observed,
            PIECES_LOG=str(self._log),
        )  # fmt: skip

    def begun(self) -> Counter[str]:
        """Return how often each piece was begun."""
        return Counter(self._log.read_text().split())


def test_kills_of_client_worker_and_scheduler_cost_no_finished_piece(
    bags: list[str], alone: bytes, tmp_path: Path
) -> None:
    assert b'"named"' in alone
    out = tmp_path / "out"
    with Processes() as processes:
        on = Observed(processes, tmp_path)
        workers = [on.start_worker() for _ in range(2)]

        def start() -> "subprocess.Popen[str]":
            options = command(bags, out, "--scheduler", on.address)
            return processes.start("terrain_estimator.cli.find_missing_effect", *options)

        def wait_for_pieces(count: int) -> None:
            def computed() -> bool:
                assert client.poll() is None, client.communicate()[0]
                return len(on.begun()) >= count

            wait_for(computed, f"{count} pieces")

        client = start()
        wait_for_pieces(20)
        kill(client)
        known, before = keys(out), on.begun()
        assert known

        client = start()
        assert client.stdout is not None
        # the workers go on with what the first client gave them: wait until the second is connected
        assert any("finished pieces of this search: it goes on" in line for line in client.stdout)
        wait_for_pieces(len(on.begun()) + 3)
        kill(workers[0])
        wait_for_pieces(len(on.begun()) + 3)
        on.scheduler.send_signal(signal.SIGKILL)
        assert client.wait(PATIENCE_S) == 2
        told = client.stdout.read()
        assert "the scheduler was lost" in told
        assert not known & set(on.begun() - before)
        assert keys(out) >= known
        known, before = keys(out), on.begun()

        kill(workers[1])
        on.scheduler.wait(PATIENCE_S)
        on.start_scheduler()
        workers = [on.start_worker() for _ in range(2)]
        client = start()
        assert client.wait(PATIENCE_S) == 0
        assert not known & set(on.begun() - before)
        # what was under way at a kill is begun again, at most on every worker at each of three
        assert sum(count - 1 for count in on.begun().values()) <= 3 * 4
    assert (out / "finding.json").read_bytes() == alone
    assert sorted(each.name for each in out.iterdir()) == [
        "finding.json", "manifest.json", "model.drive.npz", "model.json", "model.pt", "report.html",
    ]  # fmt: skip


@pytest.fixture
def unfinished(bags: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a search that was ended by an error."""
    out = tmp_path / "out"
    with monkeypatch.context() as patch:

        def ended(*_: object) -> None:
            raise OSError("the disk is full")

        patch.setattr("terrain_estimator.discovery.answer.investigate", ended)
        assert main(command(bags, out, "--workers", "2")) == 2
    assert len(keys(out)) > 10
    return out


def test_another_command_is_refused_by_what_differs(
    bags: list[str], unfinished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = keys(unfinished)
    wheels = ["--rover", "mars_rover", "--soil", "loose_sand", "--track-width", "1"]
    assert model_by_wheel([*wheels, "--out", str(tmp_path / "models")]) == 0
    by_wheel = ["--model", str(tmp_path / "models" / "mars_rover_by_wheel.pt")]
    assert main([*command(bags, unfinished, "--workers", "2"), *by_wheel]) == 2
    assert "results of another search (wheels was null, is {" in capsys.readouterr().err
    assert main([*command(bags, unfinished, "--workers", "2"), "--seed", "3"]) == 2
    assert "results of another search (seed was 0, is 3)" in capsys.readouterr().err
    changed = Path(bags[0]) / "metadata.yaml"
    original = changed.read_bytes()
    changed.write_bytes(original + b"\n")
    assert main(command(bags, unfinished, "--workers", "2")) == 2
    changed.write_bytes(original)
    assert f"content of {bags[0]} was" in capsys.readouterr().err
    assert keys(unfinished) == known


def test_equal_bags_are_refused_on_a_cluster_too(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(bags[0], copy)
    given = [bags[0], str(copy), bags[2], *ONE_EFFECT, "--out", str(tmp_path / "out")]
    assert main([*given, "--workers", "2"]) == 2
    assert "every measurement counts once" in capsys.readouterr().err


def test_a_truncated_bag_is_used_only_with_a_word(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut"
    shutil.copytree(bags[0], cut)
    [file] = cut.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 9 // 10])
    given = [str(cut), *bags[2:4], "--hold-out", bags[-1], *ONE_EFFECT]
    without, using = tmp_path / "without", tmp_path / "using"
    assert main([*given, "--out", str(without), "--workers", "2"]) == 0
    told = capsys.readouterr().err
    assert f"{cut} is left out" in told
    assert "messages are missing at the end; --take-damaged uses what is left" in told
    assert main([*given, "--out", str(using), "--take-damaged"]) == 0
    assert "cut is damaged and used" in capsys.readouterr().err
    for out, used in ((without, False), (using, True)):
        content_of = json.loads((out / "finding.json").read_text())
        assert "messages are missing" in content_of["damaged"]["cut"]
        assert ("cut" in content_of["runs"]) is used
        assert ("cut" in " ".join(content_of["left_out"])) is not used
        assert (
            f"cut is damaged and {'used' if used else 'left out'}"
            in (out / "report.html").read_text()
        )


def test_of_a_bag_with_a_damaged_chunk_the_rest_is_recovered_with_a_word(
    bags: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    damaged = tmp_path / "damaged"
    monkeypatch.setattr("terrain_estimator.bags.writing.part.CHUNK_BYTES", 30_000)
    with BagReader(bags[0]) as reader, BagWriter(damaged) as writer:
        topics = {
            name: writer.add_topic(name, each.type_name) for name, each in reader.topics.items()
        }
        for message in reader.messages():
            writer.write(topics[message.topic], message.data, message.log_time_ns)
    corrupt(next(damaged.glob("*.mcap")), Opcode.CHUNK, which=2, at=500)
    given = [str(damaged), *bags[2:4], *ONE_EFFECT, "--hold-out", bags[-1]]
    assert main([*given, "--out", str(tmp_path / "using"), "--take-damaged"]) == 0
    assert "damaged is damaged and used" in capsys.readouterr().err
    found = json.loads((tmp_path / "using/finding.json").read_text())
    assert "recovered" in found["damaged"]["damaged"]
    assert "damaged" in found["runs"]


def in_a_worker(arguments: list[str]) -> int:
    return main(arguments)


def test_it_runs_inside_a_daemonic_worker(bags: list[str], alone: bytes, tmp_path: Path) -> None:
    with cluster("", workers=1) as on:
        future = on.start(in_a_worker, command(bags, tmp_path / "out"))
        assert on.result(future) == 0
        future = on.start(in_a_worker, command(bags, tmp_path / "two", "--workers", "2"))
        assert on.result(future) == 2
    assert (tmp_path / "out/finding.json").read_bytes() == alone


def test_a_scheduler_that_does_not_answer_is_a_wrong_argument(
    bags: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("terrain_estimator.offline.cluster.PATIENCE_S", 1.0)
    assert main([*bags, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "--scheduler tcp://127.0.0.1:9" in capsys.readouterr().err
