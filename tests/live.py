# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The node's pipeline without the node, for what a live node has to give."""

import dataclasses

from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline


def live_pipeline(config: EstimatorConfig = EstimatorConfig()) -> Pipeline:  # noqa: B008 (frozen)
    """Return the pipeline of a node with these parameters."""
    chosen = load(config.model, config.runtime)
    return Pipeline(chosen.model, dataclasses.replace(config, runtime=chosen.runtime))
