# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Make the ROS wheels of an environment fit for builds, and write the scripts of /opt/ros/jazzy.

Run with the environment's own interpreter after every installation. Repeating it changes nothing.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

# The wheels were built in a container: their CMake files name its interpreter's headers and its
# numpy's.
BAKED_PYTHON = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
BAKED_NUMPY = re.compile(r'/opt/python/[^;"\s]*/numpy/_?core/include')

HEADER = """\
# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
# Written by ros2_ws/prepare; stands in for /opt/ros/jazzy/setup.sh with the wheels.
"""

# Quoted and expanded only where set, so that it holds under `set -u` and in folders with spaces.
# With _ROS_WHEELS_BOOTSTRAP_COMPLETE the wheels leave LD_LIBRARY_PATH alone, which saves each
# process a second exec.
BODY = """
_te_venv={venv}
_te_prepend() {{
    eval "_te_old=\\${{$1:-}}"
    case ":$_te_old:" in
        *":$2:"*) ;;
        *) export "$1=$2${{_te_old:+:$_te_old}}" ;;
    esac
    unset _te_old
}}
_te_prepend PATH "$_te_venv/bin"
_te_prepend AMENT_PREFIX_PATH "$_te_venv"
_te_prepend CMAKE_PREFIX_PATH "$_te_venv"
_te_prepend LD_LIBRARY_PATH {libraries}
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
export VIRTUAL_ENV="$_te_venv"
export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
export RMW_IMPLEMENTATION="${{RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}}"
export ROS_AUTOMATIC_DISCOVERY_RANGE="${{ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}}"
unset _te_venv
unset -f _te_prepend
"""


def shell_quoted(text: str) -> str:
    """Return text as one word of a POSIX shell."""
    return "'" + text.replace("'", "'\\''") + "'"


def repair_cmake_files(prefix: Path) -> None:
    """Replace the baked header folders in all CMake files. Raises RuntimeError for one left."""
    python_headers = sysconfig.get_path("include")
    for path in prefix.glob("share/*/cmake/*.cmake"):
        text = path.read_text(encoding="utf-8")
        repaired = BAKED_PYTHON.sub(
            lambda _: python_headers, BAKED_NUMPY.sub(lambda _: np.get_include(), text)
        )
        if "/opt/python" in repaired:
            message = (
                f"{path} still names a folder under /opt/python: the pinned wheels changed,"
                " repair_wheels.py has to follow"
            )
            raise RuntimeError(message)
        if repaired != text:
            path.write_text(repaired, encoding="utf-8")


def write_setup_scripts(prefix: Path) -> None:
    """Write setup.sh, setup.bash and the local_ forms that colcon looks for."""
    bundled = sorted(str(path) for path in Path(sysconfig.get_path("platlib")).glob("ros_*.libs"))
    libraries = ":".join([str(prefix / "lib"), *bundled])
    text = HEADER + BODY.format(venv=shell_quoted(str(prefix)), libraries=shell_quoted(libraries))
    for name in ("setup.sh", "setup.bash", "local_setup.sh", "local_setup.bash"):
        (prefix / name).write_text(text, encoding="utf-8")


def main() -> None:
    """Repair the environment of the running interpreter."""
    prefix = Path(sys.prefix)
    repair_cmake_files(prefix)
    write_setup_scripts(prefix)


if __name__ == "__main__":
    main()
