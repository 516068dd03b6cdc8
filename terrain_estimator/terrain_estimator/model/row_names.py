# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the regression rows, in their order."""

BESIDE = ("lateral_velocity", "yaw_rate")
"""Last rows of a model by wheel, of how the body moves beside."""
ROLL_MOMENT = "roll_moment"
"""Balance of a model by wheel that is not spent on missing sinkages."""


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


def row_names_by_wheel(wheels: int, joints: int) -> tuple[str, ...]:
    """Return the names of the rows of a model whose wheels are estimated one by one."""
    return (
        "velocity",
        "load",
        *(f"torque_{k}" for k in range(wheels)),
        "acceleration",
        "moment",
        *("bogie_moment" for _ in range(joints)),
        ROLL_MOMENT,
        *BESIDE,
    )
