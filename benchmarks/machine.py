# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Machine and versions of a measurement."""

import importlib.metadata
import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import psutil
from ament_index_python.packages import get_package_prefix

from docs.provenance import commit

LIBRARIES = ("torch", "numpy", "scipy", "rosbags", "mcap", "mcap-ros2-support", "rclpy")


def machine() -> dict[str, object]:
    """Return processor, cores, memory, system, versions, commit, date and present load."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(psutil.virtual_memory().total / 1e9, 1),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in LIBRARIES},
            "Fast DDS": _fast_dds(),
        },
        "commit": commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "load_average": os.getloadavg()[0],
    }


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def _fast_dds() -> str:
    """Return the version in the file name of the loaded library, which is no Python package."""
    library = Path(get_package_prefix("rmw_fastrtps_cpp"), "lib", "libfastrtps.so").resolve()
    return library.name.partition(".so.")[2] or "unknown"
