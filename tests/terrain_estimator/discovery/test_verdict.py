# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The rule from evidence to verdict, and its calibration, on numbers."""

import itertools
import json
from importlib.resources import files

import pytest

from studies.calibration.thresholds import CalibrationCase, thresholds
from terrain_estimator.discovery.evidence.verdict import Gains, Thresholds, Verdict, is_pair, judge
from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.discovery.next_drive.missing_signals import MissingSignal
from terrain_estimator.discovery.next_drive.next_drive import BESIDES, NextDrive, advise
from terrain_estimator.discovery.single_wheel.investigation import shown_by_one_wheel
from terrain_estimator.discovery.single_wheel.separation import separate_by
from terramechanics.effects import EFFECTS

RULE = Thresholds(anything=8.0, share=0.7, apart=0.1)


def gains(named: dict[str, float], nothing_with: float, best_with: float) -> Gains:
    ranked = sorted(named.items(), key=lambda item: -item[1])
    return Gains(
        tuple((Hypothesis((LibraryEffect(name),)), gain) for name, gain in ranked),
        nothing_with,
        best_with,
    )


@pytest.mark.parametrize(
    ("found", "verdict", "named"),
    [
        (gains({"payload": -4.0, "latency": -5.0}, -20.0, -24.0), Verdict.NONE, ()),
        (gains({"payload": 300.0, "latency": 20.0}, 250.0, 290.0), Verdict.NAMED, ("payload",)),
        (gains({"payload": 300.0, "latency": 20.0}, 250.0, 380.0), Verdict.NAMED, ("payload",)),
        (
            gains({"grousers": 186.0, "odometry_scale": 193.0}, 86.0, 170.0),
            Verdict.CONFUSABLE,
            ("odometry_scale", "grousers"),
        ),
        (
            gains({"slope_bias": 90.0, "payload": 70.0}, 700.0, 710.0),
            Verdict.UNKNOWN,
            ("slope_bias",),
        ),
        (
            gains({"slope_bias": -3.0, "payload": -4.0}, 50.0, 45.0),
            Verdict.UNKNOWN,
            ("slope_bias",),
        ),
    ],
)
def test_the_verdict_follows_from_the_share_of_the_gap_that_a_name_closes(
    found: Gains, verdict: Verdict, named: tuple[str, ...]
) -> None:
    judgement = judge(found, RULE)
    assert judgement.verdict is verdict
    assert tuple(name for each in judgement.named for name in each.names) == named
    assert sum(judgement.probabilities.values()) == pytest.approx(1.0, abs=1e-12)


def test_probabilities_agree_with_the_verdict() -> None:
    for found, most in (
        (gains({"payload": -4.0, "latency": -5.0}, -20.0, -24.0), "none"),
        (gains({"payload": 300.0, "latency": 20.0}, 250.0, 290.0), "payload"),
        (gains({"slope_bias": 90.0, "payload": 70.0}, 700.0, 710.0), "unknown"),
    ):
        probabilities = judge(found, RULE).probabilities
        assert max(probabilities, key=lambda name: probabilities[name]) == most
        assert probabilities[most] > 0.9


def test_two_axles_of_one_effect_are_one_name() -> None:
    axles = tuple(
        (Hypothesis((LibraryEffect("failed_wheel", axle),)), gain)
        for axle, gain in ((2, 100.0), (1, 98.0))
    )
    assert judge(Gains(axles, 80.0, 95.0), RULE).verdict is Verdict.NAMED


@pytest.mark.parametrize(
    ("second", "best_with", "verdict"),
    [
        (397.0, 1712.0, True),
        (355.0, 1710.0, False),
        (6.0, 1325.0, False),
        (355.0, 1660.0, True),
        (355.0, 1668.0, False),
    ],  # closes all, a part, gains nothing worth, beats a discrepancy, beats it by too little
)
def test_two_effects_are_named_where_the_second_closes_nearly_all_that_the_first_leaves(
    second: float, best_with: float, *, verdict: bool
) -> None:
    single = gains({"payload": 1318.0, "latency": 20.0}, 1300.0, best_with)
    both = Gains(
        ((Hypothesis((LibraryEffect("payload"), LibraryEffect("drive_drag"))), 1318.0 + second),),
        1300.0,
        max(best_with, 1720.0),
        single=1318.0,
    )
    assert is_pair(single, both, RULE) == verdict


@pytest.mark.parametrize(
    ("second", "explainable", "verdict"),
    [(27.0, 1831.0, False), (190.0, 2100.0, False), (210.0, 2100.0, True), (52.0, 1850.0, True)],
)  # adds little; adds nearly a tenth; adds a tenth; adds little, but closes nearly all
def test_a_second_effect_that_adds_little_and_leaves_something_is_none(
    second: float, explainable: float, *, verdict: bool
) -> None:
    """A right name of another law leaves something, of which some other effect takes a part."""
    single = gains({"rate_dependence": 1796.0}, 1339.0, 1810.0)
    names = LibraryEffect("rate_dependence"), LibraryEffect("multipass")
    both = Gains(((Hypothesis(names), 1796.0 + second),), 1339.0, explainable, single=1796.0)
    assert is_pair(single, both, RULE) == verdict


