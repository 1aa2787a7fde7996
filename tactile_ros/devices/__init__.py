# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bytes: transports, codecs, drivers (serial_board, chip_array) and the twins that speak them."""
