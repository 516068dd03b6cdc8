# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of every test; fixtures for processes are in tests/system."""

import hypothesis
import torch

# The same examples in every run, and no time limit for one example: a busy machine is no failure.
# For many others give
# --hypothesis-profile=many, and the files with properties.
hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, database=None)
hypothesis.settings.register_profile(
    "many", max_examples=5000, deadline=None, database=None, print_blob=True
)
hypothesis.settings.load_profile("ci")
torch.set_num_threads(
    1
)  # as the nodes do: the tensors are small, and threads that wait for each other are slower
torch.jit.optimized_execution(should_optimize=False).__enter__()  # type: ignore[attr-defined]
# As terrain_estimator.model.torchscript.running does: torch's optimiser takes 13 s a model.
