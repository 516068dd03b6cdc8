# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Built cores with other recorded answers: the core's own check finds that it differs from them."""

import ctypes
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from terrain_estimator.compiled.core import CompiledModel
from terrain_estimator.model.metadata import model_path
from terrain_estimator.observation import Floats
from tests.terrain_estimator.compiled.built_cores import BUILT

ANSWERS = 6
"""Numbers of an answer: means and variances of c and tan phi, mean and variance of the velocity."""
_KEPT = ("strength_mean", "strength_covariance", "forecast", "forecast_variance")


def altered(library: Path, copy: Path, change: Callable[[Floats], object]) -> None:
    """Write a ``copy`` of a core whose recorded answers [n, ANSWERS] are changed in place.

    Raises:
        LookupError: they are not in the library once.
    """
    content = library.read_bytes()
    numbers = np.frombuffer(content[: len(content) // 8 * 8])
    answers = _answers(library)
    first, near = numbers[: 1 - answers.size], answers[0, 0]
    starts = np.flatnonzero((first > near - 1e-6) & (first < near + 1e-6))
    found = [
        at
        for at in starts
        if np.allclose(numbers[at : at + answers.size], answers.ravel(), 1e-6, 0.0, equal_nan=True)
    ]
    if len(found) != 1:
        raise LookupError(f"{library}: the recorded answers are found {len(found)} times")
    changed = numbers.copy()
    change(changed[found[0] : found[0] + answers.size].reshape(answers.shape))
    copy.write_bytes(changed.tobytes() + content[changed.nbytes :])


def _answers(library: Path) -> Floats:
    """Return what a core answers to its recorded drive [n, ANSWERS]."""
    core, functions = CompiledModel(library), ctypes.PyDLL(str(library))
    functions.terrain_drive.restype = ctypes.POINTER(ctypes.c_double)
    count, size = ctypes.c_int64(), ctypes.c_int64()
    first = functions.terrain_drive(ctypes.byref(count), ctypes.byref(size))
    drive = np.ctypeslib.as_array(first, (count.value, size.value))
    _, told = core.run(core.initial(), drive, _KEPT, 8)
    return told[:, [0, 1, 2, 5, 6, 7]]


def model_with_core(folder: Path, name: str, change: Callable[[Floats], object]) -> Path:
    """Return a model in ``folder`` that is mars_rover, beside a core whose answers are changed."""
    for ending in (".pt", ".json"):
        shutil.copy(model_path("mars_rover").with_suffix(ending), folder / (name + ending))
    altered(BUILT / "mars_rover.so", folder / f"{name}.so", change)
    return folder / f"{name}.pt"
