"""Estimation for sensors without a model of their own: regressors of what truth tells."""

from __future__ import annotations

from tactile_ros.regression.estimation import CLASSES, ESTIMATORS, Regression

__all__ = ['CLASSES', 'ESTIMATORS', 'Regression']
