# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The programs whose files fail: what each does in a process, and what must hold after it.

Each works in ``work``, whose files fail, and keeps its own notes in ``notes``, whose do not.
"""

import contextlib
import functools
import hashlib
import io
import json
import logging
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from terrain_estimator.bags import BagError, BagReader, BagWriter, Types
from terrain_estimator.cli import recover_bag, replay
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.estimator.saved_state import pack_state
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common.bag_thread import BagThread
from terrain_estimator.nodes.common.state_file import StateFileWriter, restore
from terrain_estimator.offline.state_files import read_state
from tests.drives import drive_messages, write_bag

MESSAGES, SIZE = 30, 100_000
"""Messages of a recording, and their bytes: four files of at least 1 MB."""
STATES = 4
BAG = "recording"


class Ended(NamedTuple):
    """The end of a process."""

    code: int
    lines: list[str]  # from WARN on, or of stderr


class Scenario(NamedTuple):
    """A program, what stands before it runs, and what must hold afterwards."""

    prepare: Callable[[Path], None]  # once, in the folder of the sweep
    begin: Callable[[Path, Path], None]  # (prepared, work) before each run
    act: Callable[[Path, Path, Path], int]  # (prepared, work, notes) in the process: its exit code
    check: Callable[[Path, Path, Path, Ended], list[str]]  # complaints after it
    codes: frozenset[int]
    most_lines: int = 1


def nothing(*_: object) -> None:
    """Do nothing."""


def record(_: Path, work: Path, notes: Path) -> int:
    """Record messages as the recorder does, and note those that were written."""
    written: list[int] = []
    try:
        thread = BagThread(
            RecorderConfig(output=str(work / "run"), fsync_interval_s=0.01, split_size_mb=1.0)
        )
    except (BagError, TimeoutError, MemoryError) as error:
        return _told(f"cannot configure: {error}", 2)
    try:
        topic = thread.give(
            partial(thread.bag.add_topic, "/slip", "msg_defs/msg/WheelSlip")
        ).result()
        for number in range(MESSAGES):
            data = number.to_bytes(4, "little") * (SIZE // 4)
            with _failures_told():
                thread.give(partial(thread.bag.write, topic, data, number + 1), SIZE).result()
                written.append(number)
        thread.close(logging.getLogger().warning)
    except (OSError, MemoryError) as error:
        thread.abandon()
        thread.wait()
        return _told(f"the disk or the memory fails, what was written is kept: {error}", 1)
    finally:
        (notes / "written").write_text(json.dumps(written))
    return _told(thread.bag.compaction_error, 0)


def _told(words: str, code: int) -> int:
    """Log a line, if there is one, and return the exit code."""
    if words:
        logging.getLogger().warning(words)
    return code


@contextlib.contextmanager
def _failures_told() -> Iterator[None]:
    """Go on after an error of a callback, as nodes do, unless the disk fails."""
    try:
        yield
    except MemoryError:
        _told("a callback failed: MemoryError", 0)


def check_recording(_: Path, work: Path, notes: Path, ended: Ended) -> list[str]:
    """Compare the bag with what was written."""
    folder = work / "run"
    if ended.code == 2:
        refused = any("cannot write a bag" in line for line in ended.lines)
        return [f"{folder} is left over"] if refused and folder.exists() else []
    written = json.loads((notes / "written").read_text())
    try:
        with BagReader(folder) as reader:
            found = {int.from_bytes(message.data[:4], "little") for message in reader.messages()}
            finished = reader.finished
    except BagError as error:
        return [f"cannot be read: {error}"] if written else []
    missing = sorted(set(written) - found)
    complaints = [f"{len(missing)} of {len(written)} messages are lost"] if missing else []
    if ended.code == 0 and not (finished and (folder / "metadata.yaml").exists()):
        complaints.append("exit code 0, and the bag is not finished")
    return complaints


@functools.cache
def _model() -> LoadedModel:
    return load_model()


def _content(model: LoadedModel, number: int) -> bytes:
    pipeline = _pipeline()
    arrays = pipeline.save()
    counts = arrays["counts"].copy()
    counts[1] = number
    return pack_state({**arrays, "counts": counts}, model.sha256)


@functools.cache
def _pipeline() -> Pipeline:
    return Pipeline(_model(), EstimatorConfig())


def begin_state(_: Path, work: Path) -> None:
    """Put an earlier state there."""
    (work / "ground.state").write_bytes(_content(_model(), 0))


def keep_state(_: Path, work: Path, notes: Path) -> int:
    """Restore a state and write others, as the estimator does."""
    path, log, kept = work / "ground.state", logging.getLogger(), [0]
    try:
        restore(_pipeline(), path, log)  # type: ignore[arg-type]
        writer = StateFileWriter(path, log.error)
        for number in range(1, STATES):
            with contextlib.suppress(OSError, MemoryError):
                writer.write(_content(_model(), number)).result(20.0)
                kept.append(number)
        writer.close()
    except MemoryError as error:
        return _told(f"cannot configure: {error!r}", 2)
    finally:
        (notes / "kept").write_text(json.dumps(kept))
    return 0


def check_state(_: Path, work: Path, notes: Path, __: Ended) -> list[str]:
    """Compare the state with the last one that was written."""
    kept = json.loads((notes / "kept").read_text())
    number = int(read_state(work / "ground.state", _model().sha256)["counts"][1])
    complaints = [f"state {number}, {kept[-1]} was written"] if number < kept[-1] else []
    names = {path.name for path in work.iterdir()}
    extra = names - {"ground.state", ".ground.state.lock", "ground.state.loaded"}
    return complaints + [f"{name} is left over" for name in sorted(extra)]


def prepare_damaged(prepared: Path) -> None:
    """Write an unfinished recording whose end is cut."""
    writer = BagWriter(prepared / BAG, recording=True)
    topic = writer.add_topic("/slip", "msg_defs/msg/WheelSlip")
    for number in range(MESSAGES):
        writer.write(topic, number.to_bytes(4, "little") * (SIZE // 40), number + 1)
    writer.abandon()
    path = writer.path
    path.write_bytes(path.read_bytes()[:-100])
    (prepared / "sum").write_text(_sum(prepared / BAG))


def recover(prepared: Path, work: Path, _: Path) -> int:
    """Recover the bag by the command."""
    return recover_bag.main([str(prepared / BAG), "--out", str(work / "whole")])


def check_recovered(prepared: Path, work: Path, _: Path, ended: Ended) -> list[str]:
    """Return complaints: the source changed, or the target is neither whole nor absent."""
    changed = _sum(prepared / BAG) != (prepared / "sum").read_text()
    complaints = ["the damaged bag has changed"] if changed else []
    if ended.code and not (work / "whole").exists():
        return complaints
    try:
        with BagReader(work / "whole") as reader:
            count = len(list(reader.messages()))
    except BagError as error:
        return [*complaints, f"a part of a bag is left: {error}"]
    return complaints + ([] if count == MESSAGES - 1 else [f"{count} messages are recovered"])


def prepare_replay(prepared: Path) -> None:
    """Write a short drive and earlier results."""
    types = Types()
    write_bag(prepared / BAG, drive_messages(types.make, 3.0), types)
    with contextlib.redirect_stdout(io.StringIO()):
        assert replay.main([str(prepared / BAG), "--out", str(prepared / "out")]) == 0
    (prepared / "sum").write_text(_sum(prepared / "out"))
    replay.__dict__["load_model"] = lambda _: _model()  # each run would take a second


def begin_replay(prepared: Path, work: Path) -> None:
    """Put earlier results there."""
    shutil.copytree(prepared / "out", work / "out")


def estimate(prepared: Path, work: Path, _: Path) -> int:
    """Replay over earlier results by the command."""
    return replay.main([str(prepared / BAG), "--out", str(work / "out"), "--overwrite"])


def check_replay(_: Path, work: Path, __: Path, ended: Ended) -> list[str]:
    """Return complaints: the estimates are neither the earlier nor the new ones."""
    folder = work / "out" / f"{BAG}_estimates"
    try:
        with BagReader(folder) as reader:
            whole = reader.finished and len(list(reader.messages())) > 50
    except BagError as error:
        return [f"exit code {ended.code}: {error}"]
    left = [path.name for path in (work / "out").iterdir() if "unfinished" in path.name]
    return [*(["the estimates are not whole"] * (not whole)), *(f"{name} is left" for name in left)]


def _sum(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


SCENARIOS = {
    "recorder": Scenario(nothing, nothing, record, check_recording, frozenset({0, 1, 2})),
    "state file": Scenario(nothing, begin_state, keep_state, check_state, frozenset({0, 2}), 2),
    "recover_bag": Scenario(prepare_damaged, nothing, recover, check_recovered, frozenset({0, 2})),
    "replay": Scenario(prepare_replay, begin_replay, estimate, check_replay, frozenset({0, 2}), 2),
}
