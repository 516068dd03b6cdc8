# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a replay: one HTML page about all its runs."""

from collections.abc import Iterable, Sequence

from rover_parameters.parameters import effective, parameters
from terrain_estimator.bags import Message
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import rover_of
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.offline.provenance import bag_sha256, versions
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.summary import remarks
from terrain_estimator.pages.citations import citations
from terrain_estimator.pages.run import Origin, ReplayedRun, ShownTruth, run_page
from terrain_estimator.topics import stamp_ns


def report_page(replays: Sequence[Replay], model: LoadedModel, config: EstimatorConfig) -> str:
    """Return the page about runs whose history was kept; OSError where a bag is gone."""
    return run_page([_run(each) for each in replays], _origin(replays, model, config))


def _run(replay: Replay) -> ReplayedRun:
    return ReplayedRun(
        name=replay.name,
        bag=str(replay.bag),
        bag_sha256=bag_sha256(replay.bag),
        state_sha256=replay.state_sha256,
        span_s=replay.span_s,
        status=replay.status.lower().replace("_", " "),
        status_text=replay.status_text,
        disagreements=[each.finding for each in replay.disagreements],
        remarks=remarks(replay),
        history=replay.history,
        slip=replay.slip,
        sinkage=replay.sinkage,
        truths=[_truth(each) for each in replay.truths],
        inputs=replay.inputs,
    )


def _truth(message: Message) -> ShownTruth:
    sizes = zip(message.effect, message.effect_value, message.effect_unit, strict=True)
    effects = [
        f"{name} {size:.4g}" + ("" if unit == "1" else f" {unit}") for name, size, unit in sizes
    ]
    return ShownTruth(
        stamp_ns(message),
        (message.cohesion, message.tan_phi),
        " with ".join([message.soil, *effects]),
    )


def _each(values: Iterable[str]) -> str:
    """Return the different ones in their order."""
    return ", ".join(dict.fromkeys(values))


def _origin(replays: Sequence[Replay], model: LoadedModel, config: EstimatorConfig) -> Origin:
    identity = [
        ("model", model.model_id),
        ("model, SHA-256", model.sha256),
        ("runtime", _each(replay.runtime for replay in replays)),
        ("configuration, SHA-256", _each(replay.configuration_sha256 for replay in replays)),
    ]
    values = effective(config)
    return Origin(
        rover=rover_of(model.metadata, config.rover).name,
        identity=[
            *identity,
            *((f"{name}, version", number) for name, number in versions().items()),
        ],
        parameters=[
            (each.name, _plain(values[each.name]), _plain(each.default), each.meaning)
            for each in parameters(EstimatorConfig)
        ],
        citations=list(
            citations(
                model.used_rows, model.metadata.parameters, [each.name for each in model.effects]
            )
        ),
    )


def _plain(value: object) -> str:
    return (
        f"{value:g}"
        if isinstance(value, float)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
    )
