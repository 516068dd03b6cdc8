# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz targets: every reader of foreign files, and their recovery.

A target takes bytes. Any exception but the documented one is a finding. Each has seeds: sound files
from which a fuzzer starts.
"""

import contextlib
import functools
import hashlib
import io
import itertools
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from rover_parameters.files import read_parameters
from rover_parameters.guarded_json import parse_json
from rover_parameters.parameters import configure, template
from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import read_yaml
from terrain_estimator.bags import BagError, BagReader, Definition, Types, installed_definition
from terrain_estimator.bags.format.metadata import METADATA_FILE
from terrain_estimator.bags.recovery.recovery import recover
from terrain_estimator.config.estimator import EstimatorConfig, EstimatorNodeConfig
from terrain_estimator.discovery.single_wheel.table import WheelTableError, read_table
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.saved_state import StateFileError, pack_state, unpack_state
from terrain_estimator.importing.mapping import Mapping, read_mapping
from terrain_estimator.importing.rose.doubts import faults
from terrain_estimator.importing.rose.samples import find
from terrain_estimator.importing.rose.schema import (
    CURRENTS,
    ORIENTATION,
    POSITION,
    RATES,
    TIME,
    RoseOptions,
)
from terrain_estimator.importing.rose.table import read_table as read_trial
from terrain_estimator.importing.samples import CsvError, read_samples
from terrain_estimator.model.archive import ArchiveError, checked_archive
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import MODELS, ModelFileError, read_metadata
from terrain_estimator.model.model_file import load_model
from terrain_estimator.offline.state_files import read_state
from terramechanics.presets import PRESETS, load_rover, load_soil
from tests.terrain_estimator.bags.support import finished_bag, killed_recording

DEFINED = "nav_msgs/msg/Odometry"
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
MESSAGES = 200
"""Number of a bag's messages that are decoded."""


@dataclass(frozen=True, slots=True)
class Target:
    """One reader to fuzz."""

    read: Callable[[Path], None]  # raises what is a finding
    name: str  # of the file that it reads
    seeds: Callable[[], list[bytes]]
    weight: float = 1.0  # of its share of the time

    def __call__(self, data: bytes) -> None:
        """Read these bytes."""
        path = _folder() / self.name
        path.write_bytes(data)
        self.read(path)


@functools.cache
def _folder() -> Path:
    """Return a temporary folder, in memory where possible."""
    shared = Path("/dev/shm")
    holder = tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None)
    _HOLDERS.append(holder)
    return Path(holder.name)


_HOLDERS: list[tempfile.TemporaryDirectory[str]] = []


def read_bag(path: Path) -> None:
    """Open a bag, list and decode its messages."""
    try:
        with BagReader(path) as reader:
            assert reader.span.count >= 0
            assert all(isinstance(note, str) for note in reader.notes)
            for message in itertools.islice(reader.messages(), MESSAGES):
                _decode(reader, message)
    except BagError:
        return


def _decode(reader: BagReader, message: object) -> None:
    """Decode a message; an error does not end the bag."""
    try:
        reader.decode(message)  # type: ignore[arg-type]
    except BagError:
        return


def read_definition(path: Path) -> None:
    """Make a class of a message definition, its default message, and read that back."""
    text = path.read_bytes().decode(errors="replace")
    types = Types()
    try:
        types.add(Definition(DEFINED, text, ""))
        message = types.make(DEFINED)
        again = types.deserialize(types.serialize(message), DEFINED)
        assert type(again) is type(message)
    except BagError:
        return


def read_archive_of_model(path: Path) -> None:
    """Check an archive; torch reads it only where nothing is refused."""
    try:
        content = checked_archive(path.read_bytes())
    except ArchiveError:
        return
    with contextlib.suppress(RuntimeError, ValueError):
        torch.jit.load(io.BytesIO(content))  # type: ignore[no-untyped-call]


def read_bag_folder(path: Path) -> None:
    """Read a folder with this metadata.yaml and no other file."""
    assert path.name == METADATA_FILE
    try:
        BagReader(path.parent).close()
    except BagError:
        return


def recover_bag(path: Path) -> None:
    """Recover a bag; the result has to be a bag."""
    target = path.with_name("recovered")
    shutil.rmtree(target, ignore_errors=True)
    try:
        recovery = recover(path, target)
    except BagError:
        return
    if recovery.span.count:
        with BagReader(target) as reader:
            assert reader.span.count == recovery.span.count


def restore_state(path: Path) -> None:
    """Continue from a saved state."""
    try:
        Estimator(_model(), EstimatorConfig().core).restore(read_state(path, _model().sha256))
    except StateFileError:
        return


def read_archive(path: Path) -> None:
    """Put a first line with the right size and sum before arrays, like a hostile file."""
    payload = path.read_bytes()
    header = json.loads(pack_state({}, _model().sha256).partition(b"\n")[0])
    header |= {"size": len(payload), "sha256": hashlib.sha256(payload).hexdigest()}
    try:
        unpack_state(json.dumps(header).encode() + b"\n" + payload, _model().sha256, str(path))
    except StateFileError:
        return


@functools.cache
def _model() -> LoadedModel:
    return load_model()


def _refusing(read: Callable[[Path], object], *errors: type[Exception]) -> Callable[[Path], None]:
    def attempt(path: Path) -> None:
        try:
            read(path)
        except errors:
            return

    return attempt


