# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A saved state goes on to the bit; a damaged or foreign one is refused, never unpickled."""

import hashlib
import io
import json
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.saved_state import StateFileError, pack_state, unpack_state
from terrain_estimator.files.atomic import write_file
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.offline.state_files import read_state
from tests.terrain_estimator.drives import drive_observations

SAVED_AFTER = 63  # in the middle of a block
LATEST = 2_147_483_647_000_000_000  # [ns]


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture(scope="module")
def drive(model: LoadedModel) -> list[Observation]:
    return drive_observations(model.rover, model.metadata.soils[0], 9.0, seed=1)


@pytest.fixture(scope="module")
def content(model: LoadedModel, drive: list[Observation]) -> bytes:
    estimator = Estimator(model, CoreConfig())
    for observation in drive[:SAVED_AFTER]:
        estimator.update(observation)
    return pack_state(estimator.save(), model.sha256)


def test_a_restored_estimator_gives_the_same_bits_as_one_that_ran_on(
    model: LoadedModel, drive: list[Observation], content: bytes
) -> None:
    whole, restored = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    for observation in drive[:SAVED_AFTER]:
        whole.update(observation)
    restored.restore(unpack_state(content, model.sha256, "here"))
    for observation in drive[SAVED_AFTER:]:
        one, other = whole.update(observation), restored.update(observation)
        assert (
            other.estimate.mean.tobytes() + other.estimate.covariance.tobytes()
            == one.estimate.mean.tobytes() + one.estimate.covariance.tobytes()
        )
        assert (other.prediction, other.decision, other.estimate.observations_used) == (
            one.prediction,
            one.decision,
            one.estimate.observations_used,
        )


def test_the_state_before_the_first_observation_can_be_kept_too(
    model: LoadedModel, drive: list[Observation]
) -> None:
    fresh, other = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    other.update(drive[0])
    other.restore(unpack_state(pack_state(fresh.save(), model.sha256), model.sha256, "here"))
    assert other.last_stamp_ns is None
    estimate = other.update(drive[0]).estimate
    assert (estimate.observations_used, estimate.observations_waiting) == (0, 1)


def test_a_restored_estimator_saves_what_it_was_given(model: LoadedModel, content: bytes) -> None:
    estimator, arrays = Estimator(model, CoreConfig()), unpack_state(content, model.sha256, "here")
    estimator.restore(arrays)
    again = estimator.save()
    assert again.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(again[name], array, err_msg=name)


@pytest.mark.parametrize(
    ("stamp_ns", "words"), [(0, ""), (-1, "no time"), (LATEST, ""), (LATEST + 1, "no time")]
)
def test_the_last_stamp_is_one_that_a_message_can_hold(
    model: LoadedModel, content: bytes, stamp_ns: int, words: str
) -> None:
    """The seconds of a stamp are a signed number of 32 bits."""
    arrays = unpack_state(content, model.sha256, "here")
    arrays["last.stamp_ns"] = np.array(stamp_ns)
    estimator = Estimator(model, CoreConfig())
    if words:
        with pytest.raises(StateFileError, match=words):
            estimator.restore(arrays)
    else:
        estimator.restore(arrays)


@pytest.mark.parametrize(
    "values",
    [
        {"prior.soil": "regolith"},
        {"prior.cohesion_mean": 4e3, "prior.cohesion_sd": 1e2},
        {"forgetting_time": 100.0},
    ],
)
def test_a_state_that_was_learnt_from_another_prior_is_refused(
    model: LoadedModel, content: bytes, values: dict[str, Any]
) -> None:
    """It was taken, and the parameters did nothing."""
    estimator = Estimator(model, configure(CoreConfig, values))
    arrays = unpack_state(content, model.sha256, "here")
    with pytest.raises(
        StateFileError, match=r"another prior: give prior\.\* and forgetting_time as they were"
    ):
        estimator.restore(arrays)
    assert estimator.last_stamp_ns is None
    Estimator(model, CoreConfig(use_torque=False, gate_probability=0.0)).restore(
        arrays
    )  # which are no prior


