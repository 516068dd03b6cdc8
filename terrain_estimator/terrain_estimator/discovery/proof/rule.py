# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One rule from what held-out runs show of an effect: proven, refuted, or undecided.

An effect is proven, and added, where with it rollouts of five seconds or predictions of one second
get better on the held-out runs, by a 95 % interval above zero, or the runs as a whole are LIKELIER;
neither gets worse by an interval below zero, unless rollouts miss by no more than what the model
with the effect expects of them (about the noise floor); and of the way to the noise floor one of
them may close LEAST_CLOSED, by the upper end of its interval. A gap that chance alone may have made
has none and does not count.

Runs that hardly excite an effect prove nothing, whatever their predictions do by chance: those that
are not LIKELIER prove an effect only if LIKELIER was to be expected of them, were it there. They
refute nothing either: where less than DECISIVE was to be expected, an effect that did not prove
itself is undecided, neither added nor refuted. It is refuted even there if the runs are LIKELIER
without it, if predictions get worse, or if rollouts stay FAR off.

The measure of rollouts is the root mean square error of all signals, means over a second, in
standard deviations of the sensors' noise: no model can talk it up by being less sure of itself.
That of one second ahead is the log likelihood of all rows: c and tan phi of a single run may stand
in for an effect in a rollout, while the rows together show it. That of whole runs is the log Bayes
factor at the size that the other runs found, with a run's own unknowns integrated out: half a run
that is judged by the other half has a c and a tan phi that make up for the effect wherever the
halves are alike, a ground that the whole run need not allow.
"""

from terrain_estimator.discovery.proof.gap import FAR, Gap

LIKELIER = 8.0
"""[nat] Log Bayes factor of held-out runs that proves an effect, as "anything" in the verdict."""
DECISIVE = 18.0
"""[nat] Least log Bayes factor to expect of held-out runs that refute an effect by not showing it.

One of F nat scatters by sqrt(2 F), so that of runs of which this is expected 95 % are LIKELIER, if
the size found is exact.
"""
LEAST_CLOSED = 1.0 / 3.0
"""[1] Share of the gap that an effect closes at least.

One that leaves more is not what is missing, though it helps. In the practice cases
field_batches("0000c7c7") and ("0000d8d8") the upper ends of right names were 0.39 or more, those of
two of three wrong ones whose gap was wide 0.20 and 0.32.
"""

MOST_ABOVE = 1.33
"""[1] Largest error of rollouts, in noise floors, that the model expects of itself.

The largest of 64 held-out minutes with nothing missing. An interval alone would excuse more, the
shorter the held-out runs are.
"""


def is_proven(gap: Gap | None, step_gap: Gap, likelier: float, expected: float | None) -> bool:
    """Return whether held-out runs prove an effect.

    ``gap`` is that of rollouts, None where nothing was simulated ahead: then the others decide
    alone. ``step_gap`` is that of predictions of one second. ``likelier`` is the log Bayes factor
    [nat] of the runs as a whole, ``expected`` the one to expect of them, were the effect there;
    None where nothing is to be added.
    """
    shows = expected is None or max(expected, likelier) >= LIKELIER
    return shows and better(gap, step_gap, likelier)


def is_undecided(gap: Gap | None, step_gap: Gap, likelier: float, expected: float | None) -> bool:
    """Return whether held-out runs neither prove nor refute an effect; as :func:`is_proven`."""
    quiet = expected is not None and expected < DECISIVE and abs(likelier) < LIKELIER
    proven = is_proven(gap, step_gap, likelier, expected)
    return quiet and not proven and not contradicts(gap, step_gap)


def better(gap: Gap | None, step_gap: Gap, likelier: float) -> bool:
    """Apply the rule to rollouts, predictions of one second, and the log Bayes factor [nat].

    Rollouts that get worse contradict an effect where they then miss by more than what the model
    with it expects of its own error: beyond chance, or MOST_ABOVE. ``gap`` is None where nothing
    was simulated ahead: then the others decide alone.
    """
    ahead = step_gap.nll_improvement_95
    rollouts = None if gap is None else gap.improvement_95
    helps = any(ends is not None and ends[0] > 0.0 for ends in (rollouts, ahead))
    most = most_closed(gap, step_gap)
    closes = most is None or most >= LEAST_CLOSED
    return (likelier >= LIKELIER or helps) and closes and not harms(gap, step_gap)


def contradicts(gap: Gap | None, step_gap: Gap) -> bool:
    """Return whether predictions get worse with the effect, or rollouts stay FAR off with it."""
    far = gap is not None and gap.after is not None and gap.after > FAR * gap.noise_floor
    return far or harms(gap, step_gap)


def harms(gap: Gap | None, step_gap: Gap) -> bool:
    """Return whether predictions get worse with the effect, beyond what is expected of them."""
    ahead = step_gap.nll_improvement_95
    rollouts = None if gap is None else gap.improvement_95
    worse = gap is not None and rollouts is not None and rollouts[1] <= 0.0 and not _expected(gap)
    return worse or (ahead is not None and ahead[1] <= 0.0)


def _expected(gap: Gap) -> bool:
    """Return whether rollouts miss by no more than what the model with the effect expects."""
    return (
        gap.after is not None
        and gap.after <= MOST_ABOVE * gap.noise_floor
        and gap.above_floor_95 is not None
        and gap.above_floor_95[0] <= 0.0
    )


def most_closed(gap: Gap | None, step_gap: Gap) -> float | None:
    """Return the share of the gap that an effect closes at most, by 95 % intervals.

    None where chance alone may have made both gaps.
    """
    both = (gap, step_gap)
    known = [each.closed_95[1] for each in both if each is not None and each.closed_95 is not None]
    return max(known, default=None)
