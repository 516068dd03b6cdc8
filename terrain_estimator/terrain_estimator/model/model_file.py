# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model file: a TorchScript module and a JSON file that describes it.

``NAME.pt`` holds the whole model; ``NAME.json`` holds rover, soil, rows, versions, how it was
trained, and the size and sha256 of the module. The two are checked against each other first, then
the module's source and tensors as data (:mod:`terrain_estimator.model.archive`). Only then does
torch read what was checked, and the module's methods and shapes are compared.
"""

import dataclasses
import hashlib
import io
import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

import terrain_estimator
from rover_parameters.guarded_json import parse_json
from rover_parameters.printable import printable
from rover_parameters.records import ConfigError, build, number, shortened
from rover_parameters.regular_file import open_regular, read_regular
from terrain_estimator.model.archive import ArchiveError, checked_archive
from terrain_estimator.model.packing import PACKED_WHEEL_FIELDS, packed_size, scalar_fields
from terrain_estimator.model.prior import Prior
from terrain_estimator.model.rows import row_names
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

FORMAT = 4
"""Version of the interface: the state's fields, the packed observation, the methods."""
MODELS = Path(terrain_estimator.__file__).parent / "models"
DEFAULT_MODEL = "mars_rover"
_METHODS = {
    "initial": "",
    "initial_with_prior": "Tensor mean, Tensor sd, Tensor soils, float drift",
    "update": "Dict(str, Tensor) state, Tensor observation",
    "discard": "Dict(str, Tensor) state",
    "predict": "Dict(str, Tensor) state, Tensor observation",
    "estimate": "Dict(str, Tensor) state",
    "effects": "Dict(str, Tensor) state",
}
"""Methods that the module must have, with their arguments in TorchScript's words."""
_LARGEST_FILE = 64 << 20
_LARGEST_METADATA = 1 << 20
LOADING_S = 60.0
"""[s] of processor time that a model may take to load, which takes 0.3 s otherwise."""


class ModelFileError(ValueError):
    """A model file is missing, damaged, foreign or of another version.

    The message names the file, the fault, and the remedy.
    """


@dataclass(frozen=True, slots=True)
class Training:
    """The training of the learnt part."""

    seed: int
    iterations: int
    loss: float = number(
        "final training loss: mean negative log predictive density of a row", "nat"
    )
    torch_version: str = ""
    options: tuple[
        str, ...
    ] = ()  # effective ones of ``train``, in its own words; a file that is older has none


@dataclass(frozen=True, slots=True)
class AddedEffect:
    """A named effect that the model estimates beside c and tan phi."""

    name: str  # of terramechanics.effects
    unit: str  # of its size
    mean: float = number("prior mean of its size", "unit of the effect")
    sd: float = number(
        "prior standard deviation of its size", "unit of the effect", 0.0, exclusive=True
    )


@dataclass(frozen=True, slots=True)
class Metadata:
    """The content of the JSON file beside the module."""

    format: int
    model_id: str
    sha256: str
    size: int
    observation_axle_fields: tuple[str, ...]
    observation_scalar_fields: tuple[str, ...]
    rows: tuple[str, ...]
    parameters: tuple[str, ...]  # of the posterior, in their order
    block: int  # observations that are averaged into one
    rover: Rover
    soils: tuple[
        Soil, ...
    ]  # that the model knows; their order is that of the state's probabilities
    training: Training
    prior: Prior  # of ground and rover, before any measurement
    step_s: float = number(
        "time between observations that the model was trained for", "s", 0.0, exclusive=True
    )
    effects: tuple[AddedEffect, ...] = ()

    @property
    def prior_mean(self) -> tuple[float, float]:
        """Prior means of c [Pa] and tan phi."""
        return self.prior.cohesion_pa, self.prior.tan_phi

    @property
    def prior_sd(self) -> tuple[float, float]:
        """Prior standard deviations of c [Pa] and tan phi."""
        return self.prior.cohesion_sd_pa, self.prior.tan_phi_sd


