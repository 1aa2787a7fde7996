# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What the boards of `tactile bench latency` play: a rest, then a press that stays, as bytes."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.framed_protocol import encode as framed
from tactile_ros.devices.framed_protocol import gradiometer
from tactile_ros.devices.reskin_protocol import encode as packet
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tactile_ros.nodes.graph import Value
    from tactile_ros.types import Array, Recording

FAST_HZ, SLOW_HZ = 1000.0, 100.0
FINGERS = ('index', 'middle', 'ring', 'thumb')
CHIPS = 20
PITCH = 5e-3  # m
FORCE = 1.5  # N, of the press that the boards play
KEPT = 512  # noisy frames of it that are played again and again
REST = 200


@dataclass(frozen=True)
class Scene:
    """What is played into which nodes, at a rate of frames and commands alike."""

    sensor: str
    rate_hz: float
    fingers: tuple[str, ...]  # with a sensor of their own; the others of the hand hear the first
    encode: Callable[[int, int, int], bytes]  # of board, frame, time (us)
    values: dict[str, Value]  # parameters of the sensors

    @property
    def heard(self) -> dict[str, str]:
        """Topics of fingers without a sensor."""
        others = [name for name in FINGERS if name not in self.fingers]
        return {f'/{name}/contacts': f'/{self.fingers[0]}/contacts' for name in others}


def gradiometer_scene(folder: Path, estimator: str | None = None) -> Scene:
    """One gradiometer at 1 kHz that four fingers hear: a rest, then a press that stays."""
    spec = load_sensor('gradiometer')
    config = dataclasses.replace(spec.config(), rate_hz=FAST_HZ)
    values, warmth = _calibrated(folder, 'gradiometer', config, estimator)
    scale = spec.connection().tesla_per_count
    counts = np.rint(values / scale).astype(np.int64)
    payload = gradiometer()

    def encode(_: int, frame: int, time_us: int) -> bytes:
        row = _row(frame)
        return framed(payload, counts[row], frame, time_us, warmth[row])

    return Scene(
        'gradiometer', FAST_HZ, FINGERS[:1], encode, {'rate_hz': FAST_HZ, 'native_usb': True}
    )


def skin_scene(folder: Path) -> Scene:
    """Four skins of 20 chips at 100 Hz, one for each finger."""
    spec = load_sensor('reskin_board')
    rows, columns = np.divmod(np.arange(CHIPS), 5)
    places = PITCH * np.stack([columns - 2.0, rows - 1.5, np.zeros(CHIPS)], axis=1)
    config = dataclasses.replace(spec.config(), positions=places, rate_hz=SLOW_HZ)
    values, _ = _calibrated(folder, 'reskin_board', config)
    frames = [packet(row) for row in values]

    def encode(_: int, frame: int, __: int) -> bytes:
        return frames[_row(frame)]

    parameters: dict[str, Value] = {'rate_hz': SLOW_HZ, 'positions': places.ravel().tolist()}
    return Scene('reskin_board', SLOW_HZ, FINGERS, encode, parameters)


def _row(frame: int) -> int:
    """Row that is played: rest, then the press again and again."""
    return frame if frame < REST else REST + (frame - REST) % KEPT


def _calibrated(
    folder: Path, key: str, config: object, estimator: str | None = None
) -> tuple[Array, Array]:
    """Calibrate on presses of another seed; what to play, as of `_held`."""
    spec = load_sensor(key)
    learnt = spec.presses(config, 1)
    some = slice(None, None, -(-len(learnt) // 3000))
    pipeline = spec.pipeline(config, estimator=estimator).fit(learnt.select(some))
    (folder / key).mkdir(parents=True, exist_ok=True)
    for finger in FINGERS:
        pipeline.save(folder / key / f'{finger}.npz')
    return _held(spec.presses(config, 0), pipeline.rest_.noise)


def _held(presses: Recording, noise: Array) -> tuple[Array, Array]:
    """A rest, then a straight press that stays: rows (s, t, c), temperatures (s,) of the chip."""
    force = np.nan_to_num(presses.truth['force'])
    rests = np.flatnonzero(force[:, 2] == 0)
    off = np.linalg.norm(force - [0.0, 0.0, FORCE], axis=1)
    rows = np.append(np.resize(rests, REST), np.full(KEPT, off.argmin()))
    values = presses.values[rows].copy()
    values[REST:] += noise * np.random.default_rng(0).normal(size=values[REST:].shape)
    chips = presses.temperature_c
    warmth = np.full(len(rows), np.nan) if chips is None else chips[rows].mean(axis=1)
    return values, warmth
