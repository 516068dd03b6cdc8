# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the regression rows, in their order."""


def row_names(axles: int) -> tuple[str, ...]:
    """Return the names of the rows, in their order.

    A rover has two joints fewer than axles, and each joint has a row.
    """
    joints = axles - 2
    return (
        "velocity",
        "load",
        *(f"torque_{k}" for k in range(axles)),
        "acceleration",
        "moment",
        *(f"bogie_moment{f'_{k}' if joints > 1 else ''}" for k in range(joints)),
    )