def _stable(value: object) -> None:
    """Check that what was read consists of plain values alone."""
    kinds = (dict, list, str, int, float, type(None))
    assert isinstance(value, kinds)
    for item in (
        value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    ):
        _stable(item)


def _samples(path: Path) -> None:
    for _ in read_samples(path, _mapping()):
        pass


@functools.cache
def _mapping() -> Mapping:
    return read_mapping(EXAMPLES / "field_run.yaml")


def _rows() -> list[bytes]:
    return [b"\n".join((EXAMPLES / "field_run.csv").read_bytes().splitlines()[:4])]


def _bags() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        finished, killed = (
            finished_bag(Path(folder, "finished"), 3),
            killed_recording(Path(folder, "killed"), 3),
        )
        return [(finished / "finished_0.mcap").read_bytes(), killed.read_bytes()]


def _metadata() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return [(finished_bag(Path(folder, "run"), 1) / METADATA_FILE).read_bytes()]


def _states() -> list[bytes]:
    return [pack_state(Estimator(_model(), EstimatorConfig().core).save(), _model().sha256)]


def _files(folder: Path, pattern: str) -> Callable[[], list[bytes]]:
    return lambda: [path.read_bytes() for path in sorted(folder.glob(pattern))]


def _definitions() -> list[bytes]:
    kinds = (
        "nav_msgs/msg/Odometry",
        "msg_defs/msg/WheelSlip",
        "diagnostic_msgs/msg/DiagnosticArray",
    )
    return [installed_definition(kind).text.encode() for kind in kinds]


def _parameters() -> list[bytes]:
    return [template("/estimator", configure(EstimatorNodeConfig, {})).encode()]


_TABLE = b"""trial,slip,normal_load_N,wheel_rate_rad_s,sinkage_mm,drawbar_pull_N,slip_angle_deg
1,0.2,64.0,0.5,12.5,3.1,0
2,-0.1,64.0,0.5,9,-2,0
"""

_ROSE = RoseOptions(track_width=0.55, torque_gain=1.0, torque_sd=0.1)


def _rose_trial(path: Path) -> None:
    rover = load_rover("four_wheel_rover")
    found = find(read_trial(path, _ROSE), rover, _ROSE)
    assert all(isinstance(each, str) for each in faults(found, rover, _ROSE))
    assert all(sample.velocity.deviation > 0.0 for sample in found.samples)


def _rose_tables() -> list[bytes]:
    """Return half a second of a rover that drives along x at 0.3 m/s with a little slip."""
    rows = [",".join((TIME, *POSITION, *ORIENTATION, *RATES, *CURRENTS))]
    for row in range(30):
        time = row / 60.0
        rows.append(f"{time:.4f},{0.3 * time:.4f},0,0,0,0,0,1,2,2,2,2,90,90,91,91")
    return ["\n".join(rows).encode()]


TARGETS = {
    "bag": Target(read_bag, "run.mcap", _bags, weight=5.0),
    "recovery": Target(recover_bag, "run.mcap", _bags),
    "bag metadata": Target(read_bag_folder, METADATA_FILE, _metadata, weight=5.0),
    "definition": Target(read_definition, "x.msg", _definitions, weight=5.0),
    "yaml": Target(
        _refusing(lambda path: _stable(read_yaml(path)), ConfigError),
        "any.yaml",
        lambda: [*_metadata(), *_files(EXAMPLES, "*.yaml")(), *_parameters()],
        weight=5.0,
    ),
    "json": Target(
        _refusing(lambda path: parse_json(path.read_bytes()), ConfigError),
        "any.json",
        _files(MODELS, "*.json"),
    ),
    "model archive": Target(
        read_archive_of_model, "model.pt", lambda: [(MODELS / "mars_rover.pt").read_bytes()]
    ),
    "soil": Target(
        _refusing(load_soil, ConfigError), "soil.yaml", _files(PRESETS / "soils", "*.yaml")
    ),
    "rover": Target(
        _refusing(load_rover, ConfigError), "rover.yaml", _files(PRESETS / "rovers", "*.yaml")
    ),
    "parameters": Target(
        _refusing(
            lambda path: configure(EstimatorNodeConfig, read_parameters(path, "/estimator")),
            ConfigError,
        ),
        "p.yaml",
        _parameters,
    ),
    "mapping": Target(
        _refusing(read_mapping, ConfigError),
        "mapping.yaml",
        _files(EXAMPLES, "field_run.yaml"),
        weight=5.0,
    ),
    "model metadata": Target(
        _refusing(read_metadata, ModelFileError), "model.json", _files(MODELS, "*.json")
    ),
    "state": Target(restore_state, "ground.state", _states),
    "state archive": Target(
        read_archive, "ground.state", lambda: [state.partition(b"\n")[2] for state in _states()]
    ),
    "samples": Target(_refusing(_samples, CsvError), "run.csv", _rows, weight=5.0),
    "rose trial": Target(_refusing(_rose_trial, CsvError), "Processed_Data.csv", _rose_tables),
    "wheel table": Target(
        _refusing(lambda path: read_table(path, "rim"), WheelTableError),
        "table.csv",
        lambda: [_TABLE],
    ),
}
