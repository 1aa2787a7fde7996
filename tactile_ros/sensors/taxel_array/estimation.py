"""Force of every taxel by its own polynomial of second order [4], beside what is regressed.

[4] equilibrates with p0 + p1 u + p2 u^2; here p0 is 0, so that a taxel at rest carries nothing,
and outputs are those above the baseline. The rest of [4] has yet to come.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.regression import ESTIMATORS as REGRESSION_ESTIMATORS
from tactile_ros.regression import Regression

if TYPE_CHECKING:
    from tactile_ros.signals import Columns, Report, SensorConfig, Signals
    from tactile_ros.types import Array

POLYNOMIAL = 'polynomial'
ESTIMATORS = (POLYNOMIAL, *REGRESSION_ESTIMATORS)
FEWEST_ROWS = 5
PENALTY = 1e-9


class TaxelRegression(Regression):
    """Polynomials of the taxels, with place and total force from regressors.

    Parameters
    ----------
    config : TaxelArrayConfig
        Of the sensor.
    estimator : str or None
        'polynomial': the taxels' forces alone; a regressor: place and total force alone; None:
        both, the best regressor on held-out groups.

    Attributes
    ----------
    weights_ : ndarray, shape (t, 2), or None
        Of u and u^2 (N); NaN for taxels without enough rows.
    error_ : float
        Root mean square error of a taxel's force on the rows that it was learned from (N).
    """

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        super().__init__(config, None if estimator == POLYNOMIAL else estimator, channels=1)
        self.only = estimator or ''
        self.weights_: Array | None = None
        self.error_ = float('nan')

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        own = {} if self.weights_ is None else {'taxel_force': POLYNOMIAL}
        return {**super().estimators, **own}

    @property
    def report(self) -> Report:
        """Errors on held-out groups; of the taxels' forces, on the rows learned from."""
        own = {} if self.weights_ is None else {'taxel_force': {'fit_rmse': self.error_}}
        return {**super().report, **own}

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        if self.only != POLYNOMIAL:
            super().fit(signals, truth, groups)
        self.weights_ = None
        if self.only in ('', POLYNOMIAL) and 'taxel_force' in truth:
            force = np.asarray(truth['taxel_force'], np.float64)[signals.good]
            if (np.isfinite(force).sum(axis=0) >= FEWEST_ROWS).any():
                self._equilibrate(signals.delta[signals.good, :, 0], force)

    def _equilibrate(self, output: Array, force: Array) -> None:
        """Weights of all taxels at once, from outputs and forces (s, t)."""
        known = np.isfinite(force) & np.isfinite(output)
        u = np.where(known, output, 0.0)
        terms = np.stack([u, u**2], axis=-1)
        gram = np.einsum('sti,stj->tij', terms, terms)
        moment = np.einsum('sti,st->ti', terms, np.where(known, force, 0.0))
        scale = np.trace(gram, axis1=1, axis2=2)[:, None, None]
        seen = (known.sum(axis=0) >= FEWEST_ROWS) & (scale[:, 0, 0] > 0)
        gram = gram + np.where(seen[:, None, None], PENALTY * scale, 1.0) * np.eye(2)
        weights = np.linalg.solve(gram, moment[..., None])[..., 0]
        self.weights_ = np.where(seen[:, None], weights, np.nan)
        miss = self._forces(output) - force
        self.error_ = float(np.sqrt(np.nanmean(miss**2))) if seen.any() else float('nan')

    def _forces(self, output: Array) -> Array:
        """Forces of outputs (s, t)."""
        assert self.weights_ is not None
        return (self.weights_[:, 0] + self.weights_[:, 1] * output) * output

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        if self.weights_ is not None:
            known['taxel_force'] = self._forces(signals.delta[..., 0])
        return known


CLASSES = (*REGRESSION_CLASSES, TaxelRegression)
