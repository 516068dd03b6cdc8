# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Name the pages of the API reference: one for each folder of a package."""

from pathlib import Path

from tools.site.links import ROOT

PACKAGES = ("rover_parameters", "terramechanics", "terrain_estimator", "rover_sim_node")
_PROGRAMS = {
    "cli",
    "nodes",
    "demonstration",
    "console",
}  # commands and nodes have pages of their own


def reference() -> dict[str, dict[str, str]]:
    """Return the text of every page by its path in the site, by package."""
    return {package: _pages(package) for package in PACKAGES}


def _pages(package: str) -> dict[str, str]:
    folder = ROOT / package / package
    loose = [f"{package}.{path.stem}" for path in _modules(folder)]
    pages = {f"api/{package}.md": _page(package, loose)} if loose else {}
    for inner in sorted(path.parent for path in folder.glob("*/__init__.py")):
        if inner.name not in _PROGRAMS:
            name = f"{package}.{inner.name}"
            pages[f"api/{name}.md"] = _page(name, [])
    return pages


def _modules(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.glob("*.py")) if not path.name.startswith("_")]


def _page(name: str, modules: list[str]) -> str:
    """Return a page of one package, or of the named modules of it alone."""
    if not modules:
        return f"# {name}\n\n::: {name}\n"
    blocks = "\n\n".join(
        f"## `{module}`\n\n::: {module}\n    options:\n      heading_level: 3" for module in modules
    )
    return f"# {name}\n\nThe modules outside its folders.\n\n{blocks}\n"
