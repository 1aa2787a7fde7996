"""The ROS edge: lifecycle nodes around the pure core. The only room that imports rclpy."""

from tactile_ros import use_one_thread

use_one_thread()
