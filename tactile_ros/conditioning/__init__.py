# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Stream steps: what happens to a frame before it is estimated from."""
