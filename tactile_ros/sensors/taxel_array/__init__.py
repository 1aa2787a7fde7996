# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Piezoresistive taxels, few or thousands, on grippers: paper [4].

Rows and columns of conductive thread cross over piezoresistive textile; the converter reads every
crossing in 10 bits. Sensitivities differ by 55 % from taxel to taxel: [4] equilibrates each by a
polynomial of second order, tames drift by a Voigt model, and finds washers and tubes by their
footprint. Here each taxel has a monotone law, zero at zero, with branches of creep undone; objects
are placed by templates of coverage and least squares, and every patch of contact is listed.

Source: [4] on pick and place with piezoresistive tactile sensor arrays.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.sensors.registry import SensorSpec
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions, layout
from tactile_ros.sensors.taxel_array.estimation import CLASSES, ESTIMATORS, TaxelRegression
from tactile_ros.sensors.taxel_array.twin import NOISE, TaxelArrayConnection, presses
from tactile_ros.types import Outline

SENSOR = SensorSpec(
    key='taxel_array',
    paper='[4] piezoresistive taxel arrays for grippers',
    summary='16, 72 or 2000 pressure taxels: forces, places, outlines',
    transports=('serial: framed protocol, taxels of 10 bits',),
    config=TaxelArrayConfig,
    connection=TaxelArrayConnection,
    layout=layout,
    estimation=TaxelRegression,
    estimator_names=ESTIMATORS,
    noise=NOISE,
    presses=presses,
    classes=(TaxelArrayConfig, Outline, *CLASSES),
    # A tube whose width is unknown takes 10 ms a frame, more on a busy machine.
    demo={
        'rate_hz': 20.0,
        'positions': grid_positions(8, 9, 5e-3),
        'areas': np.full(72, 25e-6),
        'force_range': np.array([0.0, 5.0]),
        'parts': 'washer 14 6.5; tube 90 7',
    },
)
