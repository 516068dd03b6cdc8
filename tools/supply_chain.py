# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""List everything that is installed, and look it up among known vulnerabilities.

`make sbom` writes out/sbom.json in CycloneDX's form, from the packages that are in .venv.
`make audit` asks the database of vulnerabilities about all pinned packages. Its tools have an
environment of their own, .venv/audit: they need packages that would break ROS's.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OWN = ROOT / "tools/requirements.txt"
LISTS = (*sorted((ROOT / "requirements").glob("*.txt")), ROOT / "tests/fuzz/requirements.txt", OWN)
TOOLS = ROOT / ".venv/audit"
SBOM = ROOT / "out/sbom.json"
INSTALL = (
    "--disable-pip-version-check install --quiet --no-deps --only-binary :all: --require-hashes"
    " --requirement"
)
LIST = "environment --output-reproducible --output-format JSON --output-file"
LOOK_UP = "--disable-pip --require-hashes --progress-spinner off --format json"
FAILED, NOT_CHECKED = 1, 2


def main() -> int:
    """Return 0; 1 where a package is vulnerable, 2 where packages could not be checked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["sbom", "audit"])
    action = parser.parse_args().action
    _prepare()
    return _write_sbom() if action == "sbom" else _audit()


def _prepare() -> None:
    """Make the environment of the tools anew where their list has changed."""
    installed = TOOLS / OWN.name
    if installed.is_file() and installed.read_bytes() == OWN.read_bytes():
        return
    _run([sys.executable, "-m", "venv", "--clear", str(TOOLS)])
    _run([str(TOOLS / "bin/python"), "-m", "pip", *INSTALL.split(), str(OWN)])
    installed.write_bytes(OWN.read_bytes())


def _write_sbom() -> int:
    SBOM.parent.mkdir(exist_ok=True)
    command = [str(TOOLS / "bin/cyclonedx-py"), *LIST.split(), str(SBOM)]
    _run([*command, str(ROOT / ".venv/bin/python")])
    content = json.loads(SBOM.read_text(encoding="utf-8"))
    print(f"{SBOM}: {len(content['components'])} packages, CycloneDX {content['specVersion']}")
    return 0


def _audit() -> int:
    with tempfile.TemporaryDirectory() as folder:
        lists = [_without_local_version(path, Path(folder)) for path in LISTS]
        requirements = [word for path in lists for word in ("--requirement", str(path))]
        done = subprocess.run(  # noqa: S603 - the pinned tool
            [str(TOOLS / "bin/pip-audit"), *LOOK_UP.split(), *requirements],
            check=False,
            capture_output=True,
            text=True,
        )
    try:
        found = json.loads(done.stdout)["dependencies"]
    except ValueError:
        reason = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        print(f"make audit: nothing was checked: {reason}", file=sys.stderr)
        return NOT_CHECKED
    return verdict(found)


def verdict(found: list[dict[str, Any]]) -> int:
    """Print what pip-audit found about each package; return the exit code.

    pip-audit itself takes a package that its database does not have for a good one.
    """
    unknown = [each["name"] for each in found if "skip_reason" in each]
    bad = [(each, flaw) for each in found for flaw in each.get("vulns", ())]
    for each, flaw in bad:
        mended = ", ".join(flaw["fix_versions"]) or "no version yet"
        print(f"{each['name']} {each['version']}: {flaw['id']}, mended in {mended}")
    print(f"{len(found) - len(unknown)} packages checked, {len(bad)} known vulnerabilities")
    if unknown:
        print(
            f"make audit: {len(unknown)} of {len(found)} packages were NOT checked, since the"
            " database of vulnerabilities does not answer for them"
            f" ({', '.join(unknown[:5])}{', ...' if len(unknown) > 5 else ''}): run it with access"
            " to the Python package index itself; a mirror may lack the database",
            file=sys.stderr,
        )
    return FAILED if bad else NOT_CHECKED if unknown else 0


def _without_local_version(path: Path, folder: Path) -> Path:
    """Copy a list; the database knows 2.13.0, not the build 2.13.0+cpu of it."""
    copy = folder / f"{path.parent.name}_{path.name}"
    copy.write_text(path.read_text(encoding="utf-8").replace("+cpu ", " "), encoding="utf-8")
    return copy


def _run(command: list[str]) -> None:
    done = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603 - ours
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise SystemExit(f"{Path(command[0]).name}: {reason}")


if __name__ == "__main__":
    sys.exit(main())
