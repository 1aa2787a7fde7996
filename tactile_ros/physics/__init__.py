# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Physics of fields, elastomers and resistive sheets as functions of arrays."""
