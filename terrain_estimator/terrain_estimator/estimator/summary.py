# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The posterior of the ground as intervals, and whether the data or the prior set them."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.distributions import normal_cdf_at
from terrain_estimator.estimator.soundness import unsound
from terrain_estimator.intervals import credible_bounds
from terrain_estimator.model.metadata import AddedEffect, Metadata
from terrain_estimator.observation import Floats
from terrain_estimator.update import Estimate, NamedEffect, Seconds

IDENTIFIED_VARIANCE = 0.1
"""[1] Largest share of the prior variance that the data leave of an identified parameter."""
MOST_CORRELATED = 1.0 - 1e-9
"""[1] Largest published correlation.

It keeps a covariance definite where two sharp hypotheses leave but a line between them.
"""


@dataclass(frozen=True, slots=True)
class Beliefs:
    """The prior of (c [Pa], tan phi) [2], the user's where given, and of the known soils."""

    prior_mean: Floats
    prior_sd: Floats
    soils: tuple[str, ...]  # names that the model knows
    prior_soils: tuple[float, ...]  # [1] their probabilities

    @classmethod
    def of(cls, metadata: Metadata, config: CoreConfig) -> "Beliefs":
        """Site knowledge of the configuration over the model's own prior, for each parameter.

        Raises ConfigError where the model does not know the soil.
        """
        soils = tuple(soil.name for soil in metadata.soils)
        if config.prior_soil and config.prior_soil not in soils:
            raise ConfigError(
                f"parameter prior.soil: {config.prior_soil!r} is unknown to {metadata.model_id}:"
                f" give {', '.join(soils)}"
            )
        probable = [name == (config.prior_soil or name) for name in soils]
        given_mean = (config.prior_cohesion_mean_pa, config.prior_tan_phi_mean)
        given_sd = (config.prior_cohesion_sd_pa, config.prior_tan_phi_sd)
        mean = np.where(np.array(given_sd) > 0.0, given_mean, metadata.prior_mean)
        sd = np.where(np.array(given_sd) > 0.0, given_sd, metadata.prior_sd)
        return cls(
            mean.astype(np.float64),
            sd.astype(np.float64),
            soils,
            tuple(p / sum(probable) for p in probable),
        )


class Summary(NamedTuple):
    """What a state says of the ground."""

    estimate: Estimate
    condition: float  # [1] number of the covariance of c and tan phi, scaled to unit diagonal
    unsound: str  # the reason why it must not be published; empty where it may be


def summary_of(
    moments: Floats,
    soil_probability: Sequence[float],
    beliefs: Beliefs,
    doubt: float,
    unknown: float,
    effects: tuple[NamedEffect, ...],
) -> Summary:
    """Return the summary of a posterior, with NaN where its numbers give none.

    ``moments`` [3, 2] are mean and covariance of (c [Pa], tan phi); ``doubt`` as in
    :func:`inflated`, ``unknown`` as in :func:`changing`.
    """
    covariance = changing(moments[0], moments[1:], beliefs, unknown)
    mean, covariance = inflated(moments[0], covariance, beliefs, doubt)
    soils = tuple([min(probability, 1.0) for probability in soil_probability])
    estimate = summarise(mean, covariance, beliefs, soils)
    if effects:
        estimate = estimate._replace(effects=effects)
    return Summary(estimate, _condition(covariance), unsound(estimate))


def named(effects: Sequence[AddedEffect], moments: Floats) -> tuple[NamedEffect, ...]:
    """Return the effects with mean and deviation of their sizes, from ``moments`` [J, 2]."""
    return tuple(
        NamedEffect(effect.name, effect.unit, mean, deviation(variance))
        for effect, (mean, variance) in zip(effects, moments.tolist(), strict=True)
    )


def _condition(covariance: Floats) -> float:
    """Return the condition number of the 2 x 2 covariance scaled to unit diagonal."""
    (cohesion, shared), (_, friction) = covariance.tolist()
    spread = deviation(cohesion * friction)
    correlation = abs(shared) / spread if spread > 0.0 else math.nan
    return (1.0 + correlation) / max(1.0 - correlation, sys.float_info.epsilon)


def changing(mean: Floats, covariance: Floats, beliefs: Beliefs, unknown: float) -> Floats:
    """Return the covariance of (c, tan phi) about ``mean`` on ground that may go on changing.

    The share ``unknown`` [1] of a deviation that holds the prior's mean and spread is added.
    """
    if unknown == 0.0:
        return covariance
    with np.errstate(all="ignore"):
        shift = beliefs.prior_mean - mean
        added: Floats = np.diag(beliefs.prior_sd**2) + np.outer(shift, shift)
        return covariance + unknown**2 * added


def inflated(
    mean: Floats, covariance: Floats, beliefs: Beliefs, doubt: float
) -> tuple[Floats, Floats]:
    """Return moments of (c, tan phi), inflated by the prior with probability ``doubt`` [1].

    So much is the probability that the ground is another, of which only the prior is known.
    """
    if doubt == 0.0:
        return mean, definite(covariance)
    with np.errstate(all="ignore"):
        shift = beliefs.prior_mean - mean
        between = (1.0 - doubt) * covariance + doubt * np.diag(beliefs.prior_sd**2)
        between += doubt * (1.0 - doubt) * np.outer(shift, shift)
        return mean + doubt * shift, definite(between)


def definite(covariance: Floats) -> Floats:
    """Return ``covariance`` [2, 2] symmetric, with a correlation of MOST_CORRELATED at most.

    One that is not positive definite keeps a wrong diagonal, which is never published.
    """
    (cohesion, one), (other, friction) = covariance.tolist()
    most = MOST_CORRELATED * deviation(cohesion) * deviation(friction)
    shared = max(-most, min(0.5 * (one + other), most))
    return np.array([[cohesion, shared], [shared, friction]])


def deviation(variance: float) -> float:
    """Return the standard deviation; NaN where the variance is not above zero and finite."""
    return math.sqrt(variance) if 0.0 < variance < math.inf else math.nan


def summarise(
    mean: Floats, covariance: Floats, beliefs: Beliefs, soil_probability: tuple[float, ...]
) -> Estimate:
    """Return the record of a marginal posterior of (c [Pa], tan phi) and of the soils.

    ``mean`` is [2], ``covariance`` [2, 2]. The caller fills in its own counts.
    """
    (cohesion, _), (_, friction) = covariance.tolist()
    # plain numbers: two are too few for arrays
    means, sds = mean.tolist(), (deviation(cohesion), deviation(friction))
    (lower, upper), (lower_friction, upper_friction) = (
        credible_bounds(*each, 0.05) for each in zip(means, sds, strict=True)
    )
    known = [
        sd * sd <= IDENTIFIED_VARIANCE * (prior * prior)
        for sd, prior in zip(sds, beliefs.prior_sd.tolist(), strict=True)
    ]
    below_zero = [normal_cdf_at(-each / sd) for each, sd in zip(means, sds, strict=True)]
    return Estimate(
        mean=mean,
        covariance=covariance,
        lower_95=np.array([lower, lower_friction]),
        upper_95=np.array([upper, upper_friction]),
        identified=(known[0], known[1]),
        mass_below_zero=min(below_zero[0] + below_zero[1], 1.0),
        change_probability=0.0,
        soils=beliefs.soils,
        soil_probability=soil_probability,
        effects=(),
        observations_used=0,
        observations_waiting=0,
        time_used_s=0.0,
        seconds=Seconds(0, 0),
    )
