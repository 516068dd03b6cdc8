# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect RUN...: find the physical effect that the model of rover and soil lacks.

Writes OUT/finding.json and OUT/report.html and, where it names an effect, OUT/model.pt, a model
that estimates it. Where no soil file fits, OUT/soils has the constants that do. Exit codes:
0 for any verdict, 2 for a bad argument or too few readable runs.
For single-wheel measurements see find_missing_effect --wheel-table FILE.csv --help.
"""

import argparse
import dataclasses
import gc
import random
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.console.arguments import (
    WORKERS,
    add_search_options,
    command_parser,
    deviations_or_exact,
    refuse_twice,
)
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.answer import Question, answered, answered_with_ordinary_doubt
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.library import (
    NOT_BY_WHEEL,
    ON_REQUEST,
    Hypothesis,
    singles,
    singles_by_wheel,
)
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    DOUBTABLE,
    ORDINARY,
    ORDINARY_CENTRE,
    rover_doubt,
)
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.proof.soil_proof import Proven
from terrain_estimator.discovery.report.diagnosis import Diagnosis, diagnose
from terrain_estimator.discovery.report.finding import part_of
from terrain_estimator.files.journal_file import JournalError
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.learning.finding_model import (
    check_model,
    installed_model,
    places_of,
    prior_of,
    write_model,
)
from terrain_estimator.model.metadata import ModelFileError, read_metadata
from terrain_estimator.offline.bag_options import BagOptions, add_options, reading_of
from terrain_estimator.offline.cluster import ClusterError
from terrain_estimator.offline.digest import code_sha256
from terrain_estimator.offline.discovery_runs import (
    FEW,
    JOURNAL,
    Runs,
    Workplace,
    contents_of,
    read_all,
    refuse_equal,
    workplace,
)
from terrain_estimator.offline.finding_content import finding_content, finding_sentence
from terrain_estimator.offline.finding_file import FINDING, asked, provenance, write_finding
from terrain_estimator.offline.pieces import Pieces
from terrain_estimator.offline.reading_runs import TAKE_DAMAGED
from terrain_estimator.offline.reference_drives import ENDING as DRIVE
from terrain_estimator.offline.reference_drives import copy_drives
from terrain_estimator.offline.revised_soils import SOILS, write_soils
from terrain_estimator.offline.run_soils import SOIL, RunSoils, run_soils
from terrain_estimator.offline.summary import write_summary
from terrain_estimator.offline.topic_mapping import TopicError
from terrain_estimator.pages.finding_words import tolerance_words
from terramechanics.presets import load_rover, soil_names
from terramechanics.vehicle.rover import Rover

WRONG = 2
FEWEST = 2
DIVISIONS = 1000
"""Choices of held-out runs until every soil is searched; the last one where none is such."""
ROVER = "mars_rover"
MODEL = "model.pt"
_ORDINARY = (  # for a help text, in which % is doubled
    f"mass {100 * ORDINARY['mass']:g} %%, wheel_radius {100 * ORDINARY['wheel_radius']:g} %%,"
    f" centre_of_mass_x {100 * ORDINARY_CENTRE:g} %% of the wheelbase"
)
_MODEL_FILES = (MODEL, "model.json", "model" + DRIVE)
_READING = 0.03
"""[1] Approximate share of the time that reading takes."""
SEARCH = "search.json"
"""What an unfinished search on a cluster was asked; beside its finished pieces."""


class InputError(ValueError):
    """The arguments or runs do not allow an investigation."""


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Investigate the runs that the command line names; return the exit code."""
    if arguments is None:  # this process is for the command alone
        arguments = sys.argv[1:]
        # What is loaded stays to the end. To look through torch's modules for garbage takes a tenth
        # of a short search.
        gc.freeze()
    if any(each.partition("=")[0] == "--wheel-table" for each in arguments):
        # what it takes to load would be a twentieth of a search of drives
        from terrain_estimator.cli import single_wheel  # noqa: PLC0415

        return single_wheel.main(arguments)
    return search(search_parser().parse_args(arguments))


