# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Studies that compute in several processes: a process imports no ``__main__`` of a package."""

import ast
from pathlib import Path

import pytest

COMMANDS = sorted((Path(__file__).parents[2] / "studies").glob("*/__main__.py"))
IN_ONE_PROCESS = {"foreign"}
"""Studies whose pieces stay in their own process."""


def sent(tree: ast.Module) -> set[str]:
    """Return the names of the functions that a command makes pieces of."""
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args)
    return {
        call.args[0].id
        for call in calls
        if isinstance(call.func, ast.Name)
        and call.func.id in ("partial", "Piece")
        and isinstance(call.args[0], ast.Name)
    }


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.parent.name)
def test_pieces_are_functions_of_modules_that_another_process_can_import(path: Path) -> None:
    tree = ast.parse(path.read_bytes())
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    if path.parent.name in IN_ONE_PROCESS:
        assert sent(tree) & defined
    else:
        assert not sent(tree) & defined
