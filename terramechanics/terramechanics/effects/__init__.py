# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named effects that the nominal model can lack."""

from terramechanics.effects.registry import EFFECTS, Description, describe, make_effect

__all__ = ["EFFECTS", "Description", "describe", "make_effect"]