def search(options: argparse.Namespace) -> int:
    """Investigate the runs of the options; return the exit code."""
    torch.set_num_threads(1)
    try:
        reading = reading_of(options)
        rover = load_rover(options.rover or reading.config.rover or ROVER)
        given = options.model or reading.config.model
        base = given or installed_model(rover)
        places = places_of(base)
        hypotheses = singles(options.library, rover.axles) if not places else _by_wheel(options)
        given_runs = _given_runs(options)
        soils = run_soils(options.soil, given_runs, rover, options.other_soils)
        _refuse_soils_of_the_results(soils, options.out)
        runs, held_out = _divided(options, soils)
        results, names = ResultFolder(options.out), _results(base, options.out)
        results.check(*names)
        if given:
            check_model(given, rover)
        elif base != rover.name:
            sys.stderr.write(f"find_missing_effect: {_model_note(rover, base)}\n")
        prior = prior_of(base)
        nominal = _in_doubt(nominal_of(rover, soils.first, prior, places), options.rover_sd or {})
        grounds = {run: nominal_of(rover, soil, prior, places) for run, soil in soils.soils.items()}
        told_asked = asked(nominal.rover.name, soils, options.seed, reading) | _stated(nominal)

        def identity() -> dict[str, Any]:
            given = {"library": options.library, "take_damaged": options.take_damaged}
            prior_told = {"prior": dataclasses.asdict(prior)}
            wheels = {"wheels": dataclasses.asdict(places) if places else None}
            asked_runs = {"runs": [*map(_full, runs)], "hold_out": [*map(_full, held_out)]}
            inputs = provenance(nominal.rover, soils) | {"code_sha256": code_sha256()}
            bags = contents_of([*runs, *held_out])
            return told_asked | given | prior_told | wheels | asked_runs | inputs | bags

        with (
            _place(options, results, len(runs), identity) as (place, pieces),
            torch.inference_mode(),
            ProgressReport("find_missing_effect") as report,
        ):
            read = partial(_read, options, place, grounds=grounds, reading=reading, report=report)
            usable, kept = read(runs), read(held_out, held_out=True)
            refuse_equal([*usable.blocks, *kept.blocks])
            study = Study(nominal, usable.blocks, contributions=usable.contributions)
            question = Question(
                hypotheses,
                soils.at_hand,
                kept.blocks,
                options.seed,
                kept.contributions,
                on_request=not options.library,
            )
            outcome, diagnosis, tolerance = _told(
                study, question, report.at, stated=options.rover_sd is not None
            )
        told = {
            "damaged": usable.damaged | kept.damaged,
            "left_out": [*usable.left_out, *kept.left_out],
            "asked": told_asked,
            "provenance": provenance(nominal.rover, soils),
            **tolerance,
        }
        content = finding_content(outcome, diagnosis, study, kept.blocks, options.seed) | told
        with results.renewing(*names, SEARCH) as new:
            write_finding(new, content)
            model = write_model(
                outcome.finding, nominal.rover, base, options.out / MODEL, new / MODEL
            )
            _copy_drives(base, new)
            soils_found = write_soils(outcome, new)
        if pieces is not None:
            pieces.end()
    except (
        ConfigError,
        ClusterError,
        InputError,
        JournalError,
        ModelFileError,
        TopicError,
        OSError,
    ) as error:
        sys.stderr.write(f"find_missing_effect: {error}\n")
        return WRONG
    sys.stdout.write(
        "\n".join(
            [
                finding_sentence(outcome, diagnosis),
                *map(tolerance_words, tolerance.values()),
                *(str(options.out / name) for name in FINDING),
                *(str(options.out / name) for name in soils_found),
                _model_words(model, outcome),
            ]
        )
        + "\n"
    )
    return 0


def _model_words(model: Path | str, outcome: Proven) -> str:
    """Return the line on the model, which may be the reason why there is none."""
    written = isinstance(model, Path) and outcome.unproven
    return f"{model} (unproven: {outcome.unproven})" if written else str(model)


def _told(
    study: Study, question: Question, progress: ProgressCallback, *, stated: bool
) -> tuple[Proven, Diagnosis, dict[str, Any]]:
    """Return the finding, what stands beside it, and the entry of deviations that nobody stated."""
    searching = part_of(progress, _READING, 0.95)
    answer, exact = (
        (answered(study, question, searching), None)
        if stated
        else answered_with_ordinary_doubt(study, question, searching)
    )
    diagnosis = diagnose(answer.study, answer.considered(question), answer.asked, progress)
    if exact is None:
        return answer.outcome, diagnosis, {}
    judgement = exact.outcome.finding.judgement
    entry = {
        "verdict": str(judgement.verdict),
        "named": [each.label for each in judgement.named],
        "rover_sd": {each.name: each.sd for each in answer.study.nominal.doubt},
    }
    return answer.outcome, diagnosis, {"rover_tolerance": entry}


