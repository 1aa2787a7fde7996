# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A disc magnet over four two-axis pixels that feels force in stray fields: paper [3].

A disc in an elastomer moves with the force on it; four pixels within 2 mm see Bx and Bz of it. A
stray field is the same at all four. [3] corrects the Hall sensitivity for temperature, removes
means, adds norms and all products of second order (91 features), and fits three forces and two
torques. Here a model of the disc's field is inverted for its place, and force is a polynomial of
that; the chain of [3] is the floor on held-out groups, and can be chosen.
"""

from __future__ import annotations

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.model_inversion import Calibration
from tactile_ros.estimators.polynomial_force import PolynomialForce, ThermalPolynomial
from tactile_ros.sensors.gradiometer.config import GradiometerConfig, layout
from tactile_ros.sensors.gradiometer.estimation import ESTIMATORS, GradiometerEstimation
from tactile_ros.sensors.gradiometer.temperature import Thermometer
from tactile_ros.sensors.gradiometer.twin import NOISE, GradiometerConnection, presses, temperature
from tactile_ros.sensors.registry import SensorSpec
from tactile_ros.sensors.regression import CLASSES

OWN = (
    GradiometerEstimation, Thermometer, Calibration, CovarianceModel, PolynomialForce,
    ThermalPolynomial,
)  # fmt: skip

SENSOR = SensorSpec(
    key='gradiometer',
    paper='[3] gradiometric force sensor, immune to stray fields',
    summary='disc magnet over four pixels of two axes: force and two torques',
    transports=('serial: framed protocol, gradiometer, 8 channels and temperature',),
    config=GradiometerConfig,
    connection=GradiometerConnection,
    layout=layout,
    estimation=GradiometerEstimation,
    estimator_names=ESTIMATORS,
    noise=NOISE,
    temperature=temperature,
    presses=presses,
    classes=(GradiometerConfig, *OWN, *CLASSES),
    # twin, driver and estimators share a process and two cores with the recorder
    demo={'rate_hz': 300.0},
)
