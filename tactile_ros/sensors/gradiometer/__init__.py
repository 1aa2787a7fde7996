"""A disc magnet over four two-axis pixels that feels force in any stray field: paper [3].

A disc in an elastomer moves with the force on it; four pixels within 2 mm see Bx and Bz of it. A
stray field is the same at all four, so that what is left after removing the mean is the disc's
alone. [3] corrects the Hall sensitivity for temperature, removes means, adds norms and all
products of second order (91 features), and fits three forces and two torques by Huber loss with an
L1 penalty. Here force and torque are regressed from the change of field until those methods are
built; which regressor serves is chosen in `fit` by grouped cross-validation.

Source: [3] on a magnetic force sensor with gradiometric pixels, immune to stray fields.
"""

from __future__ import annotations

from functools import partial

from tactile_ros.regression import CLASSES, ESTIMATORS, Regression
from tactile_ros.sensors.gradiometer.config import GradiometerConfig, layout
from tactile_ros.sensors.gradiometer.device import (
    GradiometerConnection,
    open_gradiometer,
    simulate_gradiometer,
)
from tactile_ros.sensors.gradiometer.signal import presses
from tactile_ros.sensors.registry import SensorSpec

SENSOR = SensorSpec(
    key='gradiometer',
    paper='[3] gradiometric force sensor, immune to stray fields',
    summary='disc magnet over four pixels of two axes: force and two torques',
    transports=('serial: framed protocol, gradiometer, 8 channels and temperature',),
    config=GradiometerConfig,
    connection=GradiometerConnection,
    layout=layout,
    estimation=partial(Regression, channels=2),
    estimator_names=ESTIMATORS,
    open=open_gradiometer,
    simulate=simulate_gradiometer,
    presses=presses,
    classes=(GradiometerConfig, *CLASSES),
    recordings=dict,
)
