# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Magnets in a soft half cylinder over two 3-axis chips that locate a touch: paper [2].

Three neodymium blocks lie in a body of soft polyurethane, two MLX90393 under it. A press moves the
magnets, and the six readings tell which cell of the surface is touched: [2] votes among the
nearest training samples (K = 1, 5, 10) for one of 6, 15 or 25 cells. Two conditions make a good
design: no chip saturates under the largest force, and the least force moves at least one chip's
reading by more than it can resolve. Here the cell is voted or follows from the place, place and
force are regressed from the change of field, what the chips have in common separates stray fields
from touches, and without any truth the nominal model of the pad answers.

Source: [2] on the design of a soft tactile sensor with permanent magnets and Hall elements.
"""

from __future__ import annotations

from tactile_ros.sensors.magnet_pad.body_model import NOISE
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig, layout
from tactile_ros.sensors.magnet_pad.estimation import CLASSES, ESTIMATORS, Localisation
from tactile_ros.sensors.magnet_pad.twin import MagnetPadConnection, presses
from tactile_ros.sensors.registry import SensorSpec

SENSOR = SensorSpec(
    key='magnet_pad',
    paper='[2] soft magnet pad, which cell is touched by nearest neighbours',
    summary='three magnets in a soft half cylinder over two three-axis chips',
    transports=('I2C: two MLX90393 on one bus', 'serial: framed protocol, chips'),
    config=MagnetPadConfig,
    connection=MagnetPadConnection,
    layout=layout,
    estimation=Localisation,
    estimator_names=ESTIMATORS,
    noise=NOISE,
    presses=presses,
    classes=CLASSES,
)
