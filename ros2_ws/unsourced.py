# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a program says, in place of a traceback, that was started without the workspace's environment.

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
SETUP = os.path.join(os.path.dirname(sys.prefix), "ros2_ws", "setup.bash")  # noqa: PTH118, PTH120 - pathlib takes longer than all of this


def advice(package: str) -> str:
    """One line."""
    return (
        f"{package} is not in this environment: source the workspace in this shell, then start"
        f" again:  . {SETUP}"
    )


class LastFinder:
    """Is asked for a module when nobody else has it: the words reach those who handle the error themselves, as ``python -m`` does."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        """See importlib.abc.MetaPathFinder. Raises ModuleNotFoundError for a package of the workspace."""
        del path, target
        package = name.partition(".")[0]
        # In the repository's root Python takes the folders of the packages for packages: those have
        # no file.
        if package in PACKAGES and getattr(sys.modules.get(package), "__file__", None) is None:
            raise ModuleNotFoundError(advice(package), name=package)


def say(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """See sys.excepthook. Executables look for the distribution of their package, whose name has hyphens."""
    package = (error.name or "").replace("-", "_") if isinstance(error, ModuleNotFoundError) else ""
    if package in PACKAGES:
        sys.stderr.write(f"{advice(package)}\n")
    else:
        sys.__excepthook__(kind, error, trace)


sys.meta_path.append(LastFinder)
sys.excepthook = say
