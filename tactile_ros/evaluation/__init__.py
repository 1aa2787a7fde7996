# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Evaluation of recordings: bags and files in, replay, errors against truth, a report out."""
