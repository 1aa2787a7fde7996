# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hands in MJCF and skins of their fingertips; worlds that run them stand in `test/reference`."""
