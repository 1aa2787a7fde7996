"""Our framed serial protocol: sync, kind, length, sequence, device time, payload, CRC-32.

docs/serial_protocol.md describes the bytes; `framed_payloads` and `framed_readings` are what they
carry, `framed_decoder` finds frames in a stream.
"""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.framed_payloads import Payload
from tactile_ros.devices.framed_readings import pack

SYNC = b'\xa5\x5a'
VERSION = 1
HEADER_BYTES = 16
TRAILER_BYTES = 4
SEQUENCES = 2**32
# CRC-32 of any bytes followed by their own CRC-32, lowest byte first
RESIDUE = 0x2144DF1C
HEAD = struct.Struct('<2sBBHH')


def frame_bytes(payload: Payload) -> int:
    """Length of a whole frame."""
    return HEADER_BYTES + payload.size + TRAILER_BYTES


def head(payload: Payload, version: int = VERSION) -> bytes:
    """First eight bytes of a frame: sync, version, kind, count, length."""
    return HEAD.pack(SYNC, version, payload.kind, payload.count, payload.size)


@lru_cache(maxsize=32)
def record(payload: Payload) -> np.dtype[np.void]:
    """A frame's fields as they lie on the wire."""
    return np.dtype(
        [
            ('head', 'u1', (HEAD.size,)),
            ('sequence', '<u4'),
            ('time_us', '<u4'),
            ('body', payload.dtype),
            ('crc', '<u4'),
        ]
    )


def encode(
    payload: Payload,
    counts: npt.ArrayLike,
    sequence: int,
    time_us: npt.ArrayLike,
    temperature_c: npt.ArrayLike = np.nan,
    states: npt.ArrayLike = 0,
) -> bytes:
    """Write frames as a board does.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    counts : array_like of int, shape (t, c) or (s, t, c)
        Counts of the converter.
    sequence : int
        Of the first frame.
    time_us : array_like of int, broadcast to (s,)
        The board's clock (microseconds); both wrap at 2^32.
    temperature_c, states : array_like
        As in `framed_payloads.pack`.

    Returns
    -------
    bytes
        s frames, one after the other.

    Raises
    ------
    ValueError
        If the shape is neither.
    """
    table = np.asarray(counts, np.int64)
    if table.ndim not in (2, 3) or table.shape[-2:] != (payload.count, payload.channels):
        want = f'({payload.count}, {payload.channels})'
        msg = f'counts of encode must have shape {want} or (s, {want[1:]}; received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    rows = np.zeros(len(table), record(payload))
    rows['head'] = np.frombuffer(head(payload), np.uint8)
    rows['sequence'] = (sequence + np.arange(len(table))) % SEQUENCES
    rows['time_us'] = np.asarray(time_us, np.int64) % SEQUENCES
    rows['body'] = pack(payload, table, temperature_c, states)
    size = rows.itemsize
    data = bytearray(rows.tobytes())
    for start in range(0, len(data), size):
        end = start + size - TRAILER_BYTES
        struct.pack_into('<I', data, end, zlib.crc32(data[start:end]))
    return bytes(data)
