# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What ``accuracy`` keeps of each batch of drives, so that a long run can be ended at any time and gone on with later."""

import ast
import dataclasses
import hashlib
import json
import sys
import zipfile
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch

import terramechanics
from terrain_estimator.learning.accuracy import Judged
from terrain_estimator.learning.study import NetShare, Part, ReferenceCheck
from terrain_estimator.model_file import load_model, model_names

_OTHER = "reference and net"
_NO_FIGURES = ("config", "loading", "model_file", "outcome", "parameters", "ros_types")
"""Ends of the names of modules that may change without any figure changing: what is read, asked and printed."""


def digest() -> str:
    """Of the statements and the files that the figures follow from: records of another state of them are another folder's."""
    found = hashlib.sha256()
    for name, module in sorted(sys.modules.items()):
        ours = name.startswith(("terramechanics", "terrain_estimator")) and ".cli" not in name
        if ours and not name.endswith(_NO_FIGURES) and module.__file__:
            found.update(ast.dump(ast.parse(Path(module.__file__).read_bytes())).encode())
    for path in sorted(Path(str(files(terramechanics))).rglob("*.yaml")):
        found.update(path.read_bytes())
    for model in model_names():
        found.update(load_model(model).sha256.encode())
    return found.hexdigest()[:16]


def write_part(part: Part, path: Path) -> None:
    """Write a record, whole or not at all."""
    arrays = {"|".join((*key, field)): value.numpy() for key, judged in part.judged.items() for field, value in judged._asdict().items()}
    said = json.dumps({"reference": list(map(dataclasses.asdict, part.reference)), "net": list(map(dataclasses.asdict, part.net))})
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.stem}.unfinished.npz")
    np.savez(unfinished, allow_pickle=False, **(arrays | {_OTHER: np.array(said)}))
    unfinished.replace(path)


def read_part(path: Path) -> Part | None:
    """A record, None where there is none; raises OSError where it cannot be read."""
    if not path.exists():
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:  # numpy leaves a file that it refuses open
            arrays = dict(stored)
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise OSError(f"{path}: {error}; remove it, it is computed anew") from error
    said = json.loads(str(arrays.pop(_OTHER)))
    fields: dict[tuple[str, str], dict[str, torch.Tensor]] = {}
    for name, values in arrays.items():
        rows, model, field = name.split("|")
        fields.setdefault((rows, model), {})[field] = torch.from_numpy(values)
    judged = {key: Judged(**values) for key, values in fields.items()}
    return Part(judged, [ReferenceCheck(**each) for each in said["reference"]], [NetShare(**each) for each in said["net"]])
