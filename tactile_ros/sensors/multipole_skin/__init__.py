# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A magnetised sheet over twenty 3-axis chips that tells what shape touches it: paper [1].

A sheet of silicone with magnetic particles, magnetised in bands of alternating poles, lies bonded
on a soft layer over five clusters of four MLX90393. A press dents the sheet and squeezes it
sideways; the change of field at the chips is a picture of the contact's shape and turn. [1] cuts
windows of ten frames from it and recognises measuring heads from few presses by a network with
prototypes. Here shape, turn and place come from templates of the sheet's model and from classes
from few presses, or regressed and voted where those do not fit; each is chosen in `fit` by grouped
cross-validation. The network of [1] (`pronet`) names heads where it is asked for.

Source: [1] Contact Shape and Pose Recognition: Utilizing Multipole Magnetic Tactile Sensor with
Meta-learning Model.
"""

from __future__ import annotations

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.few_shot import SupportSet
from tactile_ros.estimators.prototypes import Prototypes
from tactile_ros.estimators.sheet_calibration import SkinModel
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig, layout
from tactile_ros.sensors.multipole_skin.estimation import MultipoleEstimation
from tactile_ros.sensors.multipole_skin.recogniser import (
    NETWORKS,
    NetworkClasses,
    Recogniser,
)
from tactile_ros.sensors.multipole_skin.twin import (
    NEW,
    NOISE,
    SHOTS,
    MultipoleSkinConnection,
    new_head,
    one_head,
    presses,
)
from tactile_ros.sensors.registry import EnrolmentScene, SensorSpec
from tactile_ros.sensors.regression import CLASSES, ESTIMATORS
from tactile_ros.types import Outline

SENSOR = SensorSpec(
    key='multipole_skin',
    paper='[1] multipole magnetic skin, contact shape and pose from few presses',
    summary='magnetised sheet over 20 three-axis chips in 5 clusters',
    transports=(
        'I2C: MLX90393 behind a TCA9548A switch, or on several buses',
        'serial: framed protocol, chips',
    ),
    config=MultipoleSkinConfig,
    connection=MultipoleSkinConnection,
    layout=layout,
    estimation=MultipoleEstimation,
    estimator_names=(*ESTIMATORS, *NETWORKS),
    noise=NOISE,
    presses=presses,
    classes=(
        MultipoleSkinConfig,
        Outline,
        MultipoleEstimation,
        Recogniser,
        NetworkClasses,
        Prototypes,
        SupportSet,
        SkinModel,
        CovarianceModel,
        *CLASSES,
    ),
    recordings=dict,
    new_class=EnrolmentScene(NEW.name, SHOTS, one_head, new_head),
)
