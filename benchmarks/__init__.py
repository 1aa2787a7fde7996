# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Benches: figures beside those of the papers, of peers, of bounds and aims."""