@dataclass(frozen=True, slots=True)
class LoadedModel:
    """A model that passed every check."""

    module: torch.jit.ScriptModule
    metadata: Metadata

    @property
    def rover(self) -> Rover:
        """The rover that the model is for."""
        return self.metadata.rover

    @property
    def model_id(self) -> str:
        """Name and version."""
        return self.metadata.model_id

    @property
    def sha256(self) -> str:
        """Return the sha256 of the module file."""
        return self.metadata.sha256

    @property
    def effects(self) -> tuple[AddedEffect, ...]:
        """Named effects that the model estimates."""
        return self.metadata.effects

    @property
    def rows(self) -> tuple[str, ...]:
        """All regression rows that the model can use."""
        return self.metadata.rows


@contextmanager
def running() -> Iterator[None]:
    """Run the methods of a module without gradients and without torch's optimiser.

    Optimised graphs are a tenth faster, but making them takes every process 3 s and 80 MB.
    """
    as_written = torch.jit.optimized_execution(should_optimize=False)  # type: ignore[attr-defined]
    with torch.inference_mode(), as_written:
        yield


@contextmanager
def ends_after(limit_s: float, why: str) -> Iterator[None]:
    """End this process with one line and exit code 2 once it has used so much processor time.

    Nothing else can end a method of a module: it holds no lock of Python, and heeds no signal.
    """
    over = threading.Event()
    last_s = time.process_time() + limit_s

    def watch() -> None:
        while not over.wait(0.5):
            if time.process_time() > last_s:
                os.write(2, f"{printable(why)}\n".encode())
                os._exit(2)

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        over.set()


def model_names() -> tuple[str, ...]:
    """Return the names of the models that come with the package."""
    return tuple(sorted(path.stem for path in MODELS.glob("*.pt")))


def model_path(name: str) -> Path:
    """Return the module file of an installed model's name, of a path, or of '' for the default."""
    installed = MODELS / f"{name or DEFAULT_MODEL}.pt"
    path = installed if installed.is_file() else Path(name)
    if not path.is_file():
        names = ", ".join(model_names()) or "there is none"
        raise ModelFileError(
            f"model {name!r}: no such file; give the path of a .pt file, or an installed model:"
            f" {names}"
        )
    return path


def load_model(name: str = "") -> LoadedModel:
    """Check and load a model by installed name or path. Raises ModelFileError."""
    path = model_path(name)
    metadata = read_metadata(path.with_suffix(".json"))
    content = _checked_bytes(path, metadata)
    try:
        archive = checked_archive(content)
    except ArchiveError as error:
        raise ModelFileError(
            f"{path}: not a model of this package: {error}: train it again, or load only models"
            " that you trust"
        ) from error
    with ends_after(LOADING_S, f"{path}: loading took more than {LOADING_S:g} s: not a model"):
        return _loaded(path, archive, metadata)


def _loaded(path: Path, archive: bytes, metadata: Metadata) -> LoadedModel:
    try:
        load = torch.jit.load
        module = load(io.BytesIO(archive), map_location="cpu")  # type: ignore[no-untyped-call]
    except (RuntimeError, ValueError) as error:
        raise ModelFileError(
            f"{path}: not a TorchScript module: {str(error).splitlines()[0]}"
        ) from error
    model = LoadedModel(module, metadata)
    try:
        with running():
            _check_interface(path, model)
    except RuntimeError as error:  # of TorchScript, with lines of source
        reason = shortened(str(error).strip().splitlines()[-1])
        raise ModelFileError(f"{path}: its methods fail: {reason}: train it again") from error
    return model


