# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Plot of a training."""

from pathlib import Path

import matplotlib as mpl

from terrain_estimator.learning.training import Progress


def draw_curves(history: list[Progress], path: Path, title: str) -> None:
    """Draw loss and overlap over the iterations, as a PNG."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 (after the choice of a backend without display)

    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
    steps = [progress.iteration for progress in history]
    losses = sorted(progress.loss for progress in history)
    upper.plot(steps, [progress.loss for progress in history], linewidth=0.8)
    upper.axhline(1.419, color="grey", linestyle=":", label="unit noise alone: (1 + log 2 pi) / 2")
    upper.set(
        ylabel="loss [nat per row]",
        title=title,
        ylim=(1.3, max(2.5, losses[int(0.98 * (len(losses) - 1))])),
    )
    upper.legend()
    lower.semilogy(steps, [progress.overlap for progress in history], linewidth=0.8)
    lower.set(ylabel="overlap with physics [1]", xlabel="iteration")
    figure.savefig(path, dpi=110)
    plt.close(figure)
