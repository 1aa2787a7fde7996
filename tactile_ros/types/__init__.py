"""The vocabulary of the house: frames, layouts, outlines, contacts, recordings and contracts.

Letters of shapes: s sample, t taxel, c channel, k contact, 3 for space. SI units; NaN and -1 mean
not measured or not estimated, never zero.
"""

from __future__ import annotations

from tactile_ros.types.arrays import Array, Bools, Bytes, Integers, Singles, as_shape
from tactile_ros.types.contact import (
    STATE_FIELDS,
    Contact,
    ContactState,
    ContactStates,
    field_shape,
)
from tactile_ros.types.contracts import Closing, CommandTopic, Device, Estimator, Hand, Twin
from tactile_ros.types.frames import Frame, Layout, Outline
from tactile_ros.types.grip import GripCommand, JointLimits
from tactile_ros.types.recording import TRUTH_KEYS, Recording
from tactile_ros.types.status import FrameStatus, TaxelStatus

__all__ = [
    'STATE_FIELDS',
    'TRUTH_KEYS',
    'Array',
    'Bools',
    'Bytes',
    'Closing',
    'CommandTopic',
    'Contact',
    'ContactState',
    'ContactStates',
    'Device',
    'Estimator',
    'Frame',
    'FrameStatus',
    'GripCommand',
    'Hand',
    'Integers',
    'JointLimits',
    'Layout',
    'Outline',
    'Recording',
    'Singles',
    'TaxelStatus',
    'Twin',
    'as_shape',
    'field_shape',
]
