"""A skin of templates under heads that press it: three known ones, then a new one to be learned.

Unlike the simple signal of `presses`, a press here is what `press_templates` expect of a specimen
whose chips, gains and bands differ from the drawing: it shows recognition at work, and says
nothing of how well a real sheet is modelled.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.presses import Programme, Touches, recorded
from tactile_ros.sensors.multipole_skin.config import layout
from tactile_ros.sensors.multipole_skin.press_fit import drawn_skin
from tactile_ros.sensors.multipole_skin.signal import NOISE
from tactile_ros.types import Outline

if TYPE_CHECKING:
    from tactile_ros.presses import Truth
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Integers, Recording

NEW = Outline('bar_20x6', (1e-3 * np.array([[-10, -3], [10, -3], [10, 3], [-10, 3]], float),))
KNOWN = 3  # heads that press
BEFORE, TAUGHT, AFTER = 10, 5, 16  # presses of the scene
SHOTS = 3  # presses from which the new head is learned
CALIBRATING = 12  # presses of one head
SPAN = 18e-3  # m, of places from the middle
DEPTH = (0.4e-3, 0.8e-3)
RETURNS = 5e-5, 0.01  # m and rad, by which the new head comes back
SPECIMEN = 8  # seed of the one skin that all scenes press
MISPLACED, UNLIKE, UNEVEN = 1e-4, 0.02, 0.05  # m; gain of chips, strength of bands


class Specimen:
    """One skin, and what heads do to it.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Drawing of the skin and of the known heads.
    labels : ndarray of int
        Heads that press: of the known ones, and `NEW` after them.
    """

    def __init__(self, config: MultipoleSkinConfig, labels: Integers) -> None:
        rng = np.random.default_rng(SPECIMEN)
        drawn = drawn_skin(config)
        chips, bands = len(drawn.chips), len(drawn.strengths)
        self.skin = replace(
            drawn,
            chips=drawn.chips + MISPLACED * rng.normal(size=(chips, 3)),
            responses=drawn.responses * (1 + UNLIKE * rng.normal(size=(chips, 3, 1))),
            strengths=drawn.strengths * (1 + UNEVEN * rng.normal(size=bands)),
        )
        self.config = config
        heads = (*config.objects, NEW)
        self.labels = np.unique(labels).tolist()
        self.bank = self.skin.bank(tuple(heads[label] for label in self.labels))
        self.still = self.skin.rest()

    def stiffness(self, label: int) -> float:
        """Force over depth of a head (N/m)."""
        return float(np.abs(self.bank.heads[self.labels.index(label)].loads.sum()))

    def change(self, label: int, pose: Array, depth: Array) -> Array:
        """Change of readings (s, t, 3) (T) by a head at a pose (x, y, turn) and depths (s,)."""
        parts = self.bank.at(np.array([self.labels.index(label)]), pose[None])[0, 0]
        powers = np.power(depth[:, None], np.arange(1, 4))
        return np.asarray((powers @ parts).reshape(len(depth), *self.still.shape))

    def play(
        self, labels: Integers, poses: Array, depths: Array, noise: float, seed: int
    ) -> Recording:
        """Presses (n) at poses (n, 3) and depths (n,), each with rest before and after."""
        stiff = np.array([self.stiffness(label) for label in labels.tolist()])
        place = np.column_stack([poses[:, :2], np.full(len(labels), self.skin.body)])
        load = (stiff * depths)[:, None] * np.array([0.0, 0.0, 1.0])

        def reading(touches: Touches) -> Array:
            values = np.repeat(self.still[None], len(touches.press), axis=0)
            for press in np.unique(touches.press[touches.press >= 0]):
                rows = touches.press == press
                depth = depths[press] * touches.share[rows]
                values[rows] += self.change(int(labels[press]), poses[press], depth)
            return values

        def truth(touches: Touches) -> Truth:
            touched = touches.press >= 0
            return {
                'position': touches.position,
                'force': touches.force,
                'label': np.where(touched, labels[touches.press], -1),
                'yaw': np.where(touched, poses[touches.press, 2], np.nan),
            }

        programme = Programme(place, load)
        return recorded(layout(self.config), programme, reading, truth, noise, seed)


def _anywhere(rng: np.random.Generator, count: int) -> Array:
    """Poses (n, 3) at random."""
    return np.column_stack([rng.uniform(-SPAN, SPAN, (count, 2)), rng.uniform(-3, 3, count)])


def one_head(config: MultipoleSkinConfig, seed: int = 0) -> Recording:
    """Presses of the first head alone, by which the skin is calibrated; truth is known."""
    rng = np.random.default_rng([1, seed])
    poses, depths = _anywhere(rng, CALIBRATING), rng.uniform(*DEPTH, CALIBRATING)
    labels = np.zeros(CALIBRATING, np.int64)
    return Specimen(config, labels).play(labels, poses, depths, NOISE, seed)


def new_head(config: MultipoleSkinConfig, seed: int = 0, noise: float | None = None) -> Recording:
    """Three heads anywhere; then a new one again and again at one place; then all four.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the sensor; of its `objects` three press.
    seed : int
        Of presses and noise.
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        With truth; the label of the new head follows those of `objects`.
    """
    rng = np.random.default_rng([2, seed])
    heads, new = len(config.objects), len(config.objects)
    known = rng.permutation(heads)[:KNOWN]
    mixed = np.append(known, new)[rng.permutation(np.arange(AFTER) % (KNOWN + 1))]
    labels = np.concatenate([rng.choice(known, BEFORE), np.full(TAUGHT, new), mixed])
    poses = _anywhere(rng, len(labels))
    again = labels == new
    apart = np.array([RETURNS[0], RETURNS[0], RETURNS[1]])
    poses[again] = poses[BEFORE] + apart * rng.normal(size=(int(again.sum()), 3))
    depths = rng.uniform(*DEPTH, len(labels))
    sigma = NOISE if noise is None else noise
    return Specimen(config, labels).play(labels, poses, depths, sigma, seed)
