# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hands: for each driver its topics, types, order of joints and limits; postures; kinematics.

`drivers.py` has one class a driver. `config/hands/<hand>.yaml` describes a hand: its driver,
its fingers, which sensors they carry.
"""

from __future__ import annotations

from tactile_ros.hands.description import Finger, HandDescription, list_hands, load_hand
from tactile_ros.hands.drivers import HandDriver, list_drivers, load_driver

__all__ = [
    'Finger', 'HandDescription', 'HandDriver', 'list_drivers', 'list_hands', 'load_driver',
    'load_hand',
]  # fmt: skip
