# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Names from bags, files and messages reach no terminal and no log with control characters."""

import io
import sys
from pathlib import Path

import pytest
from mcap.records import Channel, Header, Message, Schema

from rover_parameters.printable import PrintableStream, printable_output, unguarded
from terrain_estimator.bags import Types, installed_definition
from terrain_estimator.bags.reading.records import MAGIC
from terrain_estimator.cli import recover_bag, replay
from terrain_estimator.console.progress import ProgressReport
from tests.drives import drive_messages, write_bag
from tests.terrain_estimator.bags.support import SLIP, TYPES
from tests.terrain_estimator.bags.test_bombs import built

HOSTILE = "\x1b]0;title\x07\x1b[2J\u202e\x9b1m"
OBEYED = set("\x1b\x07\u202e\x9b")


def test_a_command_prints_the_names_in_a_bag_visibly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    schema = Schema(
        id=1, data=installed_definition(TYPES[SLIP]).text.encode(), encoding="ros2msg", name=HOSTILE
    )
    path = tmp_path / "run.mcap"
    channel = Channel(id=1, topic=f"/{HOSTILE}", message_encoding="cdr", metadata={}, schema_id=1)
    message = Message(channel_id=1, log_time=1, data=b"x", publish_time=1, sequence=0)
    path.write_bytes(MAGIC + built(Header(profile="ros2", library=""), schema, channel, message))
    assert replay.main([str(path)]) == 2
    assert recover_bag.main([str(path), "--out", str(tmp_path / HOSTILE.replace("/", ""))]) == 0
    printed = capsys.readouterr()
    assert not OBEYED & set(printed.out + printed.err)
    assert r"\x1b]0;title\x07" in printed.err
    assert r"\x1b[2J\u202e\x9b1m" in printed.out


def test_a_report_of_a_hostile_frame_and_wheel_is_printed_visibly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    types = Types()
    messages = list(drive_messages(types.make, 1.0))
    for _, _, message in (each for each in messages if hasattr(each[2], "wheel")):
        message.wheel = [f"{name}{HOSTILE}" for name in message.wheel]
        message.header.frame_id = HOSTILE
    bag = write_bag(tmp_path / "drive", messages, types)
    replay.main([str(bag), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr()
    assert not OBEYED & set(printed.out + printed.err)


def test_everything_printed_is_made_visible_and_the_streams_are_put_back(
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = sys.stdout, sys.stderr
    with printable_output(), printable_output():
        sys.stdout.write(HOSTILE)
        sys.stdout.writelines([HOSTILE])
        sys.stderr.write(HOSTILE)
        assert not sys.stdout.isatty()
        assert (unguarded(sys.stdout), unguarded(sys.stderr)) == before
    assert (sys.stdout, sys.stderr) == before
    printed = capsys.readouterr()
    assert not OBEYED & set(printed.out + printed.err)
    assert printed.out.count("title") == 2


def test_a_bar_moves_the_cursor_but_its_texts_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", PrintableStream(terminal))
    with ProgressReport(f"reading {HOSTILE}") as report:
        report.at(0.5, HOSTILE)
    assert "\x1b[" in terminal.getvalue()
    assert "\x1b]0;" not in terminal.getvalue()
    assert not set("\x07\u202e\x9b") & set(terminal.getvalue())
