# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Records of the accuracy study, one for each batch of drives."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import torch

from studies.accuracy.cells import CellBatch, NetShare, ReferenceCheck
from studies.accuracy.scores import Judged
from studies.records import read_record, write_record

_OTHER = "reference and net"


def write_part(part: CellBatch, path: Path) -> None:
    """Write a record, whole or not at all."""
    arrays = {
        "|".join((*key, field)): value.numpy()
        for key, judged in part.judged.items()
        for field, value in judged._asdict().items()
    }
    said = json.dumps(
        {
            "reference": list(map(dataclasses.asdict, part.reference)),
            "net": list(map(dataclasses.asdict, part.net)),
        }
    )
    write_record(arrays | {_OTHER: np.array(said)}, path)


def read_part(path: Path) -> CellBatch | None:
    """A record, None where there is none; raises OSError where it cannot be read."""
    arrays = read_record(path)
    if arrays is None:
        return None
    said = json.loads(str(arrays.pop(_OTHER)))
    fields: dict[tuple[str, str], dict[str, torch.Tensor]] = {}
    for name, values in arrays.items():
        rows, model, field = name.split("|")
        fields.setdefault((rows, model), {})[field] = torch.from_numpy(values)
    judged = {key: Judged(**values) for key, values in fields.items()}
    return CellBatch(
        judged,
        [ReferenceCheck(**each) for each in said["reference"]],
        [NetShare(**each) for each in said["net"]],
    )
