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


def expected_factor(nominal: Nominal, run: Blocks, without: Model, there: Model, fit: Fit) -> float:
    """Return the log Bayes factor [nat] to expect of a run, were the effect of a model ``there``.

    It is that over the model ``without``, see :mod:`terrain_estimator.discovery.evidence.expected`.
    ``fit`` is that of the run's own unknowns under ``there``. A run that hardly excites the effect,
    or whose own c and tan phi make up for it, gives next to nothing.
    """
    equations, unknowns = fit.equations[0], fit.point.runs[0]
    mask = torch.ones(len(nominal.row_names), dtype=torch.float64)
    changed, unchanged = (
        RunEquations(run, rows_of(nominal, run, model.hypothesis), mask).shortfall(
            unknowns, tuple(model.values.tolist()), equations.around
        )
        for model in (there, without)
    )
    change = (unchanged - changed).unsqueeze(-1)
    return loss([stage(equations, unknowns, equations.excess)], [change], None).nats
