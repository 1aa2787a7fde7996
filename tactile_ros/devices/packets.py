"""Wire format of the ReSkin / AnySkin board: N x float32 (t, x, y, z), little-endian, then CR LF.

The format has no header, checksum, counter or clock. A frame of N chips is 16 N + 2 bytes; t is in
degrees Celsius, x, y, z in microtesla. This module is the codec; `framing` finds frames in a
stream.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools

Words = npt.NDArray[np.uint32]

TERMINATOR = b'\r\n'
CHIP_BYTES = 16
MICROTESLA_PER_TESLA = 1e6
FIELD_LIMIT_MICROTESLA = 150_000.0
TEMPERATURE_LIMITS_C = (-40.0, 125.0)
# a chip's step is 0.1 uT or more; smaller fields are 0 on the wire
SMALLEST_MICROTESLA = 1e-6
GRID_TOLERANCE = 0.01
MOST_CHIPS = 64

_MAGNITUDE = np.uint32(0x7FFFFFFF)
_NAN = np.uint32(0x7FC00000)
TEXT = b'0123456789+-.,\t\r\n eEnaifNAIF'


def _bits(value: float) -> np.uint32:
    """Pattern of a positive float32; patterns order as the numbers do."""
    return np.uint32(np.array(value, '<f4').view('<u4'))


_HIGHEST = np.array([_bits(TEMPERATURE_LIMITS_C[1]), *[_bits(FIELD_LIMIT_MICROTESLA)] * 3])
_COLDEST = np.uint32(_bits(-TEMPERATURE_LIMITS_C[0]) | np.uint32(0x80000000))
_SMALLEST = _bits(SMALLEST_MICROTESLA)
_SPAN = _HIGHEST - _SMALLEST


def frame_bytes(chips: int) -> int:
    """Length of a frame of `chips` chips, its CR LF included."""
    if not 1 <= chips <= MOST_CHIPS:
        msg = f'chips must be 1 to {MOST_CHIPS}; received {chips}'
        raise ValueError(msg)
    return CHIP_BYTES * chips + len(TERMINATOR)


def encode(values: npt.ArrayLike, temperature_c: npt.ArrayLike = 25.0) -> bytes:
    """Write frames as the board does.

    Parameters
    ----------
    values : array_like, shape (t, 3) or (s, t, 3)
        Flux density of every chip (T).
    temperature_c : array_like, broadcast to (s, t)
        Chip temperature (degrees Celsius).

    Returns
    -------
    bytes
        s frames, one after the other.

    Raises
    ------
    ValueError
        If the shape is neither.
    """
    table = np.asarray(values, np.float64)
    if table.ndim not in (2, 3) or table.shape[-1] != 3:
        msg = f'values of encode must have shape (t, 3) or (s, t, 3); received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    samples, chips = table.shape[:2]
    size = frame_bytes(chips)
    fields = np.empty((samples, chips, 4), '<f4')
    fields[..., 0] = temperature_c
    fields[..., 1:] = table * MICROTESLA_PER_TESLA
    fields[..., 1:][np.abs(fields[..., 1:]) < SMALLEST_MICROTESLA] = 0.0
    rows = np.empty((samples, size), np.uint8)
    rows[:, :-2] = fields.reshape(samples, -1).view(np.uint8)
    rows[:, -2:] = np.frombuffer(TERMINATOR, np.uint8)
    return rows.tobytes()


def words(rows: npt.NDArray[np.uint8]) -> Words:
    """Fields of frames as the 32-bit patterns they are sent as.

    Parameters
    ----------
    rows : ndarray, shape (s, 16 t + 2)
        Bytes of whole frames.

    Returns
    -------
    ndarray, shape (s, t, 4)
        Little-endian patterns of t, x, y, z.
    """
    samples, size = rows.shape
    payload = np.ascontiguousarray(rows[:, :-2])
    return payload.view('<u4').reshape(samples, size // CHIP_BYTES, 4)


def plausible(patterns: Words, quantum: Array | None = None) -> tuple[Bools, Bools]:
    """Tell which chips carry readings that a chip can give.

    Parameters
    ----------
    patterns : ndarray, shape (s, t, 4)
        From `words`.
    quantum : ndarray, shape (3,), or None
        Step of the chips' readings (T), where it is known: readings off that grid are damage.

    Returns
    -------
    possible : ndarray, shape (s, t)
        Finite, |B| < 150 mT, -40 < t < 125 (0 or at least 1e-6), and on the grid.
    natural : ndarray, shape (s, t)
        Possible, and no field is nonzero below 1 pT.

    Notes
    -----
    The patterns are compared as integers, which orders them as the numbers and is silent on NaN.
    Misaligned frames are seldom natural: CR LF as the upper half of a float32 is 7e-33, and a
    field with CR or LF as its highest byte (7e-33 .. 4e-31) is not possible either.
    """
    magnitude = patterns & _MAGNITUDE
    usual = (magnitude - _SMALLEST) < _SPAN
    usual[..., 0] &= patterns[..., 0] < _COLDEST
    natural = _every(usual)
    if quantum is None and natural.all():
        return natural, natural
    fits = magnitude < _HIGHEST
    fits[..., 0] &= patterns[..., 0] < _COLDEST
    usual |= magnitude == 0
    natural = _every(fits & usual)
    # no chip is that near to zero degrees
    fits[..., 0] &= usual[..., 0]
    highest = patterns >> np.uint32(24)
    fits &= (highest != TERMINATOR[0]) & (highest != TERMINATOR[1])
    possible = _every(fits)
    if quantum is not None:
        possible &= _on_grid(patterns, possible, quantum)
    return possible, possible & natural


def _every(fields: Bools) -> Bools:
    """Whether all fields of a chip are so."""
    chips: Bools = np.logical_and.reduce(fields, axis=-1)
    return chips


def _on_grid(patterns: Words, possible: Bools, quantum: Array) -> Bools:
    """Whether all three fields of a chip are multiples of its step."""
    known = np.where(possible[..., None], patterns[..., 1:], np.uint32(0))
    steps = known.view('<f4') / (quantum * MICROTESLA_PER_TESLA)
    return _every(np.abs(steps - np.rint(steps)) <= GRID_TOLERANCE)


def readings(patterns: Words, error: Bools | None = None) -> tuple[Array, Array]:
    """Patterns as numbers.

    Parameters
    ----------
    patterns : ndarray, shape (s, t, 4)
        From `words`.
    error : ndarray, shape (s, t), or None
        Chips whose readings are replaced by NaN.

    Returns
    -------
    values : ndarray, shape (s, t, 3)
        Flux density (T).
    temperature_c : ndarray, shape (s, t)
        Chip temperature (degrees Celsius).
    """
    if error is not None:
        patterns = np.where(error[..., None], _NAN, patterns)
    fields = patterns.view('<f4').astype(np.float64)
    return fields[..., 1:] / MICROTESLA_PER_TESLA, fields[..., 0]


def foreign(data: bytes, chips: int) -> str | None:
    """Say what else a stream is, when it holds no frames of `chips` chips.

    Parameters
    ----------
    data : bytes
        A few hundred bytes of the stream.
    chips : int
        Expected count of chips.

    Returns
    -------
    str or None
        One sentence; None when nothing is recognised.
    """
    if len(data) >= CHIP_BYTES and not data.translate(None, TEXT) and b'\n' in data:
        return _foreign_text(data)
    other = board_size(data)
    if other not in (None, chips):
        return f'the stream has frames of {other} chips, not of {chips}: set chips to {other}'
    return None


def _foreign_text(data: bytes) -> str:
    """Say which firmware prints this text and why it is not read."""
    if b'\t' in data:
        return (
            'the board prints text (ReSkin firmware, x y z t with tabs): '
            'load its binary stream firmware'
        )
    return (
        'the board prints text (AnySkin firmware, t,x,y,z without a separator between chips, '
        'so that the numbers fuse and cannot be told apart): load its binary stream firmware'
    )


def board_size(data: bytes) -> int | None:
    """Count of chips whose frames fill `data`; None when no count fits three frames in a row."""
    stream = np.frombuffer(data, np.uint8)
    if len(stream) < 2:
        return None
    ends = np.zeros(len(stream) + 1, bool)
    ends[2:] = (stream[:-1] == TERMINATOR[0]) & (stream[1:] == TERMINATOR[1])
    for chips in range(1, MOST_CHIPS + 1):
        size = frame_bytes(chips)
        if len(ends) <= 3 * size:
            break
        runs = ends[: -2 * size] & ends[size:-size] & ends[2 * size :]
        for end in np.flatnonzero(runs[size:])[:8] + size:
            rows = stream[end - size : end + 2 * size].reshape(3, size)
            if plausible(words(rows))[1].all():
                return chips
    return None
