# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions as a bag stores them.

A definition is the ``.msg`` source followed by the sources of all types that it uses.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from rover_parameters.records import shortened
from terrain_estimator.bags.errors import BagError
from terrain_estimator.bags.format.definition_limits import SEPARATOR, check_text, check_types


@dataclass(frozen=True, slots=True)
class Definition:
    """A message type as bags carry it.

    Source of the text's form: MCAP format registry, schema encoding ``ros2msg``.
    """

    type_name: str  # "pkg/msg/Name"
    text: str  # source with comments, then one "MSG: pkg/Name" section per type it uses
    type_hash: str  # RIHS01 of REP-2016, "" where unknown


@cache
def installed_definition(type_name: str) -> Definition:
    """Return the definition that the sourced workspace installs.

    Raises:
        BagError: the package or the type is not installed, or the name is not of the form
            pkg/msg/Name.
    """
    sources = _with_dependencies(type_name)
    text = sources.pop(type_name)
    for name, source in sources.items():
        package, _, short = name.split("/")
        text = f"{text.rstrip()}\n{SEPARATOR}\nMSG: {package}/{short}\n{source}"
    return Definition(type_name, text, type_hash(type_name, text))


def type_hash(type_name: str, text: str) -> str:
    """Compute the RIHS01 type hash (REP-2016) of a definition's text.

    Raises:
        BagError: the text is not a valid message definition, or lacks a type that it uses.
    """
    store = Typestore()
    try:
        store.register(parse(type_name, text))
        return store.hash_rihs01(type_name)
    except (BagError, MemoryError):
        raise
    except Exception as error:  # what rosbags raises depends on what is wrong
        raise BagError(
            f"the definition of {type_name} is not complete ({shortened(str(error))}): record the"
            " bag again, or repair the .msg file"
        ) from error


@cache
def parse(type_name: str, text: str) -> Typesdict:
    """Parse a definition's text into the fields of all its types.

    The result is cached: a parse takes 10 ms, and a bag asks for it several times.

    Raises:
        BagError: the text is not a valid message definition, is beyond the limits of
            :mod:`terrain_estimator.bags.format.definition_limits`, or one of its types contains
            itself.
    """
    check_text(type_name, text)
    try:
        types = get_types_from_msg(text, type_name)
    except MemoryError:
        raise
    except Exception as error:
        reason = shortened(" ".join(str(error).split()))
        raise BagError(
            f"the definition of {type_name} does not parse ({type(error).__name__}: {reason}):"
            " record the bag again, or repair the .msg file"
        ) from error
    uses = {
        name: [used for _, field in fields for used in _types_used(field)]
        for name, (_, fields) in types.items()
    }
    try:
        check_types(type_name, types, TopologicalSorter(uses).static_order())
    except CycleError as error:
        circle = shortened(" in ".join(error.args[1]))
        raise BagError(
            f"the definition of {type_name} contains itself ({circle}): repair the .msg file"
        ) from error
    return types


def _with_dependencies(type_name: str) -> dict[str, str]:
    sources: dict[str, str] = {}
    waiting = [type_name]
    while waiting:
        name = waiting.pop(0)
        if name in sources:
            continue
        sources[name] = _source(name)
        fields = parse(name, sources[name])[name][1]
        waiting.extend(used for _, field in fields for used in _types_used(field))
    return sources


def _types_used(field: FieldDesc) -> Iterator[str]:
    if field[0] == Nodetype.NAME:
        yield field[1]
    elif field[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        yield from _types_used(field[1][0])


def _source(type_name: str) -> str:
    match type_name.split("/"):
        case [package, "msg", short]:
            pass
        case _:
            msg = f"{type_name!r} is not a message type: expected a name like nav_msgs/msg/Odometry"
            raise BagError(msg)
    try:
        path = Path(get_package_share_directory(package)) / "msg" / f"{short}.msg"
    except (PackageNotFoundError, LookupError, OSError, ValueError) as error:
        # OSError: no workspace at all is sourced
        msg = (
            f"{type_name}: package {package} is not installed; source the workspace first: ."
            " ros2_ws/setup.bash"
        )
        raise BagError(msg) from error
    if not path.is_file():
        msg = (
            f"{type_name}: {path} does not exist; build the workspace again or correct the type's"
            " name"
        )
        raise BagError(msg)
    return path.read_text(encoding="utf-8")
