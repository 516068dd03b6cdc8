# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper and of its authors' stored results (Banerjee et al. 2020), in percent."""

TRADE_OFF = {
    "linear": (4.04, 2.62),
    "P-ALPaCA + nominal, 0": (0.61, 3.85),
    "P-ALPaCA + nominal, 3.3e-05": (0.51, 3.48),
    "P-ALPaCA + nominal, 0.00033": (0.49, 3.38),
    "P-ALPaCA + nominal, 0.0033": (0.40, 2.88),
    "P-ALPaCA + nominal, 0.033": (1.18, 2.55),
    "P-ALPaCA + nominal, 0.33": (1.46, 2.51),
    "P-ALPaCA + nominal, 3.3": (1.72, 2.51),
}
"""Prediction error and parameter estimation error on loose sand."""
ESTIMATES = {
    "loose_sand": {
        "P-ALPaCA + nominal, 0.033": (3, 4),
        "P-ALPaCA + nominal, 0": (24, 47),
        "linear": (11, 11),
        "Iagnemma": (25, 20),
    },
    "compact_sand": {
        "P-ALPaCA + nominal, 0.033": (1, 10),
        "P-ALPaCA + nominal, 0": (37, 43),
        "linear": (3, 9),
        "Iagnemma": (4, 6),
    },
}
"""Error of c and of phi after 40 s in its figure, one run."""
