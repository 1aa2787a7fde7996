"""For `pip install` alone: everything is said in pyproject.toml; ROS builds by CMakeLists.txt."""

from setuptools import setup

setup()
