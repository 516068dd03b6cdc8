# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The TorchScript module of a model, checked and loaded.

Module and description (:mod:`terrain_estimator.model.metadata`) are checked against each other
first, then the module's source and tensors as data (:mod:`terrain_estimator.model.archive`). Only
then does torch read what was checked, and the module's methods and shapes are compared.
"""

import io
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from rover_parameters.printable import printable
from rover_parameters.records import shortened
from terrain_estimator.model.archive import ArchiveError, checked_archive
from terrain_estimator.model.loaded import LoadedModel, check_layout
from terrain_estimator.model.metadata import (
    Metadata,
    ModelFileError,
    checked_bytes,
    model_path,
    read_metadata,
)
from terrain_estimator.model.torchscript import torchscript_model

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
LOADING_S = 60.0
"""[s] of processor time that a model may take to load, which takes 0.3 s otherwise."""


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


def load_model(name: str = "") -> LoadedModel:
    """Check a model by installed name or path, and load its module. Raises ModelFileError."""
    path = model_path(name)
    archive, metadata = checked_model(path)
    with ends_after(LOADING_S, f"{path}: loading took more than {LOADING_S:g} s: not a model"):
        return _loaded(path, archive, metadata)


def checked_model(path: Path) -> tuple[bytes, Metadata]:
    """Return a model's TorchScript archive and its description, both checked as data.

    Raises:
        ModelFileError: one of the two files is not what it says.
    """
    metadata = read_metadata(path.with_suffix(".json"))
    content = checked_bytes(path, metadata)
    try:
        return checked_archive(content), metadata
    except ArchiveError as error:
        raise ModelFileError(
            f"{path}: not a model of this package: {error}: train it again, or load only models"
            " that you trust"
        ) from error


def _loaded(path: Path, archive: bytes, metadata: Metadata) -> LoadedModel:
    try:
        load = torch.jit.load
        module = load(io.BytesIO(archive), map_location="cpu")  # type: ignore[no-untyped-call]
    except (RuntimeError, ValueError) as error:
        raise ModelFileError(
            f"{path}: not a TorchScript module: {str(error).splitlines()[0]}"
        ) from error
    _check_methods(path, module)
    model = torchscript_model(module, metadata)
    try:
        check_layout(path, model)
    except RuntimeError as error:  # of TorchScript, with lines of source
        reason = shortened(str(error).strip().splitlines()[-1])
        raise ModelFileError(f"{path}: its methods fail: {reason}: train it again") from error
    return model


def _check_methods(path: Path, module: torch.jit.ScriptModule) -> None:
    """Check that the methods are those of this version."""
    missing = [name for name in _METHODS if not hasattr(module, name)]
    if missing:
        raise ModelFileError(
            f"{path}: has no method {missing[0]!r}, so it is not a model of this package"
        )
    for name, wanted in _METHODS.items():
        _, _, taken = str(getattr(module, name).schema).partition("(")[2].partition(" self")
        if (found := taken.rpartition(") -> ")[0].removeprefix(", ")) != wanted:
            raise ModelFileError(
                f"{path}: method {name} takes ({found}), this version needs ({wanted}): train it"
                " again (make train)"
            )
