"""Counts, temperatures and states of a framed payload: out of its bytes and into them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.devices.framed_payloads import TAXEL_BITS, Kind, Payload
from tactile_ros.types import Array, Bytes, Integers, TaxelStatus

if TYPE_CHECKING:
    import numpy.typing as npt

NO_TEMPERATURE = -32768
DEGREES_PER_COUNT = 0.01

_SHIFTS = np.array([0, 2, 4, 6], np.uint8)
_STATES = np.array([0, TaxelStatus.STALE, TaxelStatus.ERROR, TaxelStatus.ERROR], np.uint8)
_FAILED = 2


class Readings(NamedTuple):
    """Counts of frames.

    Attributes
    ----------
    counts : ndarray, shape (s, t, c)
        Integers as float64; NaN for chips that did not answer.
    temperature_c : ndarray, shape (s, t), or None
        Chip temperature (degrees Celsius), NaN where not measured; None: none in this payload.
    status : ndarray, shape (s, t)
        Bits of `TaxelStatus`: SATURATED at the converter's own limit, STALE and ERROR as the board
        says.
    """

    counts: Array
    temperature_c: Array | None
    status: Bytes


def unpack(payload: Payload, body: npt.NDArray[np.void]) -> Readings:
    """Take counts out of payloads.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    body : ndarray of `payload.dtype`, shape (s,)
        The bytes.

    Returns
    -------
    Readings
        s frames.
    """
    if payload.kind == Kind.CHIPS:
        return _chips(payload, body)
    if payload.kind == Kind.TAXELS:
        counts = unpack_bits(body['packed'], payload.count).astype(np.float64)[..., None]
    else:
        counts = body['counts'].astype(np.float64)
    temperature_c = None
    if payload.kind == Kind.GRADIOMETER:
        one = _degrees(body['temperature'].astype(np.float64))
        temperature_c = np.repeat(one[:, None], payload.count, axis=1)
    return Readings(counts, temperature_c, _saturated(payload, counts))


def _chips(payload: Payload, body: npt.NDArray[np.void]) -> Readings:
    """Temperature, field and state of every chip."""
    chips = body['chips'].astype(np.float64)
    counts, temperature_c = chips[..., 1:], _degrees(chips[..., 0])
    status = _saturated(payload, counts)
    packed = body['states']
    if np.count_nonzero(packed):
        states = (packed[..., None] >> _SHIFTS & 3).reshape(len(packed), 4 * packed.shape[1])
        states = states[:, : payload.count]
        failed = states >= _FAILED
        counts[failed] = np.nan
        temperature_c[failed] = np.nan
        status = np.where(failed, _STATES[_FAILED], status | _STATES[states])
    return Readings(counts, temperature_c, status)


def _saturated(payload: Payload, counts: Array) -> Bytes:
    """SATURATED where a channel is at the converter's limit."""
    clipped = np.abs(counts) >= payload.full_count
    if not np.count_nonzero(clipped):
        return np.zeros(counts.shape[:2], np.uint8)
    status: Bytes = np.where(clipped.any(axis=-1), np.uint8(TaxelStatus.SATURATED), np.uint8(0))
    return status


def _degrees(counts: Array) -> Array:
    """Hundredths of a degree as degrees; NaN where none was measured."""
    degrees = counts * DEGREES_PER_COUNT
    missing = counts == NO_TEMPERATURE
    if np.count_nonzero(missing):
        degrees[missing] = np.nan
    return degrees


def unpack_bits(packed: Bytes, count: int) -> npt.NDArray[np.uint16]:
    """10 bit counts, lowest bit first: count i is bits 10 i to 10 i + 9 of the byte string.

    Parameters
    ----------
    packed : ndarray, shape (s, 5 n)
        Four counts in five bytes each.
    count : int
        Counts to take (t), at most 4 n.

    Returns
    -------
    ndarray, shape (s, t)
        Counts.
    """
    samples, groups = len(packed), packed.shape[1] // 5
    five = packed.reshape(samples, groups, 5).astype(np.uint16)
    counts = np.empty((samples, groups, 4), np.uint16)
    for i in range(4):
        counts[..., i] = (five[..., i] >> 2 * i) | (five[..., i + 1] << 8 - 2 * i)
    counts &= 2**TAXEL_BITS - 1
    return counts.reshape(samples, 4 * groups)[:, :count]


def pack_bits(counts: npt.NDArray[np.uint16]) -> Bytes:
    """Inverse of `unpack_bits`: counts (s, t) to bytes (s, 5 n), the last group filled with 0."""
    groups = -(-counts.shape[1] // 4)
    four = np.zeros((len(counts), groups * 4), np.uint16)
    four[:, : counts.shape[1]] = counts & 2**TAXEL_BITS - 1
    four = four.reshape(len(counts), groups, 4)
    five = np.zeros((len(counts), groups, 5), np.uint16)
    for i in range(4):
        five[..., i] |= four[..., i] << 2 * i
        five[..., i + 1] |= four[..., i] >> 8 - 2 * i
    return five.astype(np.uint8).reshape(len(counts), 5 * groups)


def pack(
    payload: Payload,
    counts: Integers,
    temperature_c: npt.ArrayLike = np.nan,
    states: npt.ArrayLike = 0,
) -> npt.NDArray[np.void]:
    """Write counts as a board does; what a kind does not carry is left out.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    counts : ndarray of int, shape (s, t, c)
        Clipped to what the converter can give.
    temperature_c : array_like, broadcast to (s, t)
        Chip temperature (degrees Celsius); NaN: not measured.
    states : array_like of int, broadcast to (s, t)
        Of chips: 0 new reading, 1 the same reading as before, 2 no answer.

    Returns
    -------
    ndarray of `payload.dtype`, shape (s,)
        Payloads.
    """
    samples = len(counts)
    low = -payload.full_count if payload.signed else 0
    clipped = np.clip(counts, low, payload.full_count)
    degrees = np.broadcast_to(np.asarray(temperature_c, np.float64), (samples, payload.count))
    hundredths = np.where(np.isnan(degrees), NO_TEMPERATURE, np.rint(degrees * 100))
    body = np.zeros(samples, payload.dtype)
    if payload.kind == Kind.TAXELS:
        body['packed'] = pack_bits(clipped[..., 0].astype(np.uint16))
    elif payload.kind == Kind.CHIPS:
        body['chips'][..., 0] = hundredths
        body['chips'][..., 1:] = clipped
        body['states'] = _pack_states(np.broadcast_to(states, (samples, payload.count)))
    else:
        body['counts'] = clipped
        if payload.kind == Kind.GRADIOMETER:
            body['temperature'] = hundredths[:, 0]
    return body


def _pack_states(states: npt.NDArray[np.int64]) -> Bytes:
    """Two bits a chip, four chips a byte, the first in the lowest bits."""
    groups = -(-states.shape[1] // 4)
    four = np.zeros((len(states), groups * 4), np.uint8)
    four[:, : states.shape[1]] = states
    packed: Bytes = (four.reshape(len(states), groups, 4) << _SHIFTS).sum(axis=-1, dtype=np.uint8)
    return packed
