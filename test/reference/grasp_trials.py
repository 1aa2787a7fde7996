# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Trials of grasps: hands, calibrated fingertips and scenes put together, each with a seed.

The controller is `nodes.grip_loop.GripLoop`, that of grip_node without ROS.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import erfc, sqrt

import numpy as np

from reference.hand_scenes import (
    FRICTION,
    BalloonScene,
    Carried,
    Grasped,
    GraspScene,
    Handling,
    Held,
    LoadScene,
    Touched,
)
from reference.hand_world import HandWorld, Rig
from tactile_ros.control import GripConfig, qb_softhand
from tactile_ros.nodes.grip_loop import GripLoop
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation import skins
from tactile_ros.simulation.hands import HandModel, allegro_hand, parallel_hand, soft_hand
from tactile_ros.types import Array, Frame, Recording

Watcher = Callable[[HandWorld], None]

SEED = 1  # of the calibrations; noise and poses have the seed of a trial
GENTLE, STRONG = 3.5, 15.0  # full scales of gradiometers (N): as built in [3], and stiffer
SOFT_FORCE = 1.5  # N, mean of a soft hand's digits
# N: what motors of a version hold with a sixth to spare
THUMB_FORCE = {'v4': 2.2, 'v4_raised': 4.0, 'v5': 1.5}
BEGIN = 2.5  # N, of grips that adapt
UNHEEDED = 5.0  # friction that is assumed where loads are not to count
SOFTEST, SOFTEST_SHARE = 1.0, 0.4  # N for a whole closure; of the stiffest
SLOWLY = 0.05  # closure per second
NOISE, PAD_NOISE = 0.01, 0.1  # N, of forces by gradiometers and by pads
DEGREES = (1, 2, 3)


def unseen(_: HandWorld) -> None:
    """Nobody watches."""


class SinglePixel:
    """Force from Bz of one pixel under the disc's middle, by a polynomial: [3] compares with such.

    The sensor has no pixel there; the mean of its four is what one there would read, and the shear
    of the disc cancels in it to first order. `presses` of a calibration begin with its tare.
    """

    def __init__(self, presses: Recording) -> None:
        read = presses.values[:, :, 1].mean(axis=1)
        change = read - read[presses.tare].mean()
        self._scale = float(np.abs(change).max())
        force = np.asarray(presses.truth['force'], np.float64)[:, 2]
        self._weights = np.linalg.lstsq(self._rows(change), force, rcond=None)[0]
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
class Calibrated:
    """A skin, and its pipelines for single frames and for the mean of 25."""

    skin: skins.Skin
    pipeline: Pipeline
    steady: Pipeline | None = None


@dataclass(frozen=True)
class Grip:
    """Grip of a load."""

    config: GripConfig  # of the law
    force: float  # at which it begins (N)
    adapt: bool  # whether slip and load raise it


class Trials:
    """Scenes with everything in them."""

    @cached_property
    def pad(self) -> Calibrated:
        """Magnet pads."""
        config = MagnetPadConfig(rate_hz=skins.RATE_HZ)
        skin = skins.magnet_pad_skin(config)
        single, steady = (
            skins.calibrated(
                skin, skins.magnet_pad_presses(config, SEED, frames), 'table_gauss_newton'
            )
            for frames in (1, skins.AVERAGED)
        )
        return Calibrated(skin, single, steady)

    @cached_property
    def strong(self) -> Calibrated:
        """Gradiometers for forces that hold half a kilogram."""
        return _gradiometer(STRONG)

    @cached_property
    def gentle(self) -> Calibrated:
        """Gradiometers as [3] built them."""
        return _gradiometer(GENTLE)

    def balloon(self, single: bool, film: Watcher = unseen) -> Held:
        """A balloon while a magnet comes: the thumb read by its pipeline, or by one pixel."""
        hand = soft_hand()
        config = soft_config(hand)
        with fingertips(self.gentle, ['thumb'], 0) as tips:
            pixel = None
            if single:
                skin_config = self.gentle.skin.config
                pixel = SinglePixel(skins.gradiometer_presses(skin_config, SEED))
                pixel.tare(tips['thumb'].frame)
            scene = BalloonScene(rig_of(hand, tips, config), pixel)
            scene.world.watchers.append(film)
            return scene.hold()

    def pads(
        self, kind: str, seed: int, film: Watcher = unseen, version: str = 'v4_raised'
    ) -> Grasped:
        """The Allegro-like hand, with motors of a version, grasps with magnet pads."""
        hand = allegro_hand(version)
        config = replace(
            fitted(GripConfig(), hand), force_noise=PAD_NOISE
        )  # small ones are unsure
        return _grasp(hand, self.pad, config, kind, seed, THUMB_FORCE[version], film)

    def forces(self, which: str, kind: str, seed: int) -> Grasped:
        """The hand `allegro` or `soft` grasps with gradiometers."""
        if which == 'allegro':
            hand = allegro_hand()
            config = fitted(GripConfig(), hand)
            return _grasp(hand, self.strong, config, kind, seed, THUMB_FORCE['v4'])
        hand = soft_hand(1.0)
        return _grasp(hand, self.gentle, soft_config(hand), kind, seed, SOFT_FORCE)

    def carry(self, handling: Handling, seed: int, grip: Grip, film: Watcher = unseen) -> Carried:
        """The parallel hand holds a load that changes."""
        hand = parallel_hand(grip.config.rate_hz)
        with fingertips(self.strong, hand.pads, seed) as tips:
            scene = LoadScene(rig_of(hand, tips, grip.config), handling)
            scene.world.watchers.append(film)
            return scene.carry(grip.force, grip.adapt)


