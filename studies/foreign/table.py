# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make foreign``."""

from collections.abc import Iterator, Sequence

from studies.foreign.scores import FAR, ModelScore, ResidualScore
from studies.limited import Limited
from studies.tables import licence, table

INTRODUCTION = """# Foreign drives

{measured}

What does the estimator publish on a plant that nobody here wrote? The drives are those in
[bags/foreign](../bags/foreign/README.md): Project Chrono's rigid bodies on its SCM terrain, {logs}
logs of 50 s, two soils, five kinds of drives, three contact laws. The sensors' noise is that of
[the simulator](simulator.md), seed {seed}, {draws}: {count} drives a model.

- **shipped**: the model mars_rover, which has to find the soil among three; SCM's is none of them.
- **control**: physics alone, with SCM's own exponent, moduli and shear modulus as prior means (each
  within 5 %, as in every trained model) and the largest stress below the axle, where SCM has it.
  What is left is the form of the contact law.

Screening, gates, restarts and the published interval are the node's, parameters are the default.
The estimate is judged at the end of each drive. Brackets are 95 % limits: exact binomial ones for
shares of drives, else by resampling whole drives. The logs are no random sample of foreign plants:
the limits tell the noise of this set, not the risk on the next plant.

## The bars

"""
BARS = """
- **Far**: status IDENTIFIED and c or tan phi more than {far:g} of its published deviations off.
- "The same at any time" counts drives in which an answer was so at any time, "answers" the answers.
- **Outside**: status IDENTIFIED and c or tan phi outside its published 95 % interval.
- A bar on IDENTIFIED also holds where nearly every second is refused, and where the status is
  DISAGREES and the prior is published. Read it beside the table below.
- "Outside, any status" counts the intervals that are published without being IDENTIFIED, too.
- **Velocity**: only steps that had a forecast count. The interval is judged on the measured
  velocity; the rms error and "it stays as it was measured" are judged on the true one.

## What the status says

An observation reads ACCEPTED when it comes, before the second that it belongs to is closed and
taken or refused with all of its observations. So the first column is no measure of the fit; the
second is. A drive that DISAGREES publishes the prior and predicts that the velocity stays.

"""
DRIVES = """
## Drive by drive

"""
ROWS = """
## Residuals by row

Every closed block has {rows} rows. Their residuals at the posterior that the estimator kept are
whitened with the block's own covariance (symmetric root of the correlation, so that each number
keeps its row's name). If physics and noise were right the mean would be 0, the deviation at most 1,
and neighbouring blocks uncorrelated. The correlation is about zero: an offset that stays gives 1.

"""
NO_BLOCK = "No block entered the posterior.\n"


def page(scores: Sequence[ModelScore], measured: str, logs: int, draws: int, seed: int) -> str:
    """Return the whole page."""
    count = len(scores[0].drives)
    drawn = f"{draws} draws for each log" if draws > 1 else "one draw for each log"
    said = {"measured": measured, "logs": logs, "draws": drawn, "count": count, "seed": seed}
    parts = [licence("foreign"), INTRODUCTION.format(**said), table(_HEAD, _bars(scores))]
    parts += [BARS.format(far=FAR), table(("model", *_SAID), _used(scores)), DRIVES]
    parts.append(table(_DRIVE, (line for each in scores for line in _drives(each))))
    parts.append(ROWS.format(rows=len(scores[0].rows)))
    for each in scores:
        parts.append(f"### {each.model}: all closed blocks\n\n{table(_ROW, _rows(each.rows))}\n")
        taken = table(_ROW, _rows(each.rows_taken)) if each.rows_taken else NO_BLOCK
        parts.append(f"### {each.model}: blocks in the posterior\n\n{taken}\n")
    return "".join(parts).rstrip("\n") + "\n"


_HEAD = ("what", "bar", "model", "measured", "holds")
_SAID = (
    "observations accepted",
    "seconds in the posterior",
    "drives that end IDENTIFIED",
    "drives that end DISAGREES",
)
_DRIVE = (
    "model",
    "drive",
    "status",
    "c [Pa]",
    "tan phi",
    "z of c",
    "z of tan phi",
    "both in 95 %",
    "accepted %",
    "seconds taken %",
)
_ROW = ("row", "mean", "deviation", "correlation of neighbours")


def _bars(scores: Sequence[ModelScore]) -> Iterator[Sequence[str]]:
    for each in scores:
        name = each.model
        yield "IDENTIFIED and far, drives", "none", name, _percent(each.far), _yes(each.far, 0, 0)
        yield "the same at any time, drives", "", name, _percent(each.ever_far), ""
        yield "the same, answers", "", name, _percent(each.far_at), ""
        yield (
            "IDENTIFIED and outside, drives",
            "at most 10 %",
            name,
            _percent(each.outside),
            _yes(each.outside, 0.0, 0.1),
        )
        missed = sum(not all(drive.inside) for drive in each.drives)
        yield "outside, any status, drives", "", name, f"{missed} of {len(each.drives)}", ""
        yield (
            "next velocity in its 95 % interval",
            "93 to 97 %",
            name,
            _percent(each.covered),
            _yes(each.covered, 0.93, 0.97),
        )
        ratio = each.over_persistence
        millimetres = f"{1e3 * each.error:.1f} over {1e3 * each.persistence:.1f} mm/s"
        yield (
            "rms error over persistence",
            "at most 1.05",
            name,
            f"{ratio.value:.3f} ({ratio.low:.3f} to {ratio.high:.3f}), {millimetres}",
            _yes(ratio, 0.0, 1.05),
        )
        yield "steps with a forecast", "", name, _percent(each.predicted), ""


def _yes(figure: Limited, low: float, high: float) -> str:
    return "yes" if low <= figure.value <= high else "**no**"


def _percent(figure: Limited) -> str:
    return f"{100 * figure.value:.1f} % ({100 * figure.low:.0f} to {100 * figure.high:.0f})"


def _used(scores: Sequence[ModelScore]) -> Iterator[Sequence[str]]:
    for each in scores:
        yield (
            each.model,
            *map(_percent, (each.accepted, each.taken, each.identified, each.disagrees)),
        )


def _drives(score: ModelScore) -> Iterator[Sequence[str]]:
    for each in score.drives:
        (c, tan_phi), (c_sd, tan_phi_sd) = each.mean, each.deviation
        yield (
            score.model,
            each.name,
            "IDENTIFIED" if each.identified else "DISAGREES" if each.disagrees else "",
            f"{c:.0f} ± {c_sd:.0f}",
            f"{tan_phi:.3f} ± {tan_phi_sd:.3f}",
            *(f"{z:+.1f}" for z in each.z),
            "yes" if all(each.inside) else "no",
            f"{100 * each.accepted:.0f}",
            f"{100 * each.taken:.0f}",
        )


def _rows(rows: Sequence[ResidualScore]) -> Iterator[Sequence[str]]:
    for row in rows:
        figures = (row.mean, row.deviation, row.correlation)
        yield (
            row.name,
            *(f"{each.value:.2f} ({each.low:.2f} to {each.high:.2f})" for each in figures),
        )
