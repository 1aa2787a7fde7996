"""An estimator that sees some of the columns of a table of features."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.training import fitted
from tactile_ros.types import Array, Estimator, Integers


class ColumnView:
    """Let an estimator see some columns only, so that estimators of unlike features compete.

    Parameters
    ----------
    estimator : Estimator
        Not fitted.
    columns : ndarray of int, shape (d,)
        Those that it sees.

    Attributes
    ----------
    fitted_ : bool
        Whether it was fitted.
    """

    fitted_: bool

    def __init__(self, estimator: Estimator, columns: Integers) -> None:
        self.estimator = estimator
        self.columns = np.asarray(columns, np.int64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> ColumnView:
        """Fit the estimator on its columns of x (s, f), targets y (s, k), groups (s,)."""
        self.estimator.fit(x[:, self.columns], y, groups)
        self.fitted_ = True
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features (s, f); NotCalibratedError before a fit."""
        fitted(self, 'fitted_')
        return self.estimator.predict(x[:, self.columns])
