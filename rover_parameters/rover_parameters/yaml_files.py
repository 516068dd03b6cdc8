# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The one reader of YAML, for files of users and for YAML inside recordings.

It takes the events of PyYAML's parser and builds plain values itself, in time and memory
proportional to the length of the text. Anchors, aliases, tags, a second document and a key given
twice are refused, as are depth, size and number of values beyond the limits below. PyYAML's own
loaders expand nine lines to 10^9 values and take minutes for a number of 50 kB.

A plain word is read by the core schema of YAML 1.2, with the yes, no, on and off of YAML 1.1 as
ROS 2 reads them. Numbers are decimal; dates, octal and hexadecimal numbers stay texts, which every
field of a number refuses. A key is the text that is written, also where it looks like a number.
"""

import re
from pathlib import Path
from typing import TypeVar

import yaml

from rover_parameters.records import ConfigError, build, shortened
from rover_parameters.regular_file import read_regular

LARGEST_TEXT = 4 << 20
"""[bytes] Largest YAML text."""
LARGEST_TREE = 200_000
"""Largest number of values and keys in a text."""
DEEPEST_TREE = 32
"""Largest number of lists and mappings within each other."""
_LONGEST_WORD = 512  # characters of a plain word that may be a number
_PARSER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's, where PyYAML was built with it
_CONSTANTS: dict[str, object] = dict.fromkeys(("", "~", "null", "Null", "NULL"))
for _words, _value in (("true yes on", True), ("false no off", False)):
    for _word in _words.split():
        _CONSTANTS |= dict.fromkeys((_word, _word.capitalize(), _word.upper()), _value)
for _word in ("inf", "Inf", "INF"):
    _CONSTANTS |= {f".{_word}": float("inf"), f"+.{_word}": float("inf")}
    _CONSTANTS |= {f"-.{_word}": float("-inf")}
_CONSTANTS |= dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan"))
_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_REAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_CHARACTER = "found character that cannot start any token"
RecordT = TypeVar("RecordT")


def load(record: type[RecordT], path: Path) -> RecordT:
    """Read the YAML file at ``path`` into the dataclass ``record``. Raises ConfigError."""
    return build(record, read_yaml(path), str(path))


def read_yaml(path: Path) -> object:
    """Read the content of a YAML file in UTF-8. Raises ConfigError."""
    try:
        return parse_yaml(read_regular(path, LARGEST_TEXT).decode("utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: not valid YAML: byte {error.start} is not UTF-8: save it as UTF-8"
        ) from error
    except ConfigError as error:
        raise ConfigError(f"{path}: not valid YAML: {error}") from error


def parse_yaml(text: str) -> object:
    """Parse a YAML text into None, bool, int, float, str, list and dict with texts as keys.

    Raises:
        ConfigError: it is not valid, or refused; the message has the line in the text.
    """
    if len(text) > LARGEST_TEXT:
        raise ConfigError(f"it has {len(text)} characters, more than {LARGEST_TEXT}: shorten it")
    try:
        return _Reader(text).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        problem = error.problem or error.context
        if problem == _CHARACTER:  # %, @ or `
            problem = f"{problem}: put the text in quotes"
        raise ConfigError(f"{problem}{place}") from error
    except (yaml.YAMLError, UnicodeError) as error:
        raise ConfigError(" ".join(str(error).split())[:200]) from error


class _Reader:
    """State of one text: the parser and the number of values so far."""

    def __init__(self, text: str) -> None:
        self._parser = _PARSER(text)
        self._left = LARGEST_TREE

    def document(self) -> object:
        try:
            self._next()  # start of the stream
            if isinstance(self._next(), yaml.StreamEndEvent):
                return None
            value = self._value(self._next(), 0)
            self._next()  # end of the document
            if not isinstance(end := self._next(), yaml.StreamEndEvent):
                raise _refusal(end, "a second document begins", "give one alone")
            return value
        finally:
            self._parser.dispose()

    def _next(self) -> yaml.Event:
        return self._parser.get_event()

    def _value(self, event: yaml.Event, depth: int) -> object:
        self._check(event, depth)
        match event:
            case yaml.ScalarEvent():
                return event.value if event.style else _plain(event.value)
            case yaml.SequenceStartEvent():
                items: list[object] = []
                while not isinstance(event := self._next(), yaml.SequenceEndEvent):
                    items.append(self._value(event, depth + 1))
                return items
            case _:
                return self._mapping(depth + 1)

    def _mapping(self, depth: int) -> dict[str, object]:
        values: dict[str, object] = {}
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            self._check(event, depth)
            if not isinstance(event, yaml.ScalarEvent):
                raise _refusal(event, "a key is a list or mapping", "give a word")
            key = event.value
            if key in values:
                raise _refusal(event, f"key {shortened(key)} is given twice", "remove one of them")
            values[key] = self._value(self._next(), depth)
        return values

    def _check(self, event: yaml.Event, depth: int) -> None:
        """Raise ConfigError for a value that is refused, before anything of it is read."""
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise _refusal(event, "an anchor (&) or alias (*)", "write the value out")
        if (tag := getattr(event, "tag", None)) is not None:
            raise _refusal(event, f"tag {shortened(tag)}", "leave it out")
        if depth > DEEPEST_TREE:
            raise _refusal(
                event,
                f"more than {DEEPEST_TREE} lists and mappings within each other",
                "shorten it",
            )
        self._left -= 1
        if self._left < 0:
            raise _refusal(event, f"more than {LARGEST_TREE} values", "shorten it")


def _refusal(event: yaml.Event, what: str, advice: str) -> ConfigError:
    mark = event.start_mark
    place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
    return ConfigError(f"{what}{place}: {advice}")


def _plain(word: str) -> object:
    """Return the value of a word without quotes."""
    if word in _CONSTANTS:
        return _CONSTANTS[word]
    if len(word) <= _LONGEST_WORD:
        if _INTEGER.fullmatch(word):
            return int(word)
        if _REAL.fullmatch(word) and not word.isdigit():
            return float(word)
    return word