def reheaded(content: bytes, payload: bytes | None = None, **changes: object) -> bytes:
    """Another header, and another payload with the right size and sha256."""
    line, _, old = content.partition(b"\n")
    payload = old if payload is None else payload
    right = {"size": len(payload), "sha256": hashlib.sha256(payload).hexdigest()}
    return json.dumps(json.loads(line) | right | changes).encode() + b"\n" + payload


def archive(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def bomb() -> bytes:
    """64 MB of zeros in less than 100 kB."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, x=np.zeros(8_000_000))
    return buffer.getvalue()


class Trap:
    """Would be called by a pickle that is loaded."""

    def __reduce__(self) -> tuple[Any, ...]:
        return pytest.fail, ("a state file was unpickled",)


DAMAGE: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a flipped bit": (lambda c: c[:-9] + bytes([c[-9] ^ 1]) + c[-8:], "is damaged"),
    "a cut file": (lambda c: c[:-100], "is damaged"),
    "an empty file": (lambda _: b"", "first line is no JSON"),
    "a number": (lambda _: b"1\n", "format is None"),
    "another version": (lambda c: reheaded(c, version=2), "version is 2, expected 5"),
    "another model": (lambda c: reheaded(c, model_sha256="00"), "model_sha256 is '00'"),
    "a first line without end": (lambda _: b"[" * 100_000, "first line is no JSON"),
    "nothing but a header": (lambda c: reheaded(c, b""), "no archive of plain arrays"),
    "a bomb": (
        lambda c: reheaded(c, bomb()),
        "no archive of plain arrays .unpacks to [0-9]+ bytes",
    ),
    "no archive": (lambda c: reheaded(c, b"nothing"), "no archive of plain arrays"),
    "a pickle": (lambda c: reheaded(c, pickle.dumps(Trap())), "no archive of plain arrays"),
    "an array of objects": (
        lambda c: reheaded(c, archive(x=np.array([Trap()], dtype=object))),
        "no archive of plain arrays",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_file_is_refused_by_name(
    model: LoadedModel, content: bytes, tmp_path: Path, name: str
) -> None:
    damage, words = DAMAGE[name]
    (tmp_path / "a.state").write_bytes(damage(content))
    with pytest.raises(StateFileError, match=rf"a\.state: .*{words}"):
        read_state(tmp_path / "a.state", model.sha256)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"state.mean": None}, "mean is missing"),
        (
            {"state.mean": np.zeros((27, 3))},
            r"mean is float64 \(27, 3\), the model's is float64 \(27, 11\)",
        ),
        ({"state.kind": np.zeros(27)}, "kind is float64"),
        ({"state.strength_mean": np.full(2, np.nan)}, "not finite"),
        ({"counts": None}, "counts or numbers are missing"),
        ({"last.pitch": None}, "another version's.*pitch"),
        ({"last.yaw": np.zeros(())}, "another version's.*yaw"),
    ],
)
def test_arrays_that_are_no_state_of_the_model_change_nothing(
    model: LoadedModel,
    drive: list[Observation],
    content: bytes,
    changes: dict[str, Any],
    words: str,
) -> None:
    estimator = Estimator(model, CoreConfig())
    before = estimator.update(drive[0])
    arrays = unpack_state(content, model.sha256, "here") | changes
    with pytest.raises(StateFileError, match=words):
        estimator.restore({name: value for name, value in arrays.items() if value is not None})
    after = estimator.update(drive[1])
    assert after.estimate.observations_waiting == before.estimate.observations_waiting + 1


def test_a_write_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.state"
    write_file(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_file(path, b"new")
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.state"]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(StateFileError, match=r"none\.state: cannot be read"):
        read_state(tmp_path / "none.state", "")


def test_two_that_write_at_once_both_succeed(tmp_path: Path) -> None:
    path = tmp_path / "ground.state"
    with ThreadPoolExecutor(4) as pool:
        for written in [pool.submit(write_file, path, bytes([k]) * 10_000) for k in range(100)]:
            written.result()
    content = path.read_bytes()
    assert content == content[:1] * 10_000
    assert list(tmp_path.iterdir()) == [path]
