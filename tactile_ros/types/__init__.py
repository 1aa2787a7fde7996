# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The vocabulary of the house: frames, layouts, outlines, contacts, recordings and contracts.

Letters of shapes: s sample, t taxel, c channel, k contact, 3 for space. SI units; NaN and -1 mean
not measured or not estimated, never zero.
"""

from __future__ import annotations

from tactile_ros.types.contact import (
    STATE_FIELDS,
    Contact,
    ContactState,
    ContactStates,
    field_shape,
)
from tactile_ros.types.contracts import (
    Closing,
    Device,
    Estimation,
    Estimator,
    GripCommand,
    JointLimits,
    Report,
    Signals,
    Table,
    Twin,
)
from tactile_ros.types.frame import (
    Array,
    Bools,
    Bytes,
    Columns,
    Frame,
    FrameStatus,
    Integers,
    Layout,
    Outline,
    SensorConfig,
    Singles,
    TaxelStatus,
    admit_name,
    as_shape,
)
from tactile_ros.types.recording import TRUTH_KEYS, Recording, groups_of, join

__all__ = [
    'STATE_FIELDS', 'TRUTH_KEYS', 'Array', 'Bools', 'Bytes', 'Closing', 'Columns', 'Contact',
    'ContactState', 'ContactStates', 'Device', 'Estimation', 'Estimator', 'Frame', 'FrameStatus',
    'GripCommand', 'Integers', 'JointLimits', 'Layout', 'Outline', 'Recording', 'Report',
    'SensorConfig', 'Signals', 'Singles', 'Table', 'TaxelStatus', 'Twin', 'admit_name', 'as_shape',
    'field_shape', 'groups_of', 'join',
]  # fmt: skip