@pytest.mark.parametrize(
    ("first", "second", "alone", "gained", "verdict"),
    [
        (2119.0, "coulomb_drag", 1424.0, 60.0, False),
        (3018.0, "sinkage_bias", 70.0, 246.0, True),
        (1462.0, "payload", 1229.0, 278.0, True),
    ],
)  # takes up what the first law misses; acts elsewhere; adds much
def test_a_second_effect_that_closes_all_adds_much_or_what_it_gains_alone(
    first: float, second: str, alone: float, gained: float, *, verdict: bool
) -> None:
    single = gains({"drive_drag": first, second: alone}, 900.0, first + gained - 30.0)
    names = LibraryEffect("drive_drag"), LibraryEffect(second)
    both = Gains(((Hypothesis(names), first + gained),), 900.0, first + gained - 10.0, single=first)
    assert is_pair(single, both, RULE) == verdict


@pytest.mark.parametrize(("best_with", "verdict"), [(1100.0, True), (1120.0, False)])
def test_two_effects_are_named_where_a_discrepancy_explains_little_more(
    best_with: float, *, verdict: bool
) -> None:
    names = LibraryEffect("rate_dependence"), LibraryEffect("slip_sinkage")
    both = Gains(((Hypothesis(names), 1000.0),), 500.0, best_with, single=600.0)
    judgement = judge(both, RULE)
    assert judgement.verdict is (Verdict.NAMED if verdict else Verdict.UNKNOWN)
    assert [each.names for each in judgement.named] == [("rate_dependence", "slip_sinkage")]
    assert (judgement.probabilities["unknown"] < 0.5) == verdict


def test_pairs_with_a_common_effect_are_told_apart_by_what_the_other_one_adds() -> None:
    named = tuple(
        (Hypothesis((LibraryEffect("payload"), LibraryEffect(name))), gain)
        for name, gain in (("drive_drag", 1715.0), ("coulomb_drag", 1590.0))
    )
    assert judge(Gains(named, 1300.0, 1700.0, single=1318.0), RULE).verdict is Verdict.NAMED
    assert judge(Gains(named, 1300.0, 1700.0), RULE).verdict is Verdict.CONFUSABLE


def test_a_pair_has_one_name_whichever_of_its_effects_comes_first() -> None:
    drag = LibraryEffect("drive_drag")
    front, rear = (LibraryEffect("failed_wheel", axle) for axle in (0, 2))
    named = ((Hypothesis((front, drag)), 1500.0), (Hypothesis((drag, rear)), 1495.0))
    judgement = judge(Gains(named, 900.0, 1505.0, single=1000.0), RULE)
    assert judgement.verdict is Verdict.NAMED
    assert [each.label for each in judgement.named] == ["failed_wheel (axle 0) + drive_drag"]
    assert set(judgement.probabilities) == {"none", "unknown", "failed_wheel + drive_drag"}


def test_confusable_effects_come_with_what_would_separate_them() -> None:
    best = NextDrive(
        "firm_ground", "on to firm ground", 40.0, 168.8, ("grousers", "odometry_scale")
    )
    pair = ("grousers", "odometry_scale")
    bogie = MissingSignal("bogie angle", 310.2, 4.1, pair, separates=True)
    useless = MissingSignal("motor torque", 5.0, 4.1, pair, separates=False)
    advice = advise(["grousers", "odometry_scale"], [best], [bogie, useless])
    assert advice.startswith(
        "Drive 40 s on to firm ground: 169 nat more are expected, if it is grousers, against"
        " odometry_scale"
    )
    assert (
        "Measure the bogie angle, too: with it 310 nat are expected of runs like these, if it is"
        " grousers, against odometry_scale, instead of 4." in advice
    )
    assert "motor torque" not in advice
    assert "For odometry_scale alone: roll a measured distance" in advice
    assert advise(["grousers", "grousers"], [best], [bogie]) == ""
    assert set(BESIDES) <= set(EFFECTS)


def test_effects_that_tables_of_one_wheel_confuse_come_with_a_measurement() -> None:
    shown = [Hypothesis((LibraryEffect(name),)) for name in shown_by_one_wheel()]
    for first, second in itertools.combinations(shown, 2):
        assert separate_by([first, second])
    assert "two speeds" in separate_by(
        [
            Hypothesis((LibraryEffect("slip_sinkage"),)),
            Hypothesis((LibraryEffect("rate_dependence"),)),
        ]
    )
    assert separate_by(shown[:1]) == ""


def test_calibration_cuts_between_effects_in_the_library_and_those_taken_out() -> None:
    samples = [CalibrationCase("", gains({"payload": -4.0}, 6.0, -9.0), None)]
    for share in (0.82, 0.9, 1.0):
        with_truth = gains({"payload": 300.0 * share, "latency": 10.0}, 250.0, 300.0)
        samples.append(
            CalibrationCase(
                "payload",
                with_truth,
                gains({"latency": 10.0, "bulldozing": 300.0 * (share - 0.5)}, 250.0, 300.0),
            )
        )
    found = thresholds(samples)
    assert found.anything == pytest.approx(9.0)
    assert 0.5 < found.share < 0.82
    assert found.apart == pytest.approx(0.05)


def test_the_thresholds_that_ship_are_those_of_the_rule() -> None:
    shipped = json.loads(
        (files("terrain_estimator.discovery.evidence") / "thresholds.json").read_text(
            encoding="utf-8"
        )
    )
    assert shipped["anything"] >= 8.0
    assert 0.3 < shipped["share"] < 0.95
    assert 0.05 < shipped["apart"] <= 0.3
