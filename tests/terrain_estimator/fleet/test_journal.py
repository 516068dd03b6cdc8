# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The journal of a fleet: what is finished, equal, refused, and tried again."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from terrain_estimator.fleet.journal import Journal
from terrain_estimator.fleet.sources import FleetError, FoundBag
from terrain_estimator.fleet.task import BagResult

IDENTITY = {"model_sha256": "abc", "use_imu": True}
BAGS = [FoundBag(f"/bags/{letter}", (), 7) for letter in "cab"]
RESULT = BagResult("1f", "estimate", {"tan_phi": 0.6}, b"seconds")


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    with Journal(tmp_path / "journal", IDENTITY) as opened:
        opened.add(BAGS)
        yield opened


def test_the_first_name_has_the_estimate_whichever_bag_was_replayed(journal: Journal) -> None:
    journal.finish(1, RESULT)  # of c
    journal.finish_equal(2, "1f")
    journal.finish(3, BagResult("2f", "damaged", {"message": "<bag> is cut"}))
    assert [(row["bag"], row["outcome"], row.get("equal_to")) for row in journal.rows()] == [
        ("/bags/a", "estimate", None),
        ("/bags/b", "damaged", None),
        ("/bags/c", "equal", "/bags/a"),
    ]
    assert [row.get("message") for row in journal.rows()][1] == "/bags/b is cut"
    assert list(journal.seconds()) == [("/bags/a", b"seconds")]


def test_finished_bags_stay_finished_and_failed_ones_are_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    with Journal(path, IDENTITY) as journal:
        journal.add(BAGS)
        journal.finish(1, RESULT)
        journal.fail(2, "the disk is full")
        assert (journal.counts["estimate"], journal.counts["failed"], journal.left) == (1, 1, 1)
    with Journal(path, IDENTITY) as journal:
        journal.add(BAGS)
        assert (journal.found, journal.left) == (3, 2)
        assert [journal.next(after) for after in (0, 2, 3)] == [(2, BAGS[1]), (3, BAGS[2]), None]
        journal.add([FoundBag("/bags/c", (), 8)])  # it has grown
        assert (journal.found, journal.left, journal.counts["estimate"]) == (3, 3, 0)
        assert journal.next(3) == (4, FoundBag("/bags/c", (), 8))


def test_a_journal_of_other_arguments_is_refused_by_what_differs(tmp_path: Path) -> None:
    Journal(tmp_path / "journal", IDENTITY).__exit__(None, None, None)
    with pytest.raises(FleetError, match=r"\(use_imu was true, is false\)"):
        Journal(tmp_path / "journal", IDENTITY | {"use_imu": False})


def test_a_second_fleet_in_the_same_folder_is_refused(tmp_path: Path, journal: Journal) -> None:
    with pytest.raises(FleetError, match="another fleet works in this folder"):
        Journal(tmp_path / "journal", IDENTITY)
    assert journal.found == 3


def test_a_file_that_is_no_journal_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(b"my notes" * 100)
    with pytest.raises(FleetError, match="no journal of a fleet"):
        Journal(path, IDENTITY)
    assert path.read_bytes() == b"my notes" * 100
