# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Real boards with magnetometers under a magnetic skin: ReSkin, AnySkin, eFlesh.

N chips (MLX90393) measure the field of a skin with magnetic particles or magnets; pressing the
skin moves them. A USB board streams temperature and field of every chip as floats. There is no
model of the skin to invert, so place and force are regressed from the change of field since the
tare: place from the field now, force also from its fading means, since the skin is viscoelastic.
Which regressor serves is chosen in `fit` by grouped cross-validation and named in the calibration.

Sources: R. Bhirangi et al., ReSkin (CoRL 2021) and AnySkin (2024); V. Pattabiraman et al., eFlesh
(arXiv 2506.09994). k-nearest neighbours after paper [2].
"""

from __future__ import annotations

from tactile_ros.sensors.registry import SensorSpec
from tactile_ros.sensors.regression import CLASSES, ESTIMATORS, Regression
from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig, layout
from tactile_ros.sensors.reskin_board.recordings import shipped
from tactile_ros.sensors.reskin_board.twin import NOISE, ReskinBoardConnection, presses


class BoardRegression(Regression):
    """Regression that flags readings beyond its fit, and learns to separate touch from creep."""

    flags_range = True
    learns_touch = True


SENSOR = SensorSpec(
    key='reskin_board',
    paper='ReSkin, AnySkin, eFlesh',
    summary='real boards with five or more 3-axis chips under a magnetic skin',
    transports=('USB or UART serial, binary (115200 baud)',),
    config=ReskinBoardConfig,
    connection=ReskinBoardConnection,
    layout=layout,
    estimation=BoardRegression,
    estimator_names=ESTIMATORS,
    noise=NOISE,
    presses=presses,
    classes=(ReskinBoardConfig, BoardRegression, *CLASSES),
    recordings=shipped,
)
