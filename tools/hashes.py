# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write the hashes of all wheels into the lists of requirements: python -m tools.hashes.

Change a version in requirements/*.txt, then call this: every line gets the hashes of the wheels
that pip would choose for CPython 3.11, 3.12 and 3.13 on x86_64 Linux. The list of torch is left
alone unless it is named, since only PyTorch's own index has its wheels for all three.
"""

import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "requirements"
VERSIONS = ("3.11", "3.12", "3.13")
PLATFORMS = (
    *(f"manylinux_2_{minor}_x86_64" for minor in range(36, 4, -1)),  # glibc of Debian 12: 2.36
    "manylinux2014_x86_64",
    "manylinux2010_x86_64",
    "manylinux1_x86_64",
    "linux_x86_64",
)
SOURCES = ("empy",)
"""Packages without a wheel."""


def main() -> int:
    """Rewrite the lists that are named, by default all."""
    paths = [Path(name) for name in sys.argv[1:]] or [
        path for path in sorted(FOLDER.glob("*.txt")) if path.name != "torch.txt"
    ]
    for path in paths:
        lines = [line.split(" --hash=")[0] for line in path.read_text("utf-8").splitlines()]
        found = hashes([line for line in lines if line and not line.startswith("#")])
        text = "".join(f"{line}{_hashes_of(line, found)}\n" for line in lines)
        path.write_text(text, "utf-8")
        print(f"{path.name}: {sum(map(len, found.values()))} hashes")
    return 0


def hashes(pins: list[str]) -> dict[str, list[str]]:
    """Return the sha256 of every file that pip chooses for these pins, by name of the package."""
    result: dict[str, list[str]] = defaultdict(list)
    built = [pin for pin in pins if _name(pin) in SOURCES]
    wheels = [pin for pin in pins if pin not in built]
    asked = [
        (_options_of(each), [pin for pin in wheels if _applies(pin, each)]) for each in VERSIONS
    ]
    for each, chosen in [*asked, (["--no-binary", ":all:"], built)]:
        for item in _report(each, chosen) if chosen else ():
            digest = item["download_info"]["archive_info"]["hashes"]["sha256"]
            known = result[_name(item["metadata"]["name"])]
            known += [digest] if digest not in known else []
    return result


def _report(options: list[str], pins: list[str]) -> list[dict[str, Any]]:
    base = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-deps"]
    command = [*base, "--quiet", "--report", "-", *options, *(pin.split(";")[0] for pin in pins)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - pip
    installed: list[dict[str, Any]] = json.loads(done.stdout)["install"]
    return installed


def _options_of(version: str) -> list[str]:
    platforms = [word for platform in PLATFORMS for word in ("--platform", platform)]
    return [
        "--only-binary",
        ":all:",
        "--target",
        "/nowhere",
        "--python-version",
        version,
        *platforms,
    ]


def _applies(pin: str, version: str) -> bool:
    """Evaluate the one kind of marker that the lists have: python_version < "3.12"."""
    match = re.search(r'python_version < "3\.(\d+)"', pin)
    return match is None or int(version.split(".")[1]) < int(match[1])


def _hashes_of(line: str, found: dict[str, list[str]]) -> str:
    return "".join(f" --hash=sha256:{each}" for each in found.get(_name(line), ()))


def _name(pin: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[=; ]", pin)[0]).lower()


if __name__ == "__main__":
    sys.exit(main())
