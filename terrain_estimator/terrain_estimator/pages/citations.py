# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Literature behind an estimate, selected by the parts of its model."""

from collections.abc import Iterator, Sequence

from terramechanics.effects import EFFECTS

BANERJEE = (
    "S. Banerjee, J. Harrison, P. M. Furlong, M. Pavone: Adaptive Meta-Learning for Identification"
    " of Rover-Terrain Dynamics. i-SAIRAS 2020."
)
WONG = (
    "J.-Y. Wong, A. R. Reece: Prediction of rigid wheel performance based on the analysis of"
    " soil-wheel stresses. Journal of Terramechanics 4, 1967."
)
BOGGS = (
    "P. T. Boggs, R. H. Byrd, R. B. Schnabel: A stable and efficient algorithm for nonlinear"
    " orthogonal distance regression. SIAM Journal on Scientific and Statistical Computing 8, 1987."
)
ALSPACH = (
    "D. L. Alspach, H. W. Sorenson: Nonlinear Bayesian estimation using Gaussian sum"
    " approximations. IEEE Transactions on Automatic Control 17, 1972."
)
ADAMS = (
    "R. P. Adams, D. J. C. MacKay: Bayesian online changepoint detection. arXiv:0710.3742, 2007."
)
RUNNALLS = (
    "A. R. Runnalls: Kullback-Leibler approach to Gaussian mixture reduction. "
    "IEEE Transactions on Aerospace and Electronic Systems 43, 2007."
)
IAGNEMMA = (
    "K. Iagnemma, S. Kang, H. Shibly, S. Dubowsky: Online terrain parameter estimation for wheeled"
    " mobile robots with application to planetary rovers. IEEE Transactions on Robotics 20, 2004."
)
HARRISON = (
    "J. Harrison, A. Sharma, M. Pavone: Meta-learning priors for efficient online Bayesian"
    " regression. WAFR 2018."
)
MITCHELL = (
    "T. J. Mitchell, J. J. Beauchamp: Bayesian variable selection in linear regression. "
    "Journal of the American Statistical Association 83, 1988."
)
MEHRA = (
    "R. K. Mehra: On the identification of variances and adaptive Kalman filtering. "
    "IEEE Transactions on Automatic Control 15, 1970."
)
BAR_SHALOM = (
    "Y. Bar-Shalom, X. R. Li, T. Kirubarajan: Estimation with applications to tracking and"
    " navigation. Wiley, 2001."
)
BAARDA = (
    "W. Baarda: A testing procedure for use in geodetic networks. "
    "Netherlands Geodetic Commission, Publications on Geodesy 2, 1968."
)
LUGANNANI = (
    "R. Lugannani, S. Rice: Saddle point approximation for the distribution of the sum of"
    " independent random variables. Advances in Applied Probability 12, 1980."
)


def citations(
    rows: Sequence[str], parameters: Sequence[str], effects: Sequence[str]
) -> Iterator[str]:
    """Yield the citations of a model with these regression rows, parameters and named effects."""
    yield from (BANERJEE, WONG, BOGGS, ALSPACH, ADAMS, RUNNALLS)
    yield from (MEHRA, BAR_SHALOM, BAARDA, LUGANNANI)
    if any(row.startswith("torque") for row in rows):
        yield IAGNEMMA
    if any(name.startswith("net") for name in parameters):
        yield from (HARRISON, MITCHELL)
    for name in effects:
        yield f"{name}: {EFFECTS[name].source}."
