# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fingertip skins of scenes: gradiometers and magnet pads, and presses that calibrate them.

Signals are those of the sensors' own twins: the disc on springs, the pad's nominal body. Each
press of a calibration goes through the same model, with places, loads and noise of its own seed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.connections import SerialConnection
from tactile_ros.devices.serial_board import FramedBoard
from tactile_ros.devices.simulated_serial import FramedTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.enrolment import Programme, Touches, growing_loads, recorded, thinned
from tactile_ros.physics.magnetics import in_chip_axes
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, load_sensor
from tactile_ros.sensors.gradiometer import twin as disc
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.gradiometer.config import layout as disc_layout
from tactile_ros.sensors.magnet_pad import twin as pad
from tactile_ros.sensors.magnet_pad.body_model import NOISE
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.config import layout as pad_layout
from tactile_ros.types import Array, Closing, ContactState, Frame, Recording, SensorConfig

TARE_FRAMES = 50  # frames of a tare
AVERAGED = 25  # frames of a contact that lasts
RATE_HZ = 100.0
PRESSED = 0.95  # of full scale, by a calibration
DISC_PRESSES, PAD_PRESSES = 60, 800
LARGEST = 8.0  # N, on a pad
AROUND, LEAN = 0.9, 0.45  # rad from the top; tangential over normal force
RESTING = 60  # rows of rest before a pad's presses


@dataclass(frozen=True)
class Skin:
    """A kind of sensor in a scene, and how it is read."""

    spec: SensorSpec
    config: SensorConfig
    connection: SerialConnection  # of its board
    # readings (t, c) in the unit of the sensor for a contact's place (3,) (m) and force (3,)
    # (N) in the sensor frame, and the field of what is around, (t, 3) (T) in the same axes
    signal: Callable[[Array, Array, Array], Array]


class Fingertip(Closing):
    """One fingertip's board, its driver and its pipeline.

    Bytes go from the board's twin to the driver without a port in between, which would cost more
    than all the rest of a scene.

    Parameters
    ----------
    skin : Skin
        Material of the pad.
    pipeline : Pipeline
        Calibrated; a copy is used, so that fingertips share a calibration and no state.
    seed : int
        Of the noise.
    steady : Pipeline or None
        Calibrated on means of 25 frames, for contacts that last.

    Attributes
    ----------
    frame : Frame
        That was read last.
    """

    frame: Frame

    def __init__(
        self, skin: Skin, pipeline: Pipeline, seed: int, steady: Pipeline | None = None
    ) -> None:
        self.skin = skin
        self.pipeline, self.steady = deepcopy(pipeline), deepcopy(steady)
        self._last: deque[Frame] = deque(maxlen=AVERAGED)
        self._values = np.zeros(skin.spec.layout(skin.config).shape)
        clock = VirtualClock(1_000_000_000)
        twin = skin.spec.simulate(
            skin.config, skin.connection, lambda _: self._values, seed, clock
        )
        self._twin = cast('FramedTwin', twin)
        self._board = cast('FramedBoard', self._twin.device(clock.now_ns))

    def close(self) -> None:
        """Close the board and its twin."""
        self._board.close()
        self._twin.close()

    def _read(self, place: Array, force: Array, field: Array | None = None) -> Frame:
        """The next frame."""
        around = np.zeros_like(self.skin.config.positions) if field is None else field
        self._values = self.skin.signal(place, force, around)
        self._board.feed(self._twin.period())
        self.frame = self._board.read(0.0)
        self._last.append(self.frame)
        return self.frame

    def tare(self) -> None:
        """Take the baseline with nothing on the pad and no field around."""
        frames = [self._read(np.zeros(3), np.zeros(3)) for _ in range(TARE_FRAMES)]
        for pipeline in filter(None, (self.pipeline, self.steady)):
            pipeline.reset()
            pipeline.tare(frames)

    def estimate(self, place: Array, force: Array, field: Array | None = None) -> ContactState:
        """Estimate of the pipeline for the frame of a contact.

        Parameters
        ----------
        place, force : ndarray, shape (3,)
            In the sensor frame (m, N), force as the skin exerts it on the object; a force of 0 is
            no contact.
        field : ndarray, shape (t, 3), or None
            Of what is around, at the elements (T); None: none.
        """
        return self.pipeline.process(self._read(place, force, field))

    def lasting(self) -> ContactState | None:
        """Estimate from the mean of the last 25 frames; None without a pipeline for that."""
        if self.steady is None:
            return None
        mean = np.mean([frame.values for frame in self._last], axis=0)
        return self.steady.process(replace(self.frame, values=mean))


