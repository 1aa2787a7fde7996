"""Heads that press a specimen of the skin one after the other: what its twin plays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.sensors.multipole_skin.config import HEADS, layout
from tactile_ros.sensors.multipole_skin.specimen import POWERS, Specimen

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.enrolment import Truth
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Integers, Outline, Recording

NOISE = 4e-6  # T
PLAY = 0.25  # of a place about the middle, in sheet sizes
DEPTH = (0.3e-3, 0.9e-3)  # m
PRESSES = 24
SPECIMEN = 8  # the one skin that all scenes press


@dataclass(frozen=True)
class Pressing:
    """Presses (n) of flat heads.

    Attributes
    ----------
    heads : tuple of Outline
        That press.
    labels : ndarray, shape (n,)
        Indices into them.
    poses : ndarray, shape (n, 3)
        Places (m) and turns (rad).
    depths : ndarray, shape (n,)
        At full load (m).
    """

    heads: tuple[Outline, ...]
    labels: Integers
    poses: Array
    depths: Array


def played(specimen: Specimen, pressing: Pressing, noise: float, seed: int) -> Recording:
    """Presses one after the other, with rest between them.

    Parameters
    ----------
    specimen : Specimen
        That is pressed.
    pressing : Pressing
        By what.
    noise : float
        Of a channel (T).
    seed : int
        Of the noise.

    Returns
    -------
    Recording
        One stream that begins with a tare, with truth: label, yaw, position, force.
    """
    labels, poses, depths = pressing.labels, pressing.poses, pressing.depths
    heads = [pressing.heads[label] for label in labels.tolist()]
    stiffness = np.array([specimen.stiffness(head) for head in heads])
    terms = [specimen.terms(*one, float(depths.max())) for one in zip(heads, poses, strict=True)]
    parts = depths[:, None, None, None] ** POWERS[:, None, None] * np.array(terms)
    place = np.column_stack([poses[:, :2], np.full(len(depths), specimen.top)])
    rest = specimen.rest()

    def reading(touches: Touches) -> Array:
        shares = touches.share[:, None] ** POWERS
        return np.asarray(rest + np.einsum('sp,sptc->stc', shares, parts[touches.press]))

    def truth(touches: Touches) -> Truth:
        touched = touches.press >= 0
        return {
            'position': touches.position,
            'force': touches.force,
            'label': np.where(touched, labels[touches.press], -1),
            'yaw': np.where(touched, poses[touches.press, 2], np.nan),
        }

    programme = Programme(place, (stiffness * depths)[:, None] * np.array([0.0, 0.0, 1.0]))
    return recorded(layout(specimen.config), programme, reading, truth, noise, seed)


def presses(
    config: MultipoleSkinConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: label, yaw, position and force.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the sensor; its `objects` press, or the heads of [1] where it has none.
    seed : int
        Of heads, places, turns, depths and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        One stream that begins with a tare; always of the same specimen.
    """
    rng = np.random.default_rng(seed)
    heads = config.objects or HEADS
    place = PLAY * config.sheet_size * rng.uniform(-1, 1, (count, 2))
    poses = np.column_stack([place, rng.uniform(-np.pi, np.pi, count)])
    depths = growing_loads(count, *DEPTH, rng)[rng.permutation(count)]
    pressing = Pressing(heads, rng.integers(len(heads), size=count), poses, depths)
    specimen = Specimen(config, seed=SPECIMEN)
    return played(specimen, pressing, NOISE if noise is None else noise, seed)


def signal(config: MultipoleSkinConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
