# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Worlds in which sensors grip, press and slide, written apart from what estimates."""
