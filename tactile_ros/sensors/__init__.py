"""Sensors: one folder each, found by its name."""

from __future__ import annotations

from tactile_ros.sensors.registry import SensorSpec, list_sensors, load_sensor

__all__ = ['SensorSpec', 'list_sensors', 'load_sensor']
