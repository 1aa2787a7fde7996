"""Status bits of taxels and of frames, as in the messages."""

from __future__ import annotations

from enum import IntFlag


class TaxelStatus(IntFlag):
    """Bits of one taxel in one frame, as in TactileFrame."""

    STALE = 1
    SATURATED = 2
    STUCK = 4
    ERROR = 8
    WRAPPED = 16
    DEAD = 32


class FrameStatus(IntFlag):
    """Why a frame's contacts are limited or must not be used, as in TactileContacts."""

    NOT_CALIBRATED = 1
    NO_BASELINE = 2
    BAD_TAXELS = 4
    SATURATED = 8
    STRAY_FIELD = 16
    OUT_OF_RANGE = 32
    ABSTAINED = 64
    STALE = 128
