# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A large skin with five wires that tells place and force of one touch: paper [5].

A weakly conducting sheet with a well conducting border lies over Velostat and a foil. Exciting
its corners A and C, then B and D, makes the foil's potential tell the place; the resistance from
foil to corner, in a divider, tells the force. [5] takes place from the linear formula and force
from a network of radial basis functions of place and resistance. Untouched, a real foil may float.
Here place comes from a harmonic map and force from a power law that varies smoothly over the
sheet, unless the formula, the network or a regressor does better on held-out places of the
calibration.

Source: [5] on a large-area tactile sensor with five electrodes.
"""

from __future__ import annotations

from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig, layout
from tactile_ros.sensors.five_wire_skin.estimation import CLASSES, ESTIMATORS, FiveWireEstimation
from tactile_ros.sensors.five_wire_skin.twin import NOISE, FiveWireSkinConnection, presses
from tactile_ros.sensors.registry import SensorSpec

SENSOR = SensorSpec(
    key='five_wire_skin',
    paper='[5] five-wire skin, place and force over a large area',
    summary='one resistive sheet with four corner wires and a foil',
    transports=('serial: framed protocol, wires',),
    config=FiveWireSkinConfig,
    connection=FiveWireSkinConnection,
    layout=layout,
    estimation=FiveWireEstimation,
    estimator_names=ESTIMATORS,
    noise=NOISE,
    presses=presses,
    classes=(FiveWireSkinConfig, *CLASSES),
)
