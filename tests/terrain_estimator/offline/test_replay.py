# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""replay: recordings in, estimates out, the same every time, and faults of a bag in words."""

import dataclasses
import hashlib
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import BagReader, BagWriter, Split, Types
from terrain_estimator.cli import add_effect, recover_bag, replay
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.estimator.saved_state import pack_state
from terrain_estimator.files.atomic import write_file
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES
from tests.drives import STEP_NS, drive_messages, write_bag
from tests.live import live_pipeline
from tests.terrain_estimator.offline.replays import (
    SECONDS,
    estimates,
    identical,
    run,
    with_estimates,
)


def test_every_instant_gets_an_estimate_and_the_summary_says_so(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, summary = run(tmp_path, bag)
    assert code == 0
    result = summary["bags"][0]
    steps = round(SECONDS * 1e9 / STEP_NS)
    assert (
        result["estimates"]
        == result["outcomes"]["ACCEPTED"]
        == steps
        == len(estimates(tmp_path / "drive_estimates"))
    )
    assert {
        topic: counters["received"] for topic, counters in result["inputs"].items()
    } == dict.fromkeys(INPUT_TYPES, steps)
    assert result["estimate"]["cohesion_pa"]["sd"] > 0.0
    assert result["times_real_time"] > 1.0
    assert summary["configuration"]["use_imu"] is True
    assert "drive" in capsys.readouterr().out


def test_the_table_fits_a_terminal_of_80_columns(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "dumb")  # whose width rich takes for 80
    _, summary = run(tmp_path, bag)
    table = capsys.readouterr().out.partition("\ndrive: ")[0]
    assert max(len(line.rstrip()) for line in table.splitlines()) <= 80
    assert "…" not in table
    assert summary["bags"][0]["status"] in table


def test_two_replays_are_identical_in_one_process_and_in_another(bag: Path, tmp_path: Path) -> None:
    run(tmp_path / "one", bag)
    run(tmp_path / "two", bag)
    command = [
        sys.executable,
        "-m",
        "terrain_estimator.cli.replay",
        str(bag),
        "--out",
        str(tmp_path / "three"),
    ]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0
    assert identical(tmp_path / "one/drive_estimates", tmp_path / "two/drive_estimates")
    assert identical(tmp_path / "one/drive_estimates", tmp_path / "three/drive_estimates")


def test_it_needs_no_ros() -> None:
    program = (
        "import sys, terrain_estimator.cli.replay; sys.exit(any(name.split('.')[0] in ('rclpy',"
        " 'msg_defs') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_a_bare_file_is_read_like_its_folder(bag: Path, tmp_path: Path) -> None:
    run(tmp_path / "folder", bag)
    code, _ = run(tmp_path / "file", next(bag.glob("*.mcap")))
    assert code == 0
    assert identical(tmp_path / "folder/drive_estimates", tmp_path / "file/drive_0_estimates")


def test_several_bags_are_runs_of_their_own(bag: Path, tmp_path: Path) -> None:
    types = Types()
    other = write_bag(tmp_path / "other", drive_messages(types.make, 3.0, seed=2), types)
    code, summary = run(tmp_path / "out", other, bag)
    assert code == 0
    assert [each["estimates"] for each in summary["bags"]] == [30, 80]
    run(tmp_path / "alone", bag)
    assert identical(tmp_path / "out/drive_estimates", tmp_path / "alone/drive_estimates")


def test_bags_of_one_name_get_those_of_their_folders_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    names = ("first/run.1", "first/run.2", "second/run.2")
    bags = [
        write_bag(tmp_path / name, drive_messages(types.make, 0.1 * (10 + at)), types)
        for at, name in enumerate(names)
    ]
    code, summary = run(tmp_path / "out", *bags)
    assert (code, [each["estimates"] for each in summary["bags"]]) == (0, [10, 11, 12])
    called = ("run.1", "first_run.2", "second_run.2")
    assert [each["estimates_bag"] for each in summary["bags"]] == [
        str(tmp_path / f"out/{name}_estimates") for name in called
    ]
    assert [len(estimates(tmp_path / f"out/{name}_estimates")) for name in called] == [10, 11, 12]
    assert "second_run.2" in capsys.readouterr().out
    assert run(tmp_path / "twice", bags[0], bags[0]) == (2, {})
    assert "run.1 is given twice: every bag is replayed once" in capsys.readouterr().err
    assert recover_bag.main([str(bags[0])]) == 0
    assert (tmp_path / "first/run.1_recovered").is_dir()


def test_a_bag_of_which_nothing_is_used_gives_no_estimate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The prior is no estimate, whatever the reason."""
    types = Types()
    events = list(drive_messages(types.make, 2.0))
    for topic, _, message in events:
        if topic == "wheel_slip":
            message.wheel = [f"wheel_{at}" for at in range(6)]
    wrong = write_bag(tmp_path / "wrong", events, types)
    code, summary = run(tmp_path / "out", wrong, "--report", tmp_path / "report.html")
    assert code == replay.NOTHING
    assert (summary["bags"][0]["estimates"], summary["bags"][0]["estimate"]) == (20, {})
    words = capsys.readouterr().out
    assert "NO ESTIMATE, no observation was used: 20 WRONG_WHEELS (publish the wheel" in words
    assert "got wheels ['wheel_0'" in words
    assert "another rover needs a model of its own" in words
    assert words.count("publish the wheel names of the rover file") == 1
    assert "2.75" not in words
    assert "NO ESTIMATE" in (tmp_path / "report.html").read_text()


def test_the_sizes_of_named_effects_are_printed_and_in_the_summary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "drag.pt"
    assert add_effect.main(["--effect", "drive_drag=0.2+-0.1", "--out", str(model)]) == 0
    types = Types()
    drive = write_bag(tmp_path / "drive", drive_messages(types.make, SECONDS), types)
    code, summary = run(tmp_path / "out", drive, "--model", model)
    assert code == 0
    [size] = summary["bags"][0]["effects"]
    last = estimates(tmp_path / "out/drive_estimates")[-1]
    assert (size["name"], size["unit"]) == ("drive_drag", "N m s/rad")
    assert (size["mean"], size["sd"]) == (last.effect_value[0], last.effect_stddev[0])
    assert size["lower_95"] < size["mean"] - size["sd"] < size["mean"] < size["upper_95"]
    assert re.search(
        rf"drive: drive_drag {size['mean']:.4g} N m s/rad \(95 %: .* to .*\)",
        capsys.readouterr().out,
    )


def test_a_status_that_is_not_identified_is_explained_and_a_renamed_topic_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types, drive = Types(), tmp_path / "drive"
    with BagWriter(drive) as writer:
        topics = {
            name: writer.add_topic("/imu/data" if name == "imu" else f"/{name}", type_name)
            for name, type_name in INPUT_TYPES.items()
        }
        for name, stamp, message in drive_messages(types.make, SECONDS):
            writer.write(topics[name], types.serialize(message), stamp)
    code, summary = run(tmp_path / "out", drive)
    assert code == 0
    text = summary["bags"][0]["status_text"]
    assert text.startswith("degraded; ")
    assert "rows missing: acceleration" in text
    assert estimates(tmp_path / "out/drive_estimates")[-1].status_text == text
    told = capsys.readouterr().out
    assert f"drive: {text}\n" in told
    assert f"{drive}: no topic /imu, whose rows are missing; of its type there is /imu/data" in told


def test_readings_at_50_hz_are_averaged_and_the_summary_names_their_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stamps of a drive are put five times closer, in a bag and in a pipeline as live."""
    types = Types()
    events = list(drive_messages(types.make, SECONDS))
    for stamp in {id(each.header.stamp): each.header.stamp for _, _, each in events}.values():
        passed_ns = stamp.sec * 10**9 + stamp.nanosec - 100 * 10**9
        stamp.sec, stamp.nanosec = divmod(100 * 10**9 + passed_ns // 5, 10**9)
    fast = write_bag(tmp_path / "fast", events, types)
    code, summary = run(tmp_path / "out", fast)
    assert code == 0
    result = summary["bags"][0]
    assert result["rates"] == [{"hz": 50.0, "treatment": "AVERAGE", "readings": 80}]
    assert "80 readings at 50 Hz, averaged to 10 Hz" in capsys.readouterr().out
    live = live_pipeline()
    answers = [each for topic, _, message in events for each in live.add(topic, message)]
    answers += live.flush()
    replayed = estimates(tmp_path / "out/fast_estimates")
    assert len(replayed) == len(answers) == 17
    assert [each.cohesion for each in replayed] == [
        answer.update.estimate.mean[0] for answer in answers
    ]
    assert (replayed[-1].observations_used, replayed[-1].observations_waiting) == (10, 6)
    assert (result["used"], result["waiting"]) == (10, 6), "the first reading was withdrawn"
    assert "mean of 5 readings at 50 Hz" in replayed[-1].status_text


@pytest.mark.parametrize(
    "arguments",
    [
        ["--namespace", "/rover1"],
        [f for topic in INPUT_TYPES for f in ("--remap", f"{topic}:=/rover1/{topic}")],
    ],
)
def test_topics_of_other_names_are_found(tmp_path: Path, arguments: list[str]) -> None:
    types = Types()
    named = write_bag(tmp_path / "named", drive_messages(types.make, SECONDS), types, "/rover1")
    code, summary = run(tmp_path / "out", named, *arguments)
    assert code == 0
    assert summary["bags"][0]["estimates"] == 80


def test_topics_of_other_names_are_named_where_nothing_maps_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    named = write_bag(tmp_path / "named", drive_messages(types.make, 1.0), types, "/rover1")
    assert run(tmp_path / "out", named)[0] == replay.WRONG
    assert "/rover1/wheel_slip" in capsys.readouterr().err


def test_an_unfinished_bag_is_replayed_up_to_its_end_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "run", recording=True) as writer:
        types = Types()
        topics = {
            name: writer.add_topic(f"/{name}", type_name) for name, type_name in INPUT_TYPES.items()
        }
        for name, stamp, message in drive_messages(types.make, SECONDS):
            writer.write(topics[name], types.serialize(message), stamp)
        file = next((tmp_path / "run").glob("*.mcap"))
        recorded = file.read_bytes()  # as it is on the disk while it is recorded, without chunks
    file.write_bytes(recorded[: len(recorded) // 2])
    code, summary = run(tmp_path / "out", tmp_path / "run")
    assert code == 0
    assert summary["bags"][0]["missing_s"] == pytest.approx(SECONDS / 2, abs=0.5)
    assert 30 <= summary["bags"][0]["estimates"] <= 45
    assert re.search(r"the last \d+\.\d s are missing", capsys.readouterr().out)
    bare = tmp_path / "cut.mcap"
    bare.write_bytes(file.read_bytes())
    code, summary = run(tmp_path / "out", bare)
    assert code == 0
    assert summary["bags"][0]["missing_s"] is None  # nothing beside the file tells
    assert "without a footer" in summary["bags"][0]["notes"][0]


@pytest.mark.parametrize("content", [b"", b"not a bag", b"\x89MCAP0\r\n", bytes(1000)])
def test_a_file_that_is_no_bag_is_refused_by_name(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "foreign.mcap"
    path.write_bytes(content)
    assert run(tmp_path / "out", path)[0] == replay.WRONG
    assert "foreign.mcap" in capsys.readouterr().err


def test_a_bag_of_other_types_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "other") as writer:
        for name in INPUT_TYPES:
            writer.write_message(
                writer.add_topic(f"/{name}", "std_msgs/msg/Header"),
                writer.types.make("std_msgs/msg/Header"),
                0,
            )
    assert run(tmp_path / "out", tmp_path / "other")[0] == replay.WRONG
    assert "std_msgs/msg/Header" in capsys.readouterr().err


def test_a_missing_bag_does_not_stop_the_others(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, summary = run(tmp_path / "out", tmp_path / "nothing", bag)
    assert code == replay.WRONG
    assert [each["estimates"] for each in summary["bags"]] == [80]
    assert "nothing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "use_imuu:=true"], ["use_imuu", "use_imu"]),
        (["-p", "pairing_timeout:=long"], ["pairing_timeout", "long"]),
        (["-p", "rover:=paper_rover"], ["paper_rover", "mass"]),
        (["--model", "nowhere.pt"], ["nowhere.pt"]),
        (["--params-file", "nowhere.yaml"], ["nowhere.yaml"]),
        (["--remap", "a:=b"], ["a:=b"]),
    ],
)
def test_wrong_arguments_are_named(
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: list[str],
) -> None:
    assert run(tmp_path, bag, *arguments)[0] == replay.WRONG
    said = capsys.readouterr().err
    assert all(word in said for word in words)


def test_parameters_change_the_estimate_and_are_part_of_its_origin_and_of_the_report(
    bag: Path, tmp_path: Path
) -> None:
    path, page = tmp_path / "p.yaml", tmp_path / "pages/run.html"
    path.write_text(
        "estimator: {ros__parameters: {use_torque: false, prior: {tan_phi_mean: 0.5, tan_phi_sd:"
        " 0.05}}}\n"
    )
    _, plain = run(tmp_path / "plain", bag)
    code, changed = run(tmp_path / "changed", bag, "--params-file", path, "--report", page)
    assert code == 0
    sha256 = changed["bags"][0]["configuration_sha256"]
    assert sha256 != plain["bags"][0]["configuration_sha256"]
    assert estimates(tmp_path / "changed/drive_estimates")[0].tan_phi == pytest.approx(0.5, abs=0.1)
    assert set(estimates(tmp_path / "changed/drive_estimates")[-1].rows) == {
        "velocity",
        "load",
        "acceleration",
        "moment",
        "bogie_moment",
    }
    text, result = page.read_text(encoding="utf-8"), changed["bags"][0]
    for number in (
        1e-3 * result["estimate"]["cohesion_pa"]["mean"],
        result["estimate"]["tan_phi"]["sd"],
        float(result["estimates"]),
    ):
        assert repr(number) in text
    not_default = "Not at their defaults: use_torque, prior.tan_phi_mean and prior.tan_phi_sd."
    for words in (
        changed["model_sha256"],
        sha256,
        not_default,
        "Banerjee",
    ):
        assert words in text


def test_the_comparison_finds_a_live_estimate_that_differs(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path / "live", bag)
    for spoil in (False, True):
        folder = tmp_path / f"recorded_{spoil}"

        def spoilt(message: Any, wrong: int = 40 if spoil else -1) -> Any:
            other = message.sequence == wrong
            cohesion = np.nextafter(message.cohesion, np.inf) if other else message.cohesion
            return dataclasses.replace(message, cohesion=cohesion)

        with_estimates(folder, bag, tmp_path / "live/drive_estimates", spoilt)
        code, summary = run(tmp_path / f"out_{spoil}", folder, "--compare")
        assert code == (replay.DIFFERENT if spoil else 0)
        assert summary["bags"][0]["identical_to_live"] is not spoil
    assert "terrain_estimate differs from live: message 40, cohesion" in capsys.readouterr().out


def test_a_node_that_went_on_from_a_saved_state_is_repeated_from_it_and_lost_messages_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, types = load_model(), Types()
    events = list(drive_messages(types.make, 4.0))
    before, live = Pipeline(model, EstimatorConfig()), Pipeline(model, EstimatorConfig())
    for name, _, message in events[:115]:
        before.add(name, message)
    state = tmp_path / "ground.state"
    write_file(state, pack_state(before.save(), model.sha256))
    live.restore(read_state(state, model.sha256))
    lost = {("wheel_slip", 30), ("wheel_slip", 31), ("wheel_sinkage", 35)}
    with BagWriter(tmp_path / "recorded", recording=True, split=Split(duration_s=0.5)) as writer:
        topics = {
            name: writer.add_topic(f"/{name}", type_name)
            for name, type_name in (INPUT_TYPES | OUTPUT_TYPES).items()
        }
        for name, stamp, message in events[115:]:
            if (name, getattr(message, "sequence", 0)) in lost:
                continue
            writer.write(topics[name], types.serialize(message), stamp)
            for answer in live.add(name, message):
                for output, said in answer.messages(types.make, live.meta).items():
                    writer.write(topics[output], types.serialize(said), stamp)
    assert len(list((tmp_path / "recorded").glob("*.mcap"))) == 4
    code, summary = run(tmp_path / "out", tmp_path / "recorded", "--compare", "--state", state)
    assert code == 0
    assert summary["bags"][0]["identical_to_live"]
    first = estimates(tmp_path / "out/recorded_estimates")[0]
    assert (first.observations_used, first.observations_waiting) == (20, 4)
    with BagReader(tmp_path / "out/recorded_estimates") as reader:
        assert (
            reader.metadata["terrain_estimator"]["state_sha256"]
            == hashlib.sha256(state.read_bytes()).hexdigest()
        )
    assert {
        name: counters["lost"]
        for name, counters in summary["bags"][0]["inputs"].items()
        if counters["lost"]
    } == {
        "wheel_slip": 2,
        "wheel_sinkage": 1,
    }
    assert re.search("recorded: wheel_slip: .*2 lost", capsys.readouterr().out)


def test_a_damaged_state_is_named(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ground.state").write_bytes(b"no state")
    assert run(tmp_path, bag, "--state", tmp_path / "ground.state")[0] == replay.WRONG
    assert "ground.state: is no state file" in capsys.readouterr().err


def test_a_comparison_without_live_estimates_is_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, bag, "--compare")[0] == replay.WRONG
    assert (
        "drive has no /terrain_estimate to compare with: leave out --compare"
        in capsys.readouterr().err
    )
