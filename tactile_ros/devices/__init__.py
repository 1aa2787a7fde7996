# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bytes: transports, codecs and the simulated twins that speak them.

transport -> reskin_protocol, framed_protocol -> serial_board: boards on serial ports;
transport -> mlx90393 -> chip_array: chips on I2C buses. timestamps says when frames were
taken, fault_flags which taxels cannot be trusted, connections where a sensor is plugged in.
simulated_serial and simulated_i2c are the twins of both roads.
"""
