# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Sensors: one folder each, found by its name.

A folder beside this file, or in a folder that the environment variable TACTILE_SENSORS names
(several like PATH), so that a sensor can live outside of the package.
"""

from __future__ import annotations

import os

from tactile_ros.sensors.registry import SensorSpec, designable, list_sensors, load_sensor

__all__ = ['SensorSpec', 'designable', 'list_sensors', 'load_sensor']

__path__.extend(filter(None, os.environ.get('TACTILE_SENSORS', '').split(os.pathsep)))
