# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The soil below each run, from the values of the option ``--soil``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_parameters.records import ConfigError, nearest
from terrain_estimator.bags import bag_name
from terramechanics.presets import load_soil, soil_names
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

SOIL = "loose_sand"
"""Soil of runs for which none is given."""


@dataclass(frozen=True, slots=True)
class RunSoils:
    """Names and soils of all runs."""

    names: Mapping[Path, str]  # as given
    soils: Mapping[Path, Soil]
    others: tuple[str, ...] = ()  # names of soils on which the runs may be instead, as given
    at_hand: tuple[Soil, ...] = ()  # all of these

    @property
    def first(self) -> Soil:
        """The soil of the first run."""
        return next(iter(self.soils.values()))

    def words(self) -> str:
        """Return the names of all soils, each once."""
        return ", ".join(dict.fromkeys(self.names.values()))


def run_soils(
    given: Sequence[str], runs: Sequence[Path], rover: Rover, others: Sequence[str] = ()
) -> RunSoils:
    """Return the soil of every run from texts ``NAME`` (of all others) and ``RUN=NAME``.

    RUN is the path of a run, or the name of its bag where only one has it. NAME is that of a soil,
    or the path of a soil file, like each of ``others``, on which the runs may be instead.

    Raises:
        ConfigError: a run or soil is unknown, a run has two soils, or its name is that of two runs.
    """
    usual, own = "", dict[Path, str]()
    for text in given:
        name, named, soil = text.partition("=")
        if not named or Path(text).is_file():
            if usual:
                raise ConfigError(
                    f"--soil {text}: {usual} is given for all runs already: give RUN={text} for"
                    " single runs"
                )
            usual = text
            continue
        run = _run_of(name, text, runs)
        if run in own:
            raise ConfigError(f"--soil {text}: run {name} has the soil {own[run]} already")
        own[run] = soil
    names = {run: own.get(run, usual or SOIL) for run in runs}
    loaded = {name: load_soil(name).for_wheel(rover.wheel_width) for name in names.values()}
    at_hand = _at_hand(list(loaded.values()), others, rover)
    soils = {run: loaded[name] for run, name in names.items()}
    return RunSoils(names, soils, tuple(others), at_hand)


def _at_hand(told: Sequence[Soil], others: Sequence[str], rover: Rover) -> tuple[Soil, ...]:
    """Return the soils told and others, each once.

    A preset is left out where a soil of another file has its name. Raises ConfigError where the
    soils of two files have one name, by which an answer could not tell them apart.
    """
    found = {soil.name: soil for soil in told}
    for name in others:
        soil = load_soil(name).for_wheel(rover.wheel_width)
        if found.setdefault(soil.name, soil) != soil and name not in soil_names():
            raise ConfigError(
                f"--other-soils {name}: another soil here is called {soil.name!r}, too: give one of"
                " them another name in its file"
            )
    return tuple(dict.fromkeys([*told, *found.values()]))


def _run_of(name: str, text: str, runs: Sequence[Path]) -> Path:
    """Return the run of that path or name."""
    if found := [run for run in runs if run.resolve() == Path(name).resolve()]:
        return found[0]
    called = [run for run in runs if name in (run.name, bag_name(run))]
    if len(called) == 1:
        return called[0]
    if called:
        raise ConfigError(
            f"--soil {text}: {' and '.join(map(str, called))} have that name: give the path"
        )
    known = [run.name for run in runs]
    raise ConfigError(f"--soil {text}: {name!r} is no run of this call: {nearest(name, known)}")
