"""A balloon in the hand while a magnet comes near, as in figure 10 of [3].

A soft hand holds a balloon at a force that one gradiometer, on the thumb, tells. A magnet comes
from 100 to 14 mm; its field is 3 mT at 50 mm. The same sensor is read in two ways: by its
pipeline, and as if it had one pixel of one axis under its magnet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import SCALE, dipole_field
from tactile_ros.simulation.hand_world import HandWorld
from tactile_ros.simulation.objects import balloon
from tactile_ros.simulation.soft_hand import REACH

if TYPE_CHECKING:
    from tactile_ros.simulation.fingertip import Fingertip
    from tactile_ros.simulation.hand_world import Decided, Rig
    from tactile_ros.types import Array, Bools, ContactState, Frame, Recording

FAR, NEAR = 0.1, 0.014  # m
FIELD, AT = 3e-3, 0.05  # T at m
COMES, CLOSES = 20.0, 8.0  # s
FORCE = 1.0  # N
SOFT, LOSSES = 100.0, 3.0  # of each side of a balloon (N/m, N s/m)
FROM = np.array([0.8, 0.0, -0.6])  # of the magnet, in sensor axes: above the finger and behind it
MOMENT = FIELD * AT**3 / (2 * SCALE)  # A m2, along its way
DEGREES = (1, 2, 3)
RELEASED, CRUSHED = 0.1, 3.0  # of the force that was asked for
MAGNET = """
    <body name="magnet" mocap="true">
      <geom type="cylinder" size="0.006 0.006" rgba="0.5 0.5 0.55 1" contype="0" conaffinity="0"/>
    </body>"""


class SinglePixel:
    """Force from Bz of one pixel under the disc's middle, by a polynomial: [3] compares with such.

    Parameters
    ----------
    presses : Recording
        Of a calibration, which begins with its tare.

    Notes
    -----
    The sensor has no pixel there; the mean of its four is what one there would read, and the shear
    of the disc cancels in it to first order.
    """

    def __init__(self, presses: Recording) -> None:
        told = presses.values[:, :, 1].mean(axis=1)
        change = told - told[presses.tare].mean()
        self._scale = float(np.abs(change).max())
        force = np.asarray(presses.truth['force'], np.float64)[:, 2]
        found = np.linalg.lstsq(self._rows(change), force, rcond=None)[0]
        self._weights = np.asarray(found, np.float64)
        self._rest = np.nan

    def _rows(self, change: Array) -> Array:
        return np.stack([(change / self._scale) ** n for n in DEGREES], axis=-1)

    def tare(self, frame: Frame) -> None:
        """Take a resting frame."""
        self._rest = float(frame.values[:, 1].mean())

    def __call__(self, frame: Frame) -> Array:
        """Force (3,) (N) along z; across it nothing is told."""
        change = np.asarray(frame.values[:, 1].mean() - self._rest)
        return np.array([0.0, 0.0, float(self._rows(change) @ self._weights)])


@dataclass(frozen=True)
class Held:
    """A balloon and a magnet.

    Attributes
    ----------
    distance : ndarray, shape (s,)
        Of the magnet from the sensor (m); decreasing.
    force, told : ndarray, shape (s,)
        True force of the thumb, and what the reading says (N).
    valid : ndarray of bool, shape (s,)
        Whether the reading may be used for control.
    seconds : float
        Simulated (s).
    """

    distance: Array
    force: Array
    told: Array
    valid: Bools
    seconds: float

    def error_until(self, distance: float) -> float:
        """Largest error of the true force (N) while the magnet is at least so far (m)."""
        far = self.distance >= distance
        return float(np.abs(self.force[far] - FORCE).max())

    @property
    def invalid_from(self) -> float:
        """Distance (m) below which no reading is valid any more; NaN: there is none."""
        last = int(np.flatnonzero(self.valid)[-1]) if self.valid.any() else -1
        return float(self.distance[last + 1]) if last + 1 < len(self.valid) else np.nan

    @property
    def fate(self) -> str:
        """What came of the balloon."""
        for i, force in enumerate(self.force):
            if force < RELEASED * FORCE:
                return f'released at {1e3 * self.distance[i]:.0f} mm'
            if force > CRUSHED * FORCE:
                return f'crushed at {1e3 * self.distance[i]:.0f} mm'
        return 'held'


class BalloonScene:
    """The hand, the balloon and the magnet.

    Parameters
    ----------
    rig : Rig
        The soft hand, with the thumb's gradiometer alone.
    pixel : SinglePixel or None
        Read so; None: by the pipeline.
    """

    def __init__(self, rig: Rig, pixel: SinglePixel | None = None) -> None:
        thing = balloon(SOFT, LOSSES, (0.0, REACH, 0.0)) + MAGNET
        self.world = HandWorld(rig, thing, field=self._field)
        (self._finger,) = rig.tips
        self._begins = np.inf
        self._rows: list[tuple[float, float, float, bool]] = []
        self._pixel = pixel
        if pixel is not None:
            pixel.tare(rig.tips[self._finger].frame)
            self.world.read_force = self._one_pixel

    def _one_pixel(self, _: str, tip: Fingertip, __: ContactState) -> tuple[Array, bool]:
        assert self._pixel is not None
        return self._pixel(tip.frame), True

    @property
    def distance(self) -> float:
        """Of the magnet from the sensor (m)."""
        share = min(max((self.world.time - self._begins) / COMES, 0.0), 1.0)
        return FAR + share * (NEAR - FAR)

    def _field(self, _: float, elements: Array, axes: Array) -> Array:
        """Field (t, 3) (T) of the magnet in sensor axes; none before it comes."""
        centre = elements.mean(axis=0)
        place = centre + axes @ (self.distance * FROM)
        self.world.data.mocap_pos[0] = place
        if not np.isfinite(self._begins):
            return np.zeros_like(elements)
        moment = axes @ (MOMENT * FROM)
        return np.asarray(dipole_field(elements, place[None], moment[None]) @ axes)

    def hold(self) -> Held:
        """Close on the balloon, and let the magnet come."""
        world, stage = self.world, self.world.stage
        stage.enable()
        world.run(0.08)
        stage.grasp(FORCE, [], 0.0, False)
        world.run(CLOSES)
        self._begins = world.time
        world.run(COMES, self._watch)
        rows = np.array(self._rows, np.float64)
        return Held(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] > 0, world.time)

    def _watch(self, world: HandWorld, decided: Decided) -> None:
        """Keep a row."""
        felt = world.felt[self._finger]
        told, valid = world.read_force(self._finger, world.tips[self._finger], felt.state)
        self._rows.append((self.distance, float(felt.force[2]), float(told[2]), valid))
