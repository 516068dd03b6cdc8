# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of every test; fixtures for processes are in tests/system."""

from collections.abc import Iterator

import hypothesis
import pytest
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


@pytest.fixture(autouse=True, scope="session")
def modules_as_written() -> Iterator[None]:
    """Run TorchScript as the nodes do: torch's optimiser takes 13 s for each model."""
    with torch.jit.optimized_execution(should_optimize=False):  # type: ignore[attr-defined]
        yield
