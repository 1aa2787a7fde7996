"""Perceptrons stand in `estimators/regression`."""

from tactile_ros.estimators.regression import Perceptron

__all__ = ['Perceptron']
