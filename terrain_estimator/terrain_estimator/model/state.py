# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The state of the model: named tensors, of constant size but for those of the open block.

The bank at the start of the open block, H hypotheses over D parameters:

- ``mean`` [H, D], ``precision`` [H, D, D], ``log_weight`` [H]
- ``weight`` [H]: of each in the mixture; the mass on negative c or tan phi does not count
- ``age`` [H]: blocks since each was started; those of the start of a drive are older than any
- ``kind`` [H]: index of the soil whose constants, plus its own deviations, each has; K more where
  it has the net

The open block and the prior:

- ``block`` [n, P]: packed observations, n < 10
- ``prior_mean``, ``prior_sd`` [2] of (c [kPa], tan phi), the user's or the model's
- ``random_walk`` [2]: their drift [1/sqrt(s)]
- ``log_soils`` [K]: log prior probability of each soil, -inf where the user excludes it

The mixture:

- ``strength_mean`` [2], ``strength_covariance`` [2, 2]: of (c [kPa], tan phi) over everything
- ``soils`` [K]: probability of each soil
- ``expansion`` [K, 2 + M + V]: mean c [kPa], tan phi, deviations of the soil constants and values
  of the named effects, given each soil; of one without any hypothesis, the prior's
- ``expected`` [D], ``covariance`` [D, D]: within the most probable soil, which predict the velocity
- ``constants`` [6], ``varied`` [C, 6]: of that soil, as in ContactModel

The velocity between blocks, each []:

- ``velocity`` [m/s], ``velocity_variance``: now
- ``acceleration`` [m/s^2], ``acceleration_variance``: the last; NaN where none is known
- ``velocity_acceleration_covariance``: of the two
- ``feature_noise``: variance of the noise of the acceleration's features
- ``change``, ``change_weight``: sum of the square changes of the acceleration a step, and of their
  weights

The report, which a caller reads after each observation, each [] but where said:

- ``forecast`` [m/s], ``forecast_variance``: of the velocity one step ahead; NaN where there is none
- ``innovation`` [m/s], ``innovation_variance``: measured minus predicted velocity; NaN where there
  was none
- ``misfit``, ``degrees``: squared Mahalanobis distance of the last block and its degrees of
  freedom; NaN where there was none
- ``single_misses``, ``white_misses`` [R]: how the rows of the last block missed what was predicted
  before it, as in ``terrain_estimator.model.innovation``; NaN where there was none
- ``closed``: 1 where the observation closed a block
- ``changed``: probability that the ground changed within the last RECENT blocks, as of the last one
  that was closed
- ``usable`` [W] bool: wheels that are measured and in the model's range
"""

from torch import Tensor

State = dict[str, Tensor]