def _by_wheel(options: argparse.Namespace) -> list[Hypothesis]:
    """Return the effects that compete by wheel; say which do not, and that no soil does.

    Raises ConfigError for options that nothing follows from by wheel.
    """
    if options.other_soils not in ([], soil_names()):
        raise ConfigError(
            f"--other-soils {' '.join(options.other_soils)}: by wheel no other soil is weighed:"
            " leave it out"
        )
    found = singles_by_wheel(options.library)
    if not options.library:
        why = "; ".join(f"{name} ({reason})" for name, reason in NOT_BY_WHEEL.items())
        sys.stderr.write(f"find_missing_effect: by wheel, without other soils and {why}\n")
    return found


def _in_doubt(nominal: Nominal, deviations: Mapping[str, float]) -> Nominal:
    """Return the nominal model with constants of the rover in doubt. Raises ConfigError."""
    if nominal.places is not None and deviations:
        raise ConfigError(
            "--rover-sd: by wheel the rover's constants count as exact: leave it out, or give a"
            " model by axle"
        )
    try:
        return dataclasses.replace(nominal, doubt=rover_doubt(nominal.rover, deviations))
    except ConfigError as error:
        raise ConfigError(f"--rover-sd: {error}") from error


def _stated(nominal: Nominal) -> dict[str, Any]:
    """Return the stated deviations as finding.json has them; nothing for an exact rover file."""
    deviations = {each.name: each.sd for each in nominal.doubt}
    return {"rover_sd": deviations} if deviations else {}


def _model_note(rover: Rover, base: str) -> str:
    """Return in words which model stands in where none has the rover's name."""
    return (
        f"the model {base} is used: its rover differs from {rover.name} in names alone"
        if base
        else f"no installed model is for rover {rover.name}: the default prior is used, and without"
        " --model no model is written"
    )


def _results(base: str, out: Path) -> tuple[str, ...]:
    """Return the names of the files to write: not the model's where that is the one to extend."""
    extended = base and Path(base).resolve() == (out / MODEL).resolve()
    return (*FINDING, SOILS) if extended else (*FINDING, SOILS, *_MODEL_FILES)


def search_parser(name: str = "find_missing_effect") -> argparse.ArgumentParser:
    """Return the parser of the options of :func:`search` for a command of this name."""
    parser = command_parser(name, __doc__)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="bags of drives, at least two"
    )
    parser.add_argument(
        "--hold-out",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN",
        help="bags for the proof only (default: one in four of three or more runs, at least one)",
    )
    parser.add_argument(
        "--rover",
        default="",
        help=f"name of a rover or path of a rover file (default: parameter rover, else {ROVER})",
    )
    parser.add_argument(
        "--rover-sd",
        type=deviations_or_exact,
        metavar="NAME=SD,...",
        help="standard deviations of constants of the rover file, in its units, such as"
        f" mass=2,wheel_radius=0.0005; of {', '.join(DOUBTABLE)}; or: exact (default: exact at"
        f" first; where an error of the file may be all that is found, {_ORDINARY})",
    )
    parser.add_argument(
        "--model",
        default="",
        help="name or file of the model to extend (default: parameter model, else the installed"
        " one of the rover, whatever its name)",
    )
    parser.add_argument(
        "--soil",
        action="append",
        default=[],
        metavar="[RUN=]NAME",
        help="name of a soil or path of a soil file; RUN=NAME for one run, may be given several"
        f" times (default: {SOIL})",
    )
    parser.add_argument(
        "--other-soils",
        nargs="*",
        default=soil_names(),
        metavar="NAME",
        help="soils, or paths of soil files, on which the runs may be instead of --soil; nothing"
        f" after it: none (default: {' '.join(soil_names())})",
    )
    last = ", ".join(sorted(ON_REQUEST))
    shown = f"all that a planar rover shows; {last} only where they end unknown"
    add_search_options(parser, shown, "held-out choice")
    parser.add_argument(
        TAKE_DAMAGED,
        action="store_true",
        help="use what is left of bags that end in the middle or are damaged (default: leave out)",
    )
    add_options(parser)
    _add_processes(parser)
    return parser


