"""Estimation for sensors without a model of their own: regressors of what truth tells."""

from __future__ import annotations

from tactile_ros.regression.estimation import ESTIMATORS, Regression
from tactile_ros.regression.recognition import CLASSES, Recognition

__all__ = ['CLASSES', 'ESTIMATORS', 'Recognition', 'Regression']
