# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The ROS edge: lifecycle nodes around the pure core. The only room that imports rclpy."""

from tactile_ros import use_one_thread

use_one_thread()