def read_metadata(path: Path) -> Metadata:
    """Read the JSON file beside a module. Raises ModelFileError that names file, key and value."""
    try:
        content: Any = parse_json(read_regular(path, _LARGEST_METADATA))
    except OSError as error:
        raise ModelFileError(
            f"{path}: cannot be read ({error.strerror}): a model is a .pt file with its .json"
            " beside it"
        ) from error
    except ConfigError as error:
        raise ModelFileError(f"{path}: not valid JSON: {error}") from error
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise ModelFileError(
            f"{path}: format is {shortened(found)}, this version reads {FORMAT}: train the model"
            " again (make train)"
        )
    try:
        return build(Metadata, content, str(path))
    except ConfigError as error:
        raise ModelFileError(str(error)) from error


def write_metadata(path: Path, metadata: Metadata) -> None:
    """Write the JSON file beside a module."""
    path.write_text(json.dumps(dataclasses.asdict(metadata), indent=2) + "\n", encoding="utf-8")


def fingerprint(path: Path) -> tuple[str, int]:
    """Return sha256 and size of a file."""
    content = path.read_bytes()
    return hashlib.sha256(content).hexdigest(), len(content)


def _checked_bytes(path: Path, metadata: Metadata) -> bytes:
    """Return the file's content after its checks.

    It is read once, so that the checked bytes are loaded even where the file is replaced meanwhile.
    """
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            content = file.read(metadata.size + 1) if metadata.size <= _LARGEST_FILE else b""
    except OSError as error:
        raise ModelFileError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) != metadata.size:
        raise ModelFileError(
            f"{path}: has {size} bytes, {path.with_suffix('.json').name} says {metadata.size}, at"
            f" most {_LARGEST_FILE} are read: copy both files again"
        )
    sha256 = hashlib.sha256(content).hexdigest()
    if sha256 != metadata.sha256:
        raise ModelFileError(
            f"{path}: sha256 is {sha256}, {path.with_suffix('.json').name} says {metadata.sha256}:"
            " the file is damaged"
        )
    return content


def _check_interface(path: Path, model: LoadedModel) -> None:
    """Check that methods and shapes are those of this version."""
    missing = [name for name in _METHODS if not hasattr(model.module, name)]
    if missing:
        raise ModelFileError(
            f"{path}: has no method {missing[0]!r}, so it is not a model of this package"
        )
    for name, wanted in _METHODS.items():
        _, _, taken = str(getattr(model.module, name).schema).partition("(")[2].partition(" self")
        if (found := taken.rpartition(") -> ")[0].removeprefix(", ")) != wanted:
            raise ModelFileError(
                f"{path}: method {name} takes ({found}), this version needs ({wanted}): train it"
                " again (make train)"
            )
    axles, rates = len(model.rover.axle_x), bool(model.effects)
    fields = (model.metadata.observation_axle_fields, model.metadata.observation_scalar_fields)
    if fields != (PACKED_WHEEL_FIELDS, scalar_fields(axles, rates=rates)):
        raise ModelFileError(
            f"{path}: was trained for other fields of an observation, train it again (make train)"
        )
    state = model.module.initial()
    rows = row_names(axles)
    if model.rows != rows or state["single_misses"].shape[0] != len(rows):
        raise ModelFileError(
            f"{path}: has rows {', '.join(model.rows)}, this version needs {', '.join(rows)}: train"
            " it again (make train)"
        )
    effects = model.module.effects(state).shape[0]
    if effects != len(model.effects):
        raise ModelFileError(
            f"{path}: estimates {effects} named effects, its .json names {len(model.effects)}"
        )
    length, parameters = state["block"].shape[-1], state["expected"].shape[0]
    if length != packed_size(axles, rates=rates):
        raise ModelFileError(
            f"{path}: takes observations of {length} numbers, {axles} axles need"
            f" {packed_size(axles, rates=rates)}"
        )
    if tuple(model.module.estimate(state).shape) != (3, 2):
        raise ModelFileError(
            f"{path}: estimates numbers of shape {tuple(model.module.estimate(state).shape)},"
            " expected (3, 2)"
        )
    if parameters != len(model.metadata.parameters):
        raise ModelFileError(
            f"{path}: has {parameters} parameters, its .json names {len(model.metadata.parameters)}"
        )
