# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of every test. What starts processes has its fixtures in tests/system."""

import hypothesis
import torch

# The same examples in every run, and no time limit for one example: a busy machine is no failure.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("repeatable")
torch.set_num_threads(1)  # as the nodes do: the tensors are small, and threads that wait for each other are slower
