# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect in a few minutes: ``python -m tests.terrain_estimator.discovery.discover``.

A simulated rover drives with an effect in it that a seed draws from the hidden ones (or none). Its
bags are sealed: the estimator's inputs and nothing else. The command looks for the effect as a user
would start it, in a process of its own. Only then the truth is written and compared. Exit codes: 0
whatever the verdict, 2 where the command failed.
"""

import argparse
import hashlib
import itertools
import json
import os
import random
import subprocess
import sys
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch

from terrain_estimator.demonstration.processes import executable
from terrain_estimator.pages.finding import Unsealed, finding_page
from terrain_estimator.pages.finding_words import alternatives
from terramechanics.effects import EFFECTS
from tests.hidden.cases import Case, Plan, draw_cases
from tests.hidden.generators import GENERATORS
from tests.hidden.ground import SOILS
from tests.hidden.sealing import seal

FAILED = 2
FINDING = "finding"
"""Folder of what the command found, beside the bags; the unsealed report lies above it."""


def main(arguments: list[str] | None = None) -> int:
    """Hide, search, unseal; returns the exit code."""
    torch.set_num_threads(1)
    options = _parser().parse_args(arguments)
    seed = random.SystemRandom().randrange(2**31) if options.seed is None else options.seed
    say(
        f"Five drives of {options.seconds:g} s with something hidden in them, drawn with seed"
        f" {seed} ..."
    )
    case = drawn(seed, options.hide, options.seconds)
    truth = json.dumps(told(case, seed), indent=1) + "\n"
    folder = new_folder(options.out / str(seed))
    bags = seal(case, folder / "bags")
    say(
        f"sealed bags: {bags[0].parent}; SHA-256 of the truth:"
        f" {hashlib.sha256(truth.encode()).hexdigest()}"
    )
    command = [
        executable("terrain_estimator", "find_missing_effect"),
        *map(str, bags),
        "--soil",
        case.truth.soil,
        "--out",
        str(folder / FINDING),
    ]
    if subprocess.run(command, check=False).returncode:
        return FAILED
    (folder / "truth.json").write_text(truth, encoding="utf-8")
    finding = json.loads((folder / FINDING / "finding.json").read_text(encoding="utf-8"))
    sentence = f"{hidden_words(case)} {verdict_words(finding, case.truth.plan.names)}"
    say(f"unsealed: {sentence}")
    report = folder / "report.html"
    report.write_text(
        finding_page(finding, Unsealed(sentence, strengths(case, [bag.name for bag in bags]))),
        encoding="utf-8",
    )
    say(f"report: {report}")
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(report.absolute().as_uri())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="discover", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seed",
        type=int,
        help=(
            "of what is hidden, the ground and the drives (default: another one each time, printed)"
        ),
    )
    parser.add_argument(
        "--hide", choices=["none", *GENERATORS], help="what to hide (default: the seed draws it)"
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="length of a drive (default: %(default)s)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/discover"),
        help="results go to its folder SEED, SEED_2 and so on (default: %(default)s)",
    )
    return parser


def new_folder(wanted: Path) -> Path:
    """Make a folder of this name, with a number behind it where there is one already."""
    for number in itertools.count(1):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}_{number}")
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            return folder
    raise AssertionError("numbers do not end")


def say(line: str) -> None:
    """Print at once: a process of its own writes between the lines."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def drawn(seed: int, hide: str | None, seconds: float) -> Case:
    """Draw the case of a seed: hidden effect (or ``hide``), soil and drives."""
    generator = random.Random(seed)
    name, soil = generator.choice(["none", *GENERATORS]), generator.choice(SOILS)
    parts = () if (hide or name) == "none" else ((hide or name, 1.0),)
    return draw_cases(Plan(parts, soil=soil, seconds=seconds), 1, seed)[0]


def told(case: Case, seed: int) -> dict[str, Any]:
    """Return the truth as truth.json has it; its checksum is printed before the search."""
    truth = case.truth
    return {
        "seed": seed,
        "hidden": [name for name, _ in truth.plan.parts],
        "sizes": truth.sizes,
        "soil": truth.soil,
        "cohesion_pa": truth.cohesion_pa,
        "tan_phi": truth.tan_phi,
    }


def hidden_words(case: Case) -> str:
    """Return a sentence on the hidden effect."""
    if not case.truth.plan.parts:
        return "Nothing was hidden."
    [(name, _)], [size], [equivalent] = (
        case.truth.plan.parts,
        case.truth.sizes,
        case.truth.equivalents,
    )
    hidden = GENERATORS[name]
    law = f"Hidden was {name}: {hidden.law}, size {size:.3g} {hidden.unit}".removesuffix(" 1")
    if not hidden.known:
        return f"{law}, which the library does not have."
    return (
        f"{law}. A law as simple as the library's comes closest to it with {equivalent:.4g}"
        f" {EFFECTS[name].unit}".removesuffix(" 1")
        + "."
    )


def verdict_words(finding: dict[str, Any], truth: tuple[str, ...]) -> str:
    """Return whether the verdict is right, in words; ``truth`` as in ``Plan.names``."""
    verdict = finding["verdict"]
    names = [tuple(sorted(each["name"] for each in effects)) for effects in alternatives(finding)]
    wanted = {(): "none", ("unknown",): "unknown"}.get(truth, "named")
    if wanted == "named" and verdict in {"named", "confusable"} and tuple(sorted(truth)) in names:
        return (
            "The verdict is right."
            if verdict == "named"
            else "The verdict is right: the set has it."
        )
    return (
        "The verdict is right."
        if wanted == verdict != "named"
        else f"The verdict, {verdict}, is wrong."
    )


def strengths(case: Case, runs: list[str]) -> dict[str, dict[str, float]]:
    """Return c and tan phi of the ground by the name of the run."""
    pairs = zip(case.truth.cohesion_pa, case.truth.tan_phi, strict=True)
    return {
        run: {"cohesion_pa": cohesion, "tan_phi": friction}
        for run, (cohesion, friction) in zip(runs, pairs, strict=True)
    }


if __name__ == "__main__":
    sys.exit(main())
