# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""`make discover`: before and after the search, with a stand-in for it, and once whole."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from tests.terrain_estimator.discovery import discover
from tests.terrain_estimator.pages.findings import finding


def effect(name: str) -> dict[str, Any]:
    return {
        "name": name,
        "coefficient": 1.0,
        "sd": 0.1,
        "unit": "",
        "probability": 0.9,
        "log_bayes_factor": 9.0,
    }


@pytest.mark.parametrize(
    ("verdict", "names", "others", "truth", "right"),
    [
        ("none", [], [], (), True),
        ("unknown", ["payload"], [], (), False),
        ("unknown", ["payload"], [], ("unknown",), True),
        ("unknown", ["payload"], [], ("payload",), False),
        ("none", [], [], ("payload",), False),
        ("named", ["payload"], [], ("payload",), True),
        ("named", ["payload"], [], ("latency",), False),
        ("named", ["payload"], [], ("unknown",), False),
        ("named", ["payload"], [], (), False),
        ("named", ["payload", "latency"], [], ("latency", "payload"), True),
        ("named", ["payload", "latency"], [], ("payload",), False),
        ("confusable", ["payload", "latency"], ["latency"], ("latency",), True),
        ("confusable", ["payload", "latency"], ["latency"], ("grousers",), False),
        (
            "confusable",
            ["payload", "grousers", "latency"],
            ["latency"],
            ("grousers", "payload"),
            True,
        ),
        ("confusable", ["payload", "grousers", "latency"], ["latency"], ("grousers",), False),
    ],
)
def test_a_verdict_is_right_where_it_says_what_was_hidden(
    verdict: str, names: list[str], others: list[str], truth: tuple[str, ...], *, right: bool
) -> None:
    given = {
        "verdict": verdict,
        "effects": [effect(name) for name in names],
        "confusable_with": others,
    }
    assert discover.verdict_words(given, truth).startswith("The verdict is right") is right


def test_the_truth_is_written_after_the_search_and_is_what_its_checksum_promised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    search = tmp_path / "search"
    search.write_text(
        '#!/bin/sh\nwhile [ "$1" != --out ]; do shift; done\ntest ! -e "$2" && mkdir "$2"'
        ' && test ! -e "$2/../truth.json" && ls "$2/.." && cp "$FINDING" "$2/finding.json"\n',
        encoding="utf-8",
    )
    search.chmod(0o755)
    made = tmp_path / "made.json"
    made.write_text(json.dumps(finding("unknown") | {"runs": ["run_1", "run_3"]}), encoding="utf-8")
    monkeypatch.setenv("FINDING", str(made))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(discover, "executable", lambda *_names: str(search))
    earlier, out = tmp_path / "out/11", tmp_path / "out/11_2"
    earlier.mkdir(parents=True)
    (earlier / "truth.json").touch()
    assert (
        discover.main(
            ["--seed", "11", "--hide", "tether", "--seconds", "3", "--out", str(out.parent)]
        )
        == 0
    )
    assert [each.name for each in earlier.iterdir()] == ["truth.json"]
    assert (earlier / "truth.json").read_bytes() == b""
    said = capfd.readouterr().out
    truth = (out / "truth.json").read_bytes()
    assert hashlib.sha256(truth).hexdigest() in said.split("unsealed:")[0]
    assert "tether" not in said.split("unsealed:")[0]
    assert "Hidden was tether: pull that grows with distance" in said
    assert "which the library does not have. The verdict is right." in said
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "What was hidden" in report
    assert (
        f'<data value="{1e-3 * json.loads(truth)["cohesion_pa"][2]}">' in report
    )  # the third run's, beside the estimate


def test_a_search_that_fails_ends_with_its_code_and_unseals_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(discover, "executable", lambda *_names: "/bin/false")
    assert (
        discover.main(["--seed", "11", "--hide", "none", "--seconds", "3", "--out", str(tmp_path)])
        == 2
    )
    assert (tmp_path / "11/bags").exists()
    assert not (tmp_path / "11/truth.json").exists()


def test_a_hidden_drag_is_found_blind_and_unsealed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    asked = ["--seed", "7", "--hide", "drive_drag", "--seconds", "24", "--out", str(tmp_path)]
    assert discover.main(asked) == 0
    told = capfd.readouterr().out
    assert "named: drive_drag" in told
    assert "Hidden was drive_drag" in told
    assert "The verdict is right." in told
    folder = tmp_path / "7"
    assert json.loads((folder / "truth.json").read_text())["hidden"]
    assert "Hidden was drive_drag" in (folder / "report.html").read_text()
    assert "Hidden was" not in (folder / "finding" / "report.html").read_text()


def test_no_folder_is_used_twice(tmp_path: Path) -> None:
    kept = tmp_path / "1" / "note.txt"
    first, second = discover.new_folder(tmp_path / "1"), discover.new_folder(tmp_path / "1")
    kept.write_text("mine", encoding="utf-8")
    assert (first.name, second.name, discover.new_folder(tmp_path / "1").name) == (
        "1",
        "1_2",
        "1_3",
    )
    assert kept.read_text(encoding="utf-8") == "mine"
