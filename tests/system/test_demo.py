# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The demo and the rate check as a user starts them, with every process of theirs."""

import contextlib
import json
import signal
from pathlib import Path

import pytest

from terrain_estimator.bags import BagReader
from terrain_estimator.cli.rate_check import JITTER_LIMIT_MS, RATE_HZ, keeps_its_rate
from terrain_estimator.console.interrupting import INTERRUPTED
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.messaging.arrival_rates import timing
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES
from tests.samples import sampled
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

TEN_HZ = (*INPUT_TYPES, *OUTPUT_TYPES)


def demo(start: Starter, domain_id: int, out: Path, *more: str) -> Process:
    return start(
        "terrain_estimator",
        "demo",
        "--out",
        str(out),
        "--domain-id",
        str(domain_id),
        "--duration",
        "12",
        *more,
    )


def in_domain(domain_id: int) -> list[str]:
    """Command lines of the processes in a ROS domain, without this one."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"ROS_DOMAIN_ID={domain_id}\0".encode() in (folder / "environ").read_bytes():
                found.append((folder / "cmdline").read_bytes().replace(b"\0", b" ").decode())
    return found


def test_the_demo_drives_records_replays_and_draws(
    start: Starter, domain_id: int, tmp_path: Path
) -> None:
    # live, half a second of simulated time is too late for a message; the replay has it in time
    process = demo(start, domain_id, tmp_path / "demo", "--real-time-factor", "2")
    assert process.wait(120.0) == 0, process.output
    summary = json.loads((tmp_path / "demo/summary.json").read_text())
    assert summary["simulated_s"] == pytest.approx(12.0)
    assert {topic: summary["messages"][topic] for topic in TEN_HZ} == dict.fromkeys(TEN_HZ, 120)
    assert summary["rate_hz"].keys() >= set(TEN_HZ)
    assert summary["jitter_ms_p99"].keys() >= set(TEN_HZ)
    for name in ("cohesion_pa", "tan_phi"):
        value = summary["estimate"][name]
        assert abs(value["mean"] - value["truth"]) < 4.0 * value["sd"]
    assert summary["replay"]["identical_to_live"] is True
    assert summary["replay"]["estimates"] == 120
    with BagReader(summary["bag"]) as reader:
        assert reader.finished
        assert reader.topics["/ground_truth/terrain"].count >= 1
    assert (tmp_path / "demo/estimate.png").stat().st_size > 10_000
    assert "identical to live" in process.output
    assert process.output.count(" kPa, truth") >= 2


@pytest.mark.parametrize(
    "number",
    sampled([signal.SIGINT, signal.SIGKILL], [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]),
    ids=lambda number: number.name,
)
def test_a_demo_that_is_ended_early_leaves_no_process_behind(
    start: Starter, domain_id: int, tmp_path: Path, number: signal.Signals
) -> None:
    process = demo(start, domain_id, tmp_path / "demo", "--real-time-factor", "0.5")
    process.wait_for_output(" kPa, truth", timeout=60.0)
    assert len(in_domain(domain_id)) == 5
    process.signal(number)
    assert process.wait() == (-number if number is signal.SIGKILL else INTERRUPTED)
    assert "Traceback" not in process.output
    wait_until(
        lambda: not in_domain(domain_id),
        "every process has ended",
        seen=lambda: in_domain(domain_id),
    )
    if number is signal.SIGKILL:
        (left,) = (tmp_path / "demo").glob(".results.*.unfinished/bag")
        with BagReader(left) as reader:
            assert reader.finished
    else:  # half a demo takes the place of no other
        assert not (tmp_path / "demo").exists()


def test_a_demo_with_a_wrong_soil_says_what_the_simulator_said(
    start: Starter, domain_id: int, tmp_path: Path
) -> None:
    with ResultFolder(tmp_path / "demo").renewing("summary.json", "log") as earlier:
        (earlier / "summary.json").write_text("of a demo before")
    process = demo(start, domain_id, tmp_path / "demo", "--soil", "cheese")
    assert process.wait(60.0) == 2
    assert "cheese" in process.output
    assert "unfinished" not in process.output
    assert "cheese" in (tmp_path / "demo/log/simulator.log").read_text()
    assert (tmp_path / "demo/summary.json").read_text() == "of a demo before"
    left = {path.name for path in (tmp_path / "demo").iterdir()}
    assert left == {"log", "summary.json", "manifest.json"}


def test_rate_and_jitter_are_those_of_the_arrivals() -> None:
    regular = [step * 100_000_000 for step in range(101)]
    assert timing(regular).rate_hz == pytest.approx(10.0)
    assert timing(regular).jitter_ms_p99 == pytest.approx(0.0)
    assert timing(regular, time_factor=5.0).rate_hz == pytest.approx(2.0)
    late = [*regular[:50], regular[50] + 20_000_000, *regular[51:]]
    assert timing(late).jitter_ms_p99 == pytest.approx(20.0, abs=1.0)
    assert timing([1]).messages == 1


@pytest.mark.parametrize(
    ("rate", "jitter", "kept"),
    [(10.05, 5.0, True), (10.2, 5.0, False), (9.85, 5.0, False), (10.0, 10.0, False)],
)
def test_a_topic_keeps_its_rate_within_one_percent_and_ten_milliseconds(
    rate: float, jitter: float, *, kept: bool
) -> None:
    assert (
        keeps_its_rate({"rate_hz": {"odom": rate}, "jitter_ms_p99": {"odom": jitter}}, "odom")
        is kept
    )
    assert not keeps_its_rate({"rate_hz": {}, "jitter_ms_p99": {}}, "odom")
    assert (RATE_HZ, JITTER_LIMIT_MS) == (10.0, 10.0)
