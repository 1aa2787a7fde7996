# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Twin of the multipole skin: its connection, and scenes of heads that press one specimen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.connections import ChipConnection
from tactile_ros.enrolment import Programme, Touches, growing_loads, recorded
from tactile_ros.sensors.multipole_skin.config import HEADS, box, layout
from tactile_ros.sensors.multipole_skin.specimen import POWERS, Specimen
from tactile_ros.types.config_fields import whole, whole_numbers

if TYPE_CHECKING:
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
    """Presses (n) of flat heads."""

    heads: tuple[Outline, ...]  # that press
    labels: Integers  # (n,) indices into them
    poses: Array  # (n, 3) places (m) and turns (rad)
    depths: Array  # (n,) at full load (m)


def played(specimen: Specimen, pressing: Pressing, noise: float, seed: int) -> Recording:
    """Presses of a specimen with rest between them: one stream that begins with a tare.

    Truth is label, yaw, position and force; `noise` is of a channel (T), the seed of the noise.
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

    One stream that begins with a tare. `seed` is of all that is drawn, `noise` of a channel
    (T); None: that of the chips. The `objects` of the config press, or the heads of [1] where it
    has none; it is always the same specimen.
    """
    rng = np.random.default_rng(seed)
    heads = config.objects or HEADS
    place = PLAY * config.sheet_size * rng.uniform(-1, 1, (count, 2))
    poses = np.column_stack([place, rng.uniform(-np.pi, np.pi, count)])
    depths = growing_loads(count, *DEPTH, rng)[rng.permutation(count)]
    pressing = Pressing(heads, rng.integers(len(heads), size=count), poses, depths)
    specimen = Specimen(config, seed=SPECIMEN)
    return played(specimen, pressing, NOISE if noise is None else noise, seed)


CLUSTERS, CHIPS = 5, 4


@dataclass(frozen=True)
class MultipoleSkinConnection(ChipConnection):
    """Five clusters of four chips behind one switch, or a microcontroller that reads them.

    The default addresses each cluster by a channel of a switch at 0x70, and its four chips by
    their pins, 0x0C to 0x0F.
    """

    addresses: tuple[int, ...] = whole_numbers(
        (0x0C, 0x0D, 0x0E, 0x0F) * CLUSTERS, 'address of each chip', 8, 0x77
    )
    mux_addresses: tuple[int, ...] = whole_numbers(
        (0x70,), 'switch of each chip, or of all; 0: none', 0, 0x77
    )
    mux_channels: tuple[int, ...] = whole_numbers(
        tuple(i // CHIPS for i in range(CLUSTERS * CHIPS)),
        'channel of the switch for each chip, or for all', 0, 7,
    )  # fmt: skip
    gain: int = whole(5, 'GAIN_SEL; 0 has the largest range, 7 the finest step', 0, 7)


NEW = box('bar_20x6', 20e-3, 6e-3)
KNOWN = 3  # heads that press
BEFORE, TAUGHT, AFTER = 6, 5, 16  # presses of the scene
SHOTS = 3  # presses from which the new head is learned
CALIBRATING = 12  # presses of one head
SPAN = 18e-3  # m, of places from the middle
SCENE_DEPTH = (0.4e-3, 0.8e-3)
RETURNS = 5e-5, 0.01  # m and rad, by which the new head comes back


def _anywhere(rng: np.random.Generator, count: int) -> Array:
    """Poses (n, 3) at random."""
    return np.column_stack([rng.uniform(-SPAN, SPAN, (count, 2)), rng.uniform(-3, 3, count)])


def one_head(config: MultipoleSkinConfig, seed: int = 0) -> Recording:
    """Presses of the first head alone, by which the skin is calibrated; truth is known."""
    rng = np.random.default_rng([1, seed])
    poses, depths = _anywhere(rng, CALIBRATING), rng.uniform(*SCENE_DEPTH, CALIBRATING)
    labels = np.zeros(CALIBRATING, np.int64)
    pressing = Pressing(config.objects, labels, poses, depths)
    return played(Specimen(config, seed=SPECIMEN), pressing, NOISE, seed)


def new_head(config: MultipoleSkinConfig, seed: int = 0, noise: float | None = None) -> Recording:
    """Three heads anywhere; then a new one again and again at one place; then all four.

    The label of the new head follows those of `objects`; `noise` is of a channel (T), None: that
    of the chips.
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
    depths = rng.uniform(*SCENE_DEPTH, len(labels))
    sigma = NOISE if noise is None else noise
    pressing = Pressing((*config.objects, NEW), labels, poses, depths)
    return played(Specimen(config, seed=SPECIMEN), pressing, sigma, seed)
