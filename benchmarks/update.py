# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of one observation in the exported model: python -m benchmarks.update [MODEL ...].

With several models (a file of the version before and one of now) the ratios to the first are
printed too; a ratio measured side by side depends less on the machine than a time.
"""

import sys
import time

import numpy as np
import torch

from studies.accuracy.scores import draw_drives
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import DEFAULT_MODEL
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_soil

DRIVES = 12
ROUNDS = 3  # the fastest counts: what else the machine does only slows it down


def microseconds(model: LoadedModel, packed: torch.Tensor) -> tuple[float, float]:
    """Return the mean of all observations, and the median of those that close a block.

    ``drives`` are packed [N, T, P].
    """
    module, block = model.module, model.metadata.block
    means, closing = [], []
    with torch.inference_mode():
        for drive in packed:
            state, spent = module.initial(), []
            for observation in drive:
                start = time.thread_time()
                state = module.update(state, observation)
                spent.append(1e6 * (time.thread_time() - start))
            means.append(np.mean(spent))
            closing.append(np.median(spent[block - 1 :: block]))
    return float(np.mean(means)), float(np.mean(closing))


def main(names: list[str]) -> None:
    """Measure the models one after the other, in rounds."""
    torch.set_num_threads(1)
    models = [load_model(name) for name in names or [DEFAULT_MODEL]]
    rover = models[0].rover
    packed = torch.cat(
        [
            draw_drives(rover, load_soil(soil), "S1", DRIVES // 3, 0.05, 3).tasks.measured
            for soil in ("loose_sand", "compact_sand", "regolith")
        ]
    )
    for model in models:
        microseconds(model, packed[:2])  # torch compiles
    found = [min(microseconds(model, packed) for _ in range(ROUNDS)) for model in models]
    for model, (mean, closing) in zip(models, found, strict=True):
        ratio = mean / found[0][0]
        print(
            f"{model.model_id:30s} {mean:6.0f} us an observation, {closing:6.0f} us one that closes"
            f" a block, {ratio:.2f} of the first"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
