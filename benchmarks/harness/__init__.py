# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tooling of the benches: rows, faults, fuzz tests, drawings and the page of all results."""
