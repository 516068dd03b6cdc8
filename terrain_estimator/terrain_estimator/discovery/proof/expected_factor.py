# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a held-out run should show of an effect, were it there."""

import torch

from terrain_estimator.discovery.evidence.expected import loss, stage
from terrain_estimator.discovery.evidence.fit import Fit
from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import RunEquations
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.proof.held_out import Model
from terrain_estimator.discovery.runs import Blocks


def expected_factor(
    nominal: Nominal, run: Blocks, models: tuple[Model, Model], fits: tuple[Fit, Fit]
) -> float:
    """Return the log Bayes factor [nat] to expect of a run, were the second model's effect there.

    It is that over the first model, see :mod:`terrain_estimator.discovery.evidence.expected`.
    ``fits`` are those of the run's own unknowns under both. A run that hardly excites the effect,
    or whose own c and tan phi make up for it, gives next to nothing. Noise beyond that of the
    sensors is, row by row, that of the model that leaves less: what a wrong effect leaves is no
    noise. The size counts as exact.
    """
    equations, unknowns = fits[1].equations[0], fits[1].point.runs[0]
    excess = torch.minimum(equations.excess, fits[0].equations[0].excess)
    mask = torch.ones(len(nominal.row_names), dtype=torch.float64)
    unchanged, changed = (
        RunEquations(run, rows_of(nominal, run, model.hypothesis), mask).shortfall(
            unknowns, tuple(model.values.tolist()), equations.around
        )
        for model in models
    )
    change = (unchanged - changed).unsqueeze(-1)
    return loss([stage(equations, unknowns, excess)], [change], None).nats
