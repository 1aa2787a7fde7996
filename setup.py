# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""For `pip install` alone: everything is said in pyproject.toml; ROS builds by CMakeLists.txt."""

from setuptools import setup

setup()
