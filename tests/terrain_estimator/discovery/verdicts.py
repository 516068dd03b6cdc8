# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How often the verdict about a hidden effect is right: `python -m tests.terrain_estimator.discovery.verdicts [PLAN ...]`.

A plan is `none`, the name of a hidden effect, or two joined by `+`. Cases are drawn with seeds that no calibration used. Every
case is written as it comes; a file that has some is continued. Runs go to the investigation as packed observations with the
bogie's angle, which sealed bags do not have.
"""

import argparse
import dataclasses
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from scipy.stats import binomtest

from terrain_estimator.cli.thresholds import read_thresholds
from terrain_estimator.discovery import Finding, Run, Study, cut, investigate, nominal_of, singles
from terrain_estimator.discovery.verdict import Verdict
from terrain_estimator.packing import pack_measurement
from terramechanics.rover import Rover
from terramechanics.sensors import Measurement
from terramechanics.simulation import TIME_STEP
from terramechanics.soil import load_soil
from tests.hidden.cases import Case, Plan, draw_cases
from tests.hidden.generators import GENERATORS
from tests.hidden.matters import axle_means

CONFIDENCE = 0.95
SEED = 31_000


def run_of(drive: Measurement, rover: Rover, name: str) -> Run:
    """One measured drive as a run: the means of each axle's wheels, torque without what turns the wheels faster."""
    means = axle_means(drive, rover.axles)
    gain = torch.diff(means.wheel_rate, dim=0, prepend=means.wheel_rate[:1]) / TIME_STEP
    means = dataclasses.replace(means, torque=means.torque - rover.wheel_inertia * gain)
    batch = Measurement(**{item.name: getattr(means, item.name).unsqueeze(0) for item in dataclasses.fields(Measurement)})
    packed = pack_measurement(batch)[0]
    return Run(name, packed, means.wheel_rate, TIME_STEP * torch.arange(packed.shape[0], dtype=torch.float64))


def find(case: Case) -> Finding:
    """Investigate a case as the command does."""
    nominal = nominal_of(case.rover, load_soil(case.truth.soil))
    runs = [run_of(drive, case.rover, f"run {k}") for k, drive in enumerate(case.drives)]
    with torch.inference_mode():
        study = Study(nominal, [cut(run, nominal.contact) for run in runs])
        return investigate(study, singles(), read_thresholds(), lambda _share, _label: None)


def judged(case: Case, finding: Finding) -> dict[str, Any]:
    """What came of a case: ``outcome`` is exact, set, wrong name, none or unknown; ``right`` whether that is the truth."""
    truth, judgement = case.truth.plan.names, finding.judgement
    names = [tuple(sorted(each.names)) for each in judgement.named]
    wanted = tuple(sorted(truth))
    outcome = str(judgement.verdict)
    if judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE):
        outcome = "wrong name" if wanted not in names else ("exact" if len(set(names)) == 1 else "set")
    right = outcome in ("exact", "set") or (outcome == "none" and not truth) or (outcome == "unknown" and truth == ("unknown",))
    best = finding.best
    return {
        "plan": "+".join(name for name, _ in case.truth.plan.parts) or "none",
        "outcome": outcome,
        "right": right,
        "named": [each.label for each in judgement.named],
        "soil": case.truth.soil,
        "terrain": case.truth.terrain,
        "share": finding.gains.share,
        "explainable": finding.gains.explainable,
        "gains": [(each.label, gain) for each, gain in finding.gains.named],
        "sizes": best.sizes,
        "equivalents": case.truth.equivalents,
    }


def table(results: Sequence[dict[str, Any]]) -> str:
    """Outcomes of every plan, and the share of right ones with its confidence limits."""
    grouped = defaultdict(list)
    for each in results:
        grouped[each["plan"]].append(each)
    outcomes = ("exact", "set", "wrong name", "unknown", "none")
    lines = [f"{'hidden':>28}{'cases':>7}" + "".join(f"{name:>12}" for name in outcomes) + f"{'right':>8}  95 % limits"]
    for plan, group in [*grouped.items(), ("all", list(results))]:
        counts = Counter(each["outcome"] for each in group)
        right = sum(each["right"] for each in group)
        limits = binomtest(right, len(group)).proportion_ci(CONFIDENCE)
        row = f"{plan:>28}{len(group):>7}" + "".join(f"{counts[name]:>12}" for name in outcomes)
        lines.append(f"{row}{right / len(group):>8.0%}  {limits.low:.0%} to {limits.high:.0%}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Investigate the cases and print the table."""
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plans", nargs="*", default=["none", *GENERATORS])
    parser.add_argument("--cases", type=int, default=2, help="of each plan")
    parser.add_argument("--share", type=float, default=1.0, help="of the size that matters")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--out", type=Path, default=Path("out/verdicts.jsonl"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    lines = options.out.read_text(encoding="utf-8").splitlines() if options.out.exists() else []
    results = [json.loads(line) for line in lines]
    done = {(each["plan"], each["share_of_size"], each["seed"]) for each in results}
    with options.out.open("a", encoding="utf-8") as output:
        for name in options.plans:
            if (name, options.share, options.seed) in done:
                continue
            parts = () if name == "none" else tuple((part, options.share) for part in name.split("+"))
            for case in draw_cases(Plan(parts), options.cases, options.seed):
                results.append(judged(case, find(case)) | {"share_of_size": options.share, "seed": options.seed})
                output.write(json.dumps(results[-1]) + "\n")
                output.flush()
    sys.stdout.write(table(results))


if __name__ == "__main__":
    main()
