# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A training step as plain NumPy loops over tasks and blocks, with gradients by hand.

Written from the equations alone (Banerjee et al. eqs. 20 to 23; Bishop 2006, sections 3.3 and 5.3):
the reference of its speed, and a second opinion on its gradients. Without the penalties.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
ADAM = (0.9, 0.999, 1e-8)
"""Decay of the mean and of the mean square of a gradient, and what is added to its root."""


@dataclass(frozen=True, slots=True)
class TaskArrays:
    """Regressions of terrain_estimator.learning.regression as arrays, with scaled net inputs."""

    nominal: Floats  # [tasks, blocks, Q, N]
    target: Floats  # [tasks, blocks, Q]
    covariance: Floats  # [tasks, blocks, Q, Q]
    inputs: Floats  # [tasks, blocks, I]
    valid: NDArray[np.bool_]  # [tasks, blocks]
    row_scale: Floats  # [Q]
    mean: Floats  # [N + K] prior mean of the parameters
    precision: Floats  # [N] prior precision of those that are not weights of the net


@dataclass(slots=True)
class TaskBlock:
    """One block of a task: its features [Q, N + K], and intermediates for the gradients."""

    features: Floats
    target: Floats
    inverse: Floats  # [Q, Q] of its covariance with the learnt noise
    activations: tuple[Floats, Floats, Floats]  # inputs and the two hidden layers


def loss_and_gradients(
    weights: list[Floats], tasks: TaskArrays, context: NDArray[np.int64]
) -> tuple[float, list[Floats]]:
    """Mean negative log predictive density of the rows behind the context [nat], and its gradients.

    ``weights``: of the three layers of the net a matrix and a vector each, then log prior precision
    [K] and log noise [Q].
    """
    gradients = [np.zeros_like(each) for each in weights]
    total, rows = 0.0, 0
    for task, given in enumerate(context):
        blocks = {
            place: _forward(weights, tasks, task, place)
            for place in np.flatnonzero(tasks.valid[task]).tolist()
        }
        before = [block for place, block in blocks.items() if place < given]
        for sign, chosen in ((-1.0, list(blocks.values())), (1.0, before)):
            total += sign * _log_marginal(weights, tasks, chosen, sign, gradients)
        for place in blocks:
            if place >= given:
                total -= 0.5 * np.linalg.slogdet(tasks.covariance[task, place])[1]
                rows += tasks.target.shape[-1]
    return total / rows, [each / rows for each in gradients]


def _forward(weights: list[Floats], tasks: TaskArrays, task: int, place: int) -> TaskBlock:
    first, first_bias, second, second_bias, last, last_bias, _, log_noise = weights
    inputs = tasks.inputs[task, place]
    hidden = np.tanh(first @ inputs + first_bias)
    deeper = np.tanh(second @ hidden + second_bias)
    columns = (last @ deeper + last_bias).reshape(len(tasks.row_scale), -1) * tasks.row_scale[
        :, None
    ]
    noise = np.diag((np.exp(log_noise) * tasks.row_scale) ** 2)
    inverse = np.linalg.inv(tasks.covariance[task, place] + noise)
    features = np.hstack([tasks.nominal[task, place], columns])
    return TaskBlock(features, tasks.target[task, place], inverse, (inputs, hidden, deeper))


def _log_marginal(
    weights: list[Floats],
    tasks: TaskArrays,
    blocks: list[TaskBlock],
    sign: float,
    gradients: list[Floats],
) -> float:
    """Return the log density of the blocks' targets; add ``sign`` times its gradients."""
    prior = np.concatenate([tasks.precision, np.exp(weights[-2])])
    precision, pull = np.diag(prior), prior * tasks.mean
    value = 0.5 * (np.log(prior).sum() - tasks.mean @ pull)
    for block in blocks:
        precision = precision + block.features.T @ block.inverse @ block.features
        pull = pull + block.features.T @ block.inverse @ block.target
        value -= 0.5 * block.target @ block.inverse @ block.target
        value += 0.5 * (
            np.linalg.slogdet(block.inverse)[1] - len(block.target) * np.log(2.0 * np.pi)
        )
    covariance = np.linalg.inv(precision)
    posterior = covariance @ pull
    learnt = len(tasks.precision)
    spread = np.diag(covariance) + (posterior - tasks.mean) ** 2
    gradients[-2] += sign * 0.5 * (1.0 - prior * spread)[learnt:]
    for block in blocks:
        _backward(weights, tasks, block, posterior, covariance, sign, gradients)
    return float(value + 0.5 * (posterior @ pull - np.linalg.slogdet(precision)[1]))


def _backward(
    weights: list[Floats],
    tasks: TaskArrays,
    block: TaskBlock,
    posterior: Floats,
    covariance: Floats,
    sign: float,
    gradients: list[Floats],
) -> None:
    """Add the gradients of the log density by a block's noise, features and weights of the net."""
    residual = block.inverse @ (block.target - block.features @ posterior)
    seen = block.inverse @ block.features
    by_covariance = 0.5 * (
        np.outer(residual, residual) - block.inverse + seen @ covariance @ seen.T
    )
    gradients[-1] += (
        sign * 2.0 * np.diag(by_covariance) * (np.exp(weights[-1]) * tasks.row_scale) ** 2
    )
    by_features = np.outer(residual, posterior) - seen @ covariance
    inputs, hidden, deeper = block.activations
    back = sign * (by_features[:, len(tasks.precision) :] * tasks.row_scale[:, None]).ravel()
    for place, below in ((4, deeper), (2, hidden), (0, inputs)):
        gradients[place] += np.outer(back, below)
        gradients[place + 1] += back
        back = (weights[place].T @ back) * (1.0 - below**2)


@dataclass(slots=True)
class Adam:
    """Kingma and Ba 2015, algorithm 1."""

    rates: list[float]  # of every array
    mean: list[Floats]
    square: list[Floats]
    steps: int = 0

    def step(self, weights: list[Floats], gradients: list[Floats]) -> None:
        """Move the weights in place."""
        self.steps += 1
        slow, slower, tiny = ADAM
        for place, (weight, gradient) in enumerate(zip(weights, gradients, strict=True)):
            self.mean[place] = slow * self.mean[place] + (1.0 - slow) * gradient
            self.square[place] = slower * self.square[place] + (1.0 - slower) * gradient**2
            mean, square = (
                self.mean[place] / (1.0 - slow**self.steps),
                self.square[place] / (1.0 - slower**self.steps),
            )
            np.subtract(weight, self.rates[place] * mean / (np.sqrt(square) + tiny), out=weight)
