"""What a link does to frames, and how much of it the board's format cannot show.

The format has no checksum: a flipped mantissa bit leaves length, CR LF and plausibility whole.
`unseen` measures the share of damaged frames that are delivered nevertheless.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.framing import FrameDecoder
from tactile_ros.devices.packets import encode, frame_bytes
from tactile_ros.types import Array

Damage = Literal['dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted']

DAMAGES: tuple[Damage, ...] = (
    'dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted',
)  # fmt: skip
LONGEST_RUN = 16
HARMLESS_MICROTESLA = 1.0


def damage(frame: bytes, kind: Damage, rng: np.random.Generator) -> bytes:
    """Damage the bytes of one frame.

    Parameters
    ----------
    frame : bytes
        At least two bytes.
    kind : Damage
        dropped: 1 to 4 bytes in a row; doubled: one byte; flipped: one bit; garbage: 1 to 16 bytes
        overwritten; inserted: 1 to 16 foreign bytes; truncated: the tail from anywhere on;
        shifted: one byte lost and another doubled, the length kept.
    rng : Generator
        Where, how many, and what.

    Returns
    -------
    bytes
        The damaged frame.
    """
    here, there = (int(place) for place in np.sort(rng.integers(len(frame), size=2)))
    run = rng.bytes(int(rng.integers(1, LONGEST_RUN + 1)))
    hurt: dict[Damage, bytes] = {
        'dropped': frame[:here] + frame[here + 1 + run[0] % 4 :],
        'doubled': frame[: here + 1] + frame[here:],
        'flipped': frame[:here] + bytes([frame[here] ^ 1 << run[0] % 8]) + frame[here + 1 :],
        'garbage': (frame[:here] + run + frame[here + len(run) :])[: len(frame)],
        'inserted': frame[:here] + run + frame[here:],
        'truncated': frame[:here],
        'shifted': frame[:here] + frame[here + 1 : there + 1] + frame[there:],
    }
    return hurt[kind]


@dataclass(frozen=True)
class Unseen:
    """Outcome of damage of one kind.

    Attributes
    ----------
    kind : str
        Kind of damage.
    trials : int
        Damaged frames, each between good ones.
    passed : float
        Share of the damaged frames that were delivered with wrong numbers.
    misled : float
        Share of them whose numbers are wrong by more than 1 uT (1 degree Celsius) somewhere.
    good_lost : int
        Most good frames lost by one damage.
    """

    kind: str
    trials: int
    passed: float
    misled: float
    good_lost: int


def unseen(
    values: Array,
    temperature_c: npt.ArrayLike,
    kind: Damage,
    seed: int,
    trials: int = 1000,
    quantum: npt.ArrayLike | None = None,
) -> Unseen:
    """Damage one frame of a locked stream again and again, and see what is delivered.

    Parameters
    ----------
    values : ndarray, shape (s, t, 3)
        Readings to draw rows from (T).
    temperature_c : array_like, broadcast to (s, t)
        Chip temperatures (degrees Celsius).
    kind : Damage
        Kind of damage.
    seed : int
        Of the rows, the places and the bytes.
    trials : int
        Frames to damage.
    quantum : array_like, shape (3,), or None
        As the decoder is told.

    Returns
    -------
    Unseen
        The shares.
    """
    rng = np.random.default_rng(seed)
    size = frame_bytes(values.shape[1])
    frames = _cut(encode(values, np.broadcast_to(temperature_c, values.shape[:2])), size)
    wrong, worst, lost = 0, 0, 0
    for _ in range(trials):
        sent = [frames[i] for i in rng.integers(len(frames), size=7)]
        stream = b''.join([*sent[:3], damage(sent[3], kind, rng), *sent[4:]])
        decoded = FrameDecoder(values.shape[1], quantum).feed(stream)
        got = _cut(encode(decoded.values, decoded.temperature_c), size)
        false = [frame for frame in got if frame not in sent]
        lost = max(lost, sum(frame not in got for frame in sent[:3] + sent[4:]))
        wrong += bool(false)
        worst += any(_error(frame, sent[3]) > HARMLESS_MICROTESLA for frame in false)
    return Unseen(kind, trials, wrong / trials, worst / trials, lost)


def _cut(stream: bytes, size: int) -> list[bytes]:
    """Whole frames, one by one."""
    return [stream[i : i + size] for i in range(0, len(stream), size)]


def _error(frame: bytes, truth: bytes) -> float:
    """Largest difference of two frames' fields (uT, degrees Celsius)."""
    fields = np.frombuffer(frame[:-2], '<f4').astype(np.float64)
    return float(np.abs(fields - np.frombuffer(truth[:-2], '<f4')).max())
