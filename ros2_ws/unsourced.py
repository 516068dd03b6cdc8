# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Explain in a line, instead of a traceback, that a shell has not sourced the workspace.

ros2_ws/compile copies this module into .venv, whose interpreters import it as they start: so it
imports next to nothing.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import TracebackType

PACKAGES = ("msg_defs", "rover_parameters", "rover_sim_node", "terrain_estimator", "terramechanics")
# pathlib would take longer to import than all of this
SETUP = os.path.join(os.path.dirname(sys.prefix), "ros2_ws", "setup.bash")  # noqa: PTH118, PTH120


def advice(package: str) -> str:
    """Return the line to print."""
    return (
        f"{package} is not in this environment: source the workspace in this shell, then start"
        f" again:  . {SETUP}"
    )


class LastFinder:
    """Finder of last resort, whose error also reaches programs that handle import errors."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        """Return None; raise ModuleNotFoundError for a package of the workspace."""
        del path, target
        package = name.partition(".")[0]
        # In the repository's root Python takes the folders of the packages for packages: those have
        # no file.
        if package in PACKAGES and getattr(sys.modules.get(package), "__file__", None) is None:
            raise ModuleNotFoundError(advice(package), name=package)


def say(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print the advice for a missing package of the workspace, else the traceback.

    An executable looks for its package's distribution, whose name has hyphens.
    """
    package = (error.name or "").replace("-", "_") if isinstance(error, ModuleNotFoundError) else ""
    if package in PACKAGES:
        sys.stderr.write(f"{advice(package)}\n")
    else:
        sys.__excepthook__(kind, error, trace)


sys.meta_path.append(LastFinder)
sys.excepthook = say