def gradiometer_skin(config: GradiometerConfig) -> Skin:
    """A gradiometer [3], whose disc a fifth of full scale shears as far as [3] calibrated."""

    def signal(place: Array, force: Array, field: Array) -> Array:
        at = _touch(place, force)
        around = in_chip_axes(field, config.rotations)[..., disc.AXES]
        return np.asarray(disc.reading(config, at)[0] + around)

    spec = load_sensor('gradiometer')
    return Skin(spec, config, disc.GradiometerConnection(), signal)


def gradiometer_presses(config: GradiometerConfig, seed: int) -> Recording:
    """Presses to full scale with shear in all directions, up to the fifth of it that is sensed."""
    rng = np.random.default_rng(seed)
    count, most = DISC_PRESSES, PRESSED * config.full_scale
    load = growing_loads(count, 0.02 * most, most, rng)[rng.permutation(count)]
    angle = rng.uniform(0, 2 * np.pi, count)
    shear = disc.SHEAR_SHARE * most * np.sqrt(rng.uniform(0, 1, count))
    force = np.column_stack([shear * np.cos(angle), shear * np.sin(angle), load])
    return recorded(
        disc_layout(config),
        Programme(np.zeros((count, 3)), force),
        lambda touches: disc.reading(config, touches),
        lambda touches: disc.truth(config, touches),
        disc.NOISE,
        seed,
    )


def magnet_pad_skin(config: MagnetPadConfig) -> Skin:
    """A magnet pad [2] behind a microcontroller."""

    def signal(place: Array, force: Array, field: Array) -> Array:
        seen = pad.reading(config, _touch(place, force))[0]
        return np.asarray(seen + in_chip_axes(field, config.rotations))

    spec = load_sensor('magnet_pad')
    return Skin(spec, config, pad.MagnetPadConnection(transport='serial'), signal)


def magnet_pad_presses(config: MagnetPadConfig, seed: int, frames: int) -> Recording:
    """The mean of some frames of each press, where grasps touch, leaning as forces there do."""
    rng, count = np.random.default_rng(seed), PAD_PRESSES
    x = 0.5 * config.length * rng.uniform(-1, 1, count)
    angle = np.pi / 2 + AROUND * rng.uniform(-1, 1, count)
    normal = np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)])
    across = np.cross(normal, rng.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lean = LEAN * rng.uniform(0, 1, (count, 1))
    load = LARGEST * rng.uniform(0.03, 1.0, (count, 1))
    place = np.column_stack([x, config.radius * normal[:, 1:]])
    at = Touches(np.arange(count), place, load * (normal + lean * across), np.ones(count))
    rest = pad.reading(config, _touch(np.zeros(3), np.zeros(3)))
    values = np.concatenate([np.repeat(rest, RESTING, axis=0), pad.reading(config, at)])
    truth = {
        **{name: _after_rest(column) for name, column in pad.truth(config, at).items()},
        'in_contact': _after_rest(np.ones(count, np.int8)),
    }
    return Recording.from_arrays(
        pad_layout(config),
        values + NOISE / np.sqrt(frames) * rng.normal(size=values.shape),
        tare=np.arange(len(values)) < RESTING,
        truth=truth,
    )


def _after_rest(column: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """A column of truth after rows of rest: force and contact 0, what is a place unknown."""
    blank = column[:1] * 0 if column.dtype != np.int64 else np.full_like(column[:1], -1)
    return np.concatenate([np.repeat(blank, RESTING, axis=0), column])


def calibrated(skin: Skin, presses: Recording, estimator: str) -> Pipeline:
    """Pipeline of a skin, fitted to presses; some frames a second are enough."""
    pipeline = skin.spec.pipeline(skin.config, estimator)
    return pipeline.fit(presses if presses.stamp_ns is None else thinned(presses))


def _touch(place: Array, force: Array) -> Touches:
    """One instant, as the twins' signals take it."""
    pressed = bool(np.any(force))
    return Touches(
        np.array([0 if pressed else -1]),
        place[None] if pressed else np.full((1, 3), np.nan),
        force[None],
        np.array([float(pressed)]),
    )