def _gradiometer(full_scale: float) -> Calibrated:
    """Gradiometers whose elastomer is as stiff as a full scale (N) tells."""
    config = GradiometerConfig(full_scale=full_scale, rate_hz=skins.RATE_HZ)
    skin = skins.gradiometer_skin(config)
    presses = skins.gradiometer_presses(config, SEED)
    return Calibrated(skin, skins.calibrated(skin, presses, 'inversion'))


def _grasp(
    hand: HandModel, made_of: Calibrated, config: GripConfig, kind: str, seed: int, force: float,
    film: Watcher = unseen,
) -> Grasped:  # fmt: skip
    with fingertips(made_of, hand.pads, seed) as tips:
        scene = GraspScene(rig_of(hand, tips, config), kind, seed)
        scene.world.watchers.append(film)
        return scene.grasp(force)


def rig_of(hand: HandModel, tips: Mapping[str, skins.Fingertip], config: GripConfig) -> Rig:
    """A hand, its fingertips and the loop that moves it."""
    return Rig(hand, tips, GripLoop(hand.description, config, list(tips)), config.rate_hz)


@contextmanager
def fingertips(
    made_of: Calibrated, names: Sequence[str] | Mapping[str, str], seed: int
) -> Iterator[dict[str, skins.Fingertip]]:
    """Tared fingertips by name while a scene runs."""
    with ExitStack() as opened:
        tips = {}
        for i, name in enumerate(names):
            number = 100 * seed + i
            tip = skins.Fingertip(made_of.skin, made_of.pipeline, number, made_of.steady)
            tips[name] = opened.enter_context(tip)
            tip.tare()
        yield tips


def grips(fixed: float) -> dict[str, Grip]:
    """Grips to compare: a fixed force (N), one that doubles at slips alone, the adaptive one.

    The law is told the least friction of the objects, as a fixed force is.
    """
    config = replace(fitted(GripConfig(), parallel_hand()), friction_low=min(FRICTION))
    blind = replace(config, friction_low=UNHEEDED)
    return {
        'fixed': Grip(config, fixed, False),
        'doubled at slips': Grip(blind, BEGIN, True),
        'adaptive': Grip(config, BEGIN, True),
    }


def fitted(config: GripConfig, hand: HandModel) -> GripConfig:
    """Gains of a hand: its lag and speed, how stiff it is, how noisy gradiometers are."""
    return replace(
        config, stiffness_low=SOFTEST, stiffness_high=hand.stiffness, force_noise=NOISE,
        lag=hand.lag,
    )  # fmt: skip


def soft_config(hand: HandModel) -> GripConfig:
    """Gains of the soft hand, which comes slowly since it reacts late."""
    softest = SOFTEST_SHARE * hand.stiffness
    return replace(fitted(qb_softhand(), hand), stiffness_low=softest, closing_rate=SLOWLY)


@dataclass(frozen=True)
class Named:
    """Cell of a pad that is touched."""

    true: int  # the nearest one, and the pad's answer; -1 untouched
    estimated: int
    error: float  # of the place (m)
    chance: float  # that noise alone carries the place into another cell


def named(touched: Touched, cells: Array) -> Named:
    """Judge a contact by cells (n, 3) (m)."""
    true, estimated = (
        int(((cells - at) ** 2).sum(axis=1).argmin()) if np.isfinite(at).all() else -1
        for at in (touched.place, touched.estimated)
    )
    error = float(np.linalg.norm(touched.estimated - touched.place))
    known = true >= 0 and np.isfinite(touched.cov).all()
    chance = mistaken(cells, touched.place, touched.cov) if known else 1.0
    return Named(true, estimated, error, chance)


def mistaken(cells: Array, place: Array, cov: Array) -> float:
    """Chance that a place (3,) (m) with errors of a covariance is taken for another cell (n, 3).

    Across the nearest border alone, as one normal error tells.
    """
    near = cells[np.argsort(((cells - place) ** 2).sum(axis=1))[:2]]
    across = (near[1] - near[0]) / np.linalg.norm(near[1] - near[0])
    border = float(across @ (near.mean(axis=0) - place))
    sigma = float(np.sqrt(across @ cov @ across))
    return 0.5 * erfc(border / sigma / sqrt(2.0)) if sigma > 0 else float(border < 0)
