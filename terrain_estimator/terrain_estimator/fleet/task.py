# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a worker does with one bag: read its content's hash, or replay it."""

import hashlib
import math
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from distributed import get_worker

from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError
from terrain_estimator.compiled.finding import Chosen, load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.fleet.bringing import copy_bag
from terrain_estimator.fleet.seconds import Seconds
from terrain_estimator.fleet.sources import FleetError, FoundBag, is_here, place_of, reason_of
from terrain_estimator.model.metadata import ModelFileError
from terrain_estimator.offline.replay import estimate
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.topic_mapping import TopicError

ESTIMATE, NO_ESTIMATE, DAMAGED, OTHER_TOPICS = "estimate", "no estimate", "damaged", "other topics"
"""Outcomes that the content of a bag decides."""
EQUAL, FAILED = "equal", "failed"
"""Outcomes of a bag whose content another one has, and of one that is tried again."""
THIS = "<bag>"
"""Name of the bag in a message: equal bags share it."""
_BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that the estimates of a bag depend on, beside its content."""

    config: EstimatorConfig
    names: dict[str, str]  # of topics in the bag, by the estimator's
    model_sha256: str


@dataclass(frozen=True, slots=True)
class BagResult:
    """What came of the content of a bag."""

    sha256: str  # of the content
    outcome: str
    values: dict[str, Any]  # by column of the table of bags; those that are missing are null
    seconds: bytes = b""  # as Seconds packs them


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a bag could not be replayed for reasons that may pass, such as a full disk."""

    message: str


def content_of(bag: FoundBag) -> str | Failure:
    """Return the hash of a bag's content, without a copy of it on this machine."""
    try:
        system, path = place_of(bag.name)
        places = [f"{path}/{name}" for name in bag.storage] if bag.files else [path]
        return _sha256(bag.name, (system.open(place, "rb") for place in places))
    except Exception as error:  # noqa: BLE001 - every store raises errors of its own
        return Failure(f"{bag.name}: {reason_of(error)}")


def replayed(bag: FoundBag, settings: Settings) -> BagResult | Failure:
    """Replay a bag by the code of the command replay.

    Raises FleetError where this worker could replay none.
    """
    chosen = _chosen(settings)
    try:
        with _brought(bag) as path:
            places = [path / name for name in bag.storage] if bag.files else [path]
            sha256 = _sha256(bag.name, (place.open("rb") for place in places))
            return _estimated(path, sha256, chosen, settings)
    except Exception as error:  # noqa: BLE001 - one bag stops no other
        where = "" if isinstance(error, OSError) else f"\n{traceback.format_exc()}"
        return Failure(f"{bag.name}: {type(error).__name__}: {reason_of(error)}{where}")


def _estimated(path: Path, sha256: str, chosen: Chosen, settings: Settings) -> BagResult:
    seconds = Seconds()
    try:
        done = estimate(path, seconds.into, chosen, settings.config, settings.names, silent=True)
    except (BagError, TopicError) as error:
        outcome = DAMAGED if isinstance(error, BagError) else OTHER_TOPICS
        return BagResult(sha256, outcome, {"message": str(error).replace(str(path), THIS)})
    outcome = ESTIMATE if done.gave_estimate else NO_ESTIMATE
    told = "; ".join([*done.notes, *(each.finding for each in done.disagreements)])
    values = _values(done, chosen) | {"message": told.replace(str(path), THIS) or None}
    return BagResult(sha256, outcome, values, seconds.packed())


def _values(done: Replay, chosen: Chosen) -> dict[str, Any]:
    settled = done.settled
    counts = {
        "status": done.status,
        "estimates": done.estimates,
        "used": settled.used,
        "refused": settled.refused,
        "seconds_taken": settled.seconds_taken,
        "seconds_refused": settled.seconds_refused,
        "span_s": done.span_s,
        "model_sha256": chosen.model.sha256,
        "configuration_sha256": done.configuration_sha256,
        "runtime": done.runtime,
    }
    if not done.gave_estimate or done.last is None:
        return counts
    mean, covariance = done.last.update.estimate.mean, done.last.update.estimate.covariance
    deviations = [math.sqrt(float(covariance[index, index])) for index in (0, 1)]
    return counts | {
        "cohesion_pa": float(mean[0]),
        "tan_phi": float(mean[1]),
        "cohesion_sd_pa": deviations[0],
        "tan_phi_sd": deviations[1],
        "correlation": float(covariance[0, 1]) / (deviations[0] * deviations[1]),
    }


def _chosen(settings: Settings) -> Chosen:
    """Return the model, which the worker keeps; FleetError where it lacks it."""
    try:
        chosen = _loaded(settings.config.model, settings.config.runtime)
    except (ModelFileError, ConfigError, OSError) as error:
        raise FleetError(f"a worker cannot load the model: {error}") from error
    if chosen.model.sha256 != settings.model_sha256:
        raise FleetError(
            f"a worker has another model {chosen.model.model_id} ({chosen.model.sha256[:12]}) than"
            f" this command ({settings.model_sha256[:12]}): install the same version on both"
        )
    return chosen


@lru_cache(maxsize=1)
def _loaded(model: str, runtime: str) -> Chosen:
    return load(model, runtime)


@contextmanager
def _brought(bag: FoundBag) -> Iterator[Path]:
    """Yield the place of a bag on this machine; what is brought for that is removed afterwards.

    It lies in the worker's own folder, which dask empties after a worker that was killed.
    """
    system, path = place_of(bag.name)
    if is_here(system):
        yield Path(path)
        return
    with tempfile.TemporaryDirectory(prefix="bag_", dir=_own_folder()) as folder:
        here = Path(folder) / ("bag" if bag.files else "bag.mcap")
        copy_bag(bag, here)
        yield here


def _own_folder() -> str | None:
    try:
        return str(get_worker().local_directory)
    except ValueError:  # not in a worker
        return None


def _sha256(name: str, files: Iterator[BinaryIO]) -> str:
    """Return the hash of files one after the other; that of the ``name`` where there are none."""
    digest, some = hashlib.sha256(), False
    for file in files:
        some = True
        with file:
            while block := file.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest() if some else hashlib.sha256(name.encode()).hexdigest()
