# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Share of damaged frames that ReSkin's format, without a checksum, cannot show."""

from dataclasses import dataclass

import numpy as np

from tactile_ros.devices.reskin_protocol import ReskinDecoder, encode, frame_bytes
from tactile_ros.devices.simulated_serial import damage
from tactile_ros.types import Array

HARMLESS_MICROTESLA = 1.0


@dataclass(frozen=True)
class HiddenDamage:
    """Outcome of damage of one kind, of frames that each stand between good ones.

    Attributes
    ----------
    passed : float
        Share of the damaged frames that were delivered with wrong numbers.
    misled : float
        Share of them whose numbers are wrong by more than 1 uT (1 degree Celsius) somewhere.
    good_lost : int
        Most good frames lost by one damage.
    """

    kind: str
    passed: float
    misled: float
    good_lost: int


def hidden_damage(values: Array, kind: str, seed: int, trials: int) -> HiddenDamage:
    """Damage one frame of a locked stream again and again, rows of `values` (s, t, 3) (T)."""
    rng = np.random.default_rng(seed)
    size = frame_bytes(values.shape[1])
    frames = _cut(encode(values, np.full(values.shape[:2], 25.0)), size)
    wrong, worst, lost = 0, 0, 0
    for _ in range(trials):
        sent = [frames[i] for i in rng.integers(len(frames), size=7)]
        stream = b''.join([*sent[:3], damage(sent[3], kind, rng), *sent[4:]])
        decoded = ReskinDecoder(values.shape[1]).feed(stream)
        got = _cut(encode(decoded.values, decoded.temperature_c), size)
        false = [frame for frame in got if frame not in sent]
        lost = max(lost, sum(frame not in got for frame in sent[:3] + sent[4:]))
        wrong += bool(false)
        worst += any(_error(frame, sent[3]) > HARMLESS_MICROTESLA for frame in false)
    return HiddenDamage(kind, wrong / trials, worst / trials, lost)


def _cut(stream: bytes, size: int) -> list[bytes]:
    return [stream[i : i + size] for i in range(0, len(stream), size)]


def _error(frame: bytes, truth: bytes) -> float:
    """Largest difference of two frames' fields (uT, degrees Celsius)."""
    fields = np.frombuffer(frame[:-2], '<f4').astype(np.float64)
    return float(np.abs(fields - np.frombuffer(truth[:-2], '<f4')).max())
