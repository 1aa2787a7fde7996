# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Regressors of scikit-learn that `tactile bench reskin` compares with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import MissingPackageError

if TYPE_CHECKING:
    from collections.abc import Callable


def peers(extent: str) -> dict[str, Callable[[], object]]:
    """Regressors of scikit-learn."""
    try:
        from sklearn.ensemble import RandomForestRegressor
        from sklearn.linear_model import RidgeCV
        from sklearn.neighbors import KNeighborsRegressor
        from sklearn.neural_network import MLPRegressor
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import PolynomialFeatures, StandardScaler
    except ImportError as error:
        msg = 'bench reskin compares with scikit-learn: pip install scikit-learn'
        raise MissingPackageError(msg) from error
    mlp = dict(hidden_layer_sizes=(128, 128), early_stopping=True, random_state=0)
    return {
        'kNN (k = 5)': lambda: make_pipeline(StandardScaler(), KNeighborsRegressor(5)),
        'ridge, 2nd order': lambda: make_pipeline(
            StandardScaler(), PolynomialFeatures(2), RidgeCV(np.logspace(-3, 3, 7))
        ),
        'random forest': lambda: RandomForestRegressor(
            30 if extent == 'quick' else 100, random_state=0
        ),
        'MLP 128 x 128': lambda: make_pipeline(
            StandardScaler(), MLPRegressor(max_iter=100 if extent == 'quick' else 400, **mlp)
        ),
    }
