"""A sensor on a pad: contact force -> sensor model -> bytes -> driver -> contact state."""

from __future__ import annotations

from collections import deque
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.types import Closing

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.simulated_serial import FramedTwin
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors.registry import SensorSpec
    from tactile_ros.types import Array, ContactState, Frame, SensorConfig

RESTING = 50  # frames of a tare
AVERAGED = 25  # frames of a contact that lasts


@dataclass(frozen=True)
class Skin:
    """How a kind of sensor is read in a scene.

    Attributes
    ----------
    spec : SensorSpec
        Of the sensor.
    config : SensorConfig
        Of this one.
    connection : object
        How its board is connected.
    signal : callable
        Readings (t, c) in the unit of the sensor for a contact's place (3,) (m) and force (3,) (N)
        in the sensor frame, and the field of what is around, (t, 3) (T) in the same axes.
    model : str
        Which model of the sensor `physics.fidelity` picked for the signal.
    """

    spec: SensorSpec
    config: SensorConfig
    connection: object
    signal: Callable[[Array, Array, Array], Array]
    model: str


class Fingertip(Closing):
    """One fingertip's board, its driver and its pipeline.

    Bytes go from the board's twin to the driver without a port in between, which would cost more
    than all the rest of a scene.

    Parameters
    ----------
    skin : Skin
        What the pad is made of.
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
        self.pipeline = deepcopy(pipeline)
        self.steady = deepcopy(steady)
        self._last: deque[Frame] = deque(maxlen=AVERAGED)
        self._values = np.zeros(skin.spec.layout(skin.config).shape)
        self._still = np.zeros_like(skin.config.positions)
        clock = VirtualClock(1_000_000_000)
        twin = skin.spec.simulate(skin.config, skin.connection, self._now, seed, clock)
        self._twin = cast('FramedTwin', twin)
        self._board = self._twin.device(clock.now_ns)

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return self._twin.layout.rate_hz

    def close(self) -> None:
        """Let the board go."""
        self._board.close()
        self._twin.close()

    def _now(self, _: float) -> Array:
        """What the board measures now."""
        return self._values

    def _read(self, place: Array, force: Array, field: Array) -> Frame:
        """The next frame."""
        self._values = self.skin.signal(place, force, field)
        self._board.feed(self._twin.period())
        self.frame = self._board.read(0.0)
        self._last.append(self.frame)
        return self.frame

    def tare(self) -> None:
        """Take the baseline with nothing on the pad and no field around."""
        none = np.zeros(3)
        frames = [self._read(none, none, self._still) for _ in range(RESTING)]
        for pipeline in (self.pipeline, self.steady):
            if pipeline is not None:
                pipeline.reset()
                pipeline.tare(frames)

    def feel(self, place: Array, force: Array, field: Array | None = None) -> ContactState:
        """What the pipeline makes of a contact.

        Parameters
        ----------
        place, force : ndarray, shape (3,)
            In the sensor frame (m, N), force as the skin exerts it on the object; a force of 0 is
            no contact.
        field : ndarray, shape (t, 3), or None
            Of what is around, at the elements (T); None: none.

        Returns
        -------
        ContactState
            Of the frame that the driver decoded.
        """
        return self.pipeline.process(
            self._read(place, force, self._still if field is None else field)
        )

    def lasting(self) -> ContactState | None:
        """What the mean of the last 25 frames tells; None without a pipeline for that."""
        if self.steady is None:
            return None
        mean = np.mean([frame.values for frame in self._last], axis=0)
        return self.steady.process(replace(self.frame, values=mean))
