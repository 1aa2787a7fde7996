# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Readings of frames that all have the prior and the noise of their model."""

import numpy as np

from tactile_ros.estimators.model_inversion import FIXED, Frames, ModelPrior


def frames_of(model: ModelPrior, readings: np.ndarray) -> Frames:
    """Readings (s, m) with the model's prior of the state and noise."""
    rows = model.state, 1 / np.maximum(model.state_sigma, FIXED) ** 2, model.noise
    prior, information, noise = (np.tile(row, (len(readings), 1)) for row in rows)
    return Frames(readings, prior, information, noise, np.flatnonzero(model.state_sigma > 0))
