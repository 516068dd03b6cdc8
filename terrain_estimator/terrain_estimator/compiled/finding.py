# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled core of a model: where it lies, and whether it may be used."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rover_parameters.records import ConfigError, shortened
from terrain_estimator.compiled.core import CompiledModel, CoreError
from terrain_estimator.compiled.runtime import CompiledRuntime
from terrain_estimator.config.estimator import COMPILED, RUNTIMES, TORCHSCRIPT
from terrain_estimator.model.loaded import LoadedModel, check_layout
from terrain_estimator.model.metadata import checked_bytes, model_path, read_metadata

MOST_DIFFERENCE = 1e-9
"""[posterior deviations] Difference to TorchScript beyond which a core is not used."""
PLAIN = ".so"
"""How the name of a library for any processor of a kind ends."""
WIDE = {".avx512.so": ("avx512f", "avx512dq", "avx512vl"), ".avx2.so": ("avx2",)}
"""How the names of libraries for wider registers end, the widest first, and what a processor needs
for them, as Linux and compilers call it."""


def find_core(model: Path, sha256: str) -> CompiledModel:
    """Return the compiled core of the TorchScript file ``model`` with this hash.

    It lies beside the model, or where colcon installed it.

    Raises:
        CoreError: there is none, or it is of another model, or differs from TorchScript.
    """
    reasons = []
    for path in _candidates(model):
        try:
            core = CompiledModel(path)
            _check(core, path, sha256)
        except CoreError as error:
            reasons.append(str(error))
        else:
            return core
    if not reasons:
        raise CoreError(
            f"{model.name} has no compiled core: ros2 run terrain_estimator export_core {model}"
            " FOLDER --build makes one"
        )
    raise CoreError("; ".join(reasons))


def _check(core: CompiledModel, path: Path, sha256: str) -> None:
    if core.identity != sha256:
        raise CoreError(
            f"{path}: made from the model {core.identity[:12]}, this is {sha256[:12]}: build it"
            " anew"
        )
    difference = core.difference()
    if not difference <= MOST_DIFFERENCE:
        raise CoreError(
            f"{path}: differs from TorchScript by {difference:.2g} posterior deviations, at most"
            f" {MOST_DIFFERENCE:g} are allowed: build it anew"
        )


def core_folders(model: Path) -> list[Path]:
    """Return where what was built from a model may lie: beside it, or where colcon installed it."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [model.parent, *(Path(p) / "lib" / "terrain_core" for p in prefixes if p)]


def ends_here() -> list[str]:
    """Return how the names of libraries for this processor end, those for wider registers first."""
    try:
        cpuinfo = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        cpuinfo = ""
    has = set(cpuinfo.split())
    return [*(end for end, needed in WIDE.items() if has.issuperset(needed)), PLAIN]


def _candidates(model: Path) -> Iterator[Path]:
    """Yield the libraries that may belong to a model, the faster ones first."""
    ends = ends_here()
    for folder in core_folders(model):
        for end in ends:
            path = folder / (model.stem + end)
            if path.is_file():
                yield path


class Chosen(NamedTuple):
    """A model with the runtime that runs it."""

    model: LoadedModel
    runtime: str  # its name
    why: str  # it is not the compiled one although that was looked for; empty otherwise


def load(name: str, wanted: str) -> Chosen:
    """Return the model of an installed name or a path, run by what is ``wanted``, of RUNTIMES.

    Only where that is TorchScript, torch is imported.

    Raises:
        ConfigError: the runtime is unknown, or ``compiled`` and there is no core.
        ModelFileError: the model cannot be read.
    """
    if wanted not in RUNTIMES:
        raise ConfigError(
            f"parameter runtime: {shortened(wanted)} is not one of {', '.join(RUNTIMES)}"
        )
    why = ""
    if wanted != TORCHSCRIPT:
        try:
            return Chosen(_compiled(model_path(name)), COMPILED, "")
        except CoreError as error:
            if wanted == COMPILED:
                raise ConfigError(f"parameter runtime: {wanted}: {error}") from error
            why = str(error)
    import torch  # noqa: PLC0415 (where nothing else runs the model)

    from terrain_estimator.model.model_file import load_model  # noqa: PLC0415

    torch.set_num_threads(1)  # the order of a sum is part of its result
    return Chosen(load_model(name), TORCHSCRIPT, why)


def _compiled(path: Path) -> LoadedModel:
    metadata = read_metadata(path.with_suffix(".json"))
    checked_bytes(path, metadata)
    model = LoadedModel(metadata, CompiledRuntime(find_core(path, metadata.sha256)))
    check_layout(path, model)
    return model