def _add_processes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler",
        default="",
        help="address of a dask.distributed scheduler for the work (default: this machine)",
    )
    parser.add_argument(
        "--workers",
        type=WORKERS,
        default=0,
        help=f"processes on this machine; 0: only this one, or one for each CPU above {FEW} runs",
    )


def _given_runs(options: argparse.Namespace) -> list[Path]:
    """Return all runs; InputError where they are too few."""
    runs = list(options.runs)
    refuse_twice(
        [*runs, *options.hold_out],
        "every run counts once, either for the search or for the proof (--hold-out)",
    )
    if len(runs) < FEWEST:
        raise InputError(
            f"{len(runs)} run given, at least {FEWEST} are needed: an effect must show in more than"
            " one drive"
        )
    return [*runs, *options.hold_out]


def _refuse_soils_of_the_results(soils: RunSoils, out: Path) -> None:
    """Raise InputError where a soil file lies among the results, which are replaced."""
    given = [("--soil", name) for name in soils.names.values()]
    for option, name in [*given, *(("--other-soils", name) for name in soils.others)]:
        if (out / SOILS).resolve() in Path(name).resolve().parents:
            raise InputError(
                f"{option} {name}: it is a result of {out}, which this search replaces: give"
                " another --out, or copy the file"
            )


def _copy_drives(base: str, new: Path) -> None:
    """Copy the reference drives of the extended model to the folder of a new one, if any."""
    _, described, drives = (new / name for name in _MODEL_FILES)
    if described.exists():
        with suppress(ModelFileError):  # a damaged file of drives costs no search
            copy_drives(base, read_metadata(described), drives)


def _divided(options: argparse.Namespace, soils: RunSoils) -> tuple[list[Path], list[Path]]:
    """Divide the runs into those to search and those for the proof.

    Every soil has a searched run, where that leaves enough runs for the proof.
    """
    runs = list(options.runs)
    if options.hold_out:
        return runs, list(options.hold_out)
    # With two runs both are needed for the search, and the finding stays unproven.
    count = max(len(runs) // 4, 1) if len(runs) > FEWEST else 0
    searched, generator = runs, random.Random(options.seed)  # noqa: S311 - a reproducible choice, no secret
    for _ in range(DIVISIONS):
        held_out = set(generator.sample(range(len(runs)), count))
        searched = [run for k, run in enumerate(runs) if k not in held_out]
        if {soils.soils[run] for run in searched} == set(soils.soils.values()):
            break
    return searched, [run for run in runs if run not in searched]


@contextmanager
def _place(
    options: argparse.Namespace,
    results: ResultFolder,
    runs: int,
    identity: Callable[[], Mapping[str, Any]],
) -> Iterator[tuple[Workplace, Pieces | None]]:
    """Open the place of the work; say how much of it an earlier run of this command has done."""

    def begun() -> Mapping[str, Any]:
        asked_for = identity()
        if not (options.out / JOURNAL).exists():
            with results.renewing(SEARCH) as new:
                write_summary(new / SEARCH, dict(asked_for))
        return asked_for

    with workplace(runs, options.scheduler, options.workers, options.out, begun) as (place, pieces):
        if pieces is not None and pieces.finished:
            sys.stderr.write(
                f"find_missing_effect: {options.out} has {pieces.finished} finished pieces of this"
                " search: it goes on\n"
            )
        yield place, pieces


def _full(path: Path) -> str:
    return str(path.absolute())


def _read(
    options: argparse.Namespace,
    place: Workplace,
    bags: Sequence[Path],
    *,
    grounds: Mapping[Path, Nominal],
    reading: BagOptions,
    report: ProgressReport,
    held_out: bool = False,
) -> Runs:
    """Read all runs; report and leave out those that are unusable, or too short to be held out."""
    found = read_all(
        place,
        bags,
        [grounds[bag] for bag in bags],
        reading,
        lambda share, note: report.at(_READING * share, note),
        held_out=held_out,
        take_damaged=options.take_damaged,
    )
    for reason in found.left_out:
        report.say(f"find_missing_effect: {reason}")
    for run in {blocks.name for blocks in found.blocks} & found.damaged.keys():
        report.say(f"find_missing_effect: {run} is damaged and used: {found.damaged[run]}")
    if len(found.blocks) < FEWEST and not held_out:
        raise InputError(
            f"{len(found.blocks)} of {len(bags)} searched runs can be used, at least {FEWEST} are"
            " needed"
        )
    return found


if __name__ == "__main__":
    sys.exit(main())
