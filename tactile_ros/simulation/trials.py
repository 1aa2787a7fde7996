# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Trials of grasps: hands, calibrated fingertips and scenes put together, each with a seed.

The controller comes as an argument, `nodes.grip_loop.GripLoop`: that of grip_node without ROS.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from tactile_ros.control import GripConfig, qb_softhand
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation import skins
from tactile_ros.simulation.allegro_hand import allegro_hand
from tactile_ros.simulation.hand_world import Rig
from tactile_ros.simulation.parallel_hand import parallel_hand
from tactile_ros.simulation.scenes import (
    FRICTION,
    BalloonScene,
    GraspScene,
    LoadScene,
    SinglePixel,
)
from tactile_ros.simulation.skins import AVERAGED, Fingertip
from tactile_ros.simulation.soft_hand import soft_hand

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from tactile_ros.hands import HandDescription
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.simulation.hand_world import GraspStage, HandWorld
    from tactile_ros.simulation.mjcf import HandModel
    from tactile_ros.simulation.scenes import Carried, Grasped, Handling, Held
    from tactile_ros.simulation.skins import Skin

    Watcher = Callable[[HandWorld], None]

GENTLE, STRONG = 3.5, 15.0  # full scales of gradiometers (N): as built in [3], and stiffer
PRESSES, PRESSED = 800, 8.0  # of a pad's calibration, and their largest force (N)
SOFT_FORCE = 1.5  # N, mean of a soft hand's digits
# N: what motors of a version hold with a sixth to spare
THUMB_FORCE = {'v4': 2.2, 'v4_raised': 4.0, 'v5': 1.5}
BEGIN = 2.5  # N, of grips that adapt
UNHEEDED = 5.0  # friction that is assumed where loads are not to count
SOFTEST, SOFTEST_SHARE = 1.0, 0.4  # N for a whole closure; of the stiffest
SLOWLY = 0.05  # closure per second
NOISE, PAD_NOISE = 0.01, 0.1  # N, of forces by gradiometers and by pads


def unseen(_: HandWorld) -> None:
    """Nobody watches."""


class MakesStage(Protocol):
    """Factory of the loop of a hand."""

    def __call__(
        self, hand: HandDescription, config: GripConfig, fingers: Sequence[str]
    ) -> GraspStage:
        """Make it for a hand, a config, and the sensors that take part; none: all."""
        ...


@dataclass(frozen=True)
class Calibrated:
    """A skin, and its pipelines for single frames and for the mean of 25."""

    skin: Skin
    pipeline: Pipeline
    steady: Pipeline | None = None


class Trials:
    """Scenes with everything in them.

    Parameters
    ----------
    make_stage : callable
        Makes the controller.
    seed : int
        Of the calibrations; noise and poses have the seed of a trial.
    presses : int
        Of a pad's calibration.
    """

    def __init__(self, make_stage: MakesStage, seed: int = 1, presses: int = PRESSES) -> None:
        self._make_stage, self._seed, self._presses = make_stage, seed, presses

    @cached_property
    def pad(self) -> Calibrated:
        """Magnet pads."""
        config = MagnetPadConfig(rate_hz=skins.RATE_HZ)
        skin = skins.magnet_pad_skin(config, PRESSED)
        single, steady = (
            skins.calibrated(
                skin,
                skins.magnet_pad_presses(config, self._seed, PRESSED, self._presses, frames),
                'table_gauss_newton',
            )
            for frames in (1, AVERAGED)
        )
        return Calibrated(skin, single, steady)

    @cached_property
    def strong(self) -> Calibrated:
        """Gradiometers for forces that hold half a kilogram."""
        return self._gradiometer(STRONG)

    @cached_property
    def gentle(self) -> Calibrated:
        """Gradiometers as [3] built them."""
        return self._gradiometer(GENTLE)

    def _gradiometer(self, full_scale: float) -> Calibrated:
        """Gradiometers whose elastomer is as stiff as a full scale (N) tells."""
        config = GradiometerConfig(full_scale=full_scale, rate_hz=skins.RATE_HZ)
        presses = skins.gradiometer_presses(config, self._seed)
        skin = skins.gradiometer_skin(config)
        return Calibrated(skin, skins.calibrated(skin, presses, 'inversion'))

    def _single_pixel(self) -> SinglePixel:
        """One pixel in place of the gentle gradiometer's four, calibrated on the same presses."""
        config = GradiometerConfig(full_scale=GENTLE, rate_hz=skins.RATE_HZ)
        return SinglePixel(skins.gradiometer_presses(config, self._seed))

    def _rig(self, hand: HandModel, tips: Mapping[str, Fingertip], config: GripConfig) -> Rig:
        stage = self._make_stage(hand.description, config, list(tips))
        return Rig(hand, tips, stage, config.rate_hz)

    def balloon(self, single: bool, film: Watcher = unseen) -> Held:
        """A balloon while a magnet comes: the thumb told by its pipeline, or by one pixel."""
        hand = soft_hand()
        config = soft_config(hand)
        with Tips(self.gentle, ['thumb'], 0) as tips:
            pixel = self._single_pixel() if single else None
            scene = BalloonScene(self._rig(hand, tips, config), pixel)
            scene.world.watchers.append(film)
            return scene.hold()

    def pads(
        self, kind: str, seed: int, film: Watcher = unseen, version: str = 'v4_raised'
    ) -> Grasped:
        """The Allegro-like hand, with motors of a version, grasps with magnet pads."""
        hand = allegro_hand(torque=version)
        config = noisy(fitted(GripConfig(), hand))
        return self._grasp(hand, self.pad, config, kind, seed, THUMB_FORCE[version], film)

    def forces(self, which: str, kind: str, seed: int, film: Watcher = unseen) -> Grasped:
        """The hand `allegro` or `soft` grasps with gradiometers."""
        hand = allegro_hand() if which == 'allegro' else soft_hand(1.0)
        made_of = self.strong if which == 'allegro' else self.gentle
        force = THUMB_FORCE['v4'] if which == 'allegro' else SOFT_FORCE
        config = fitted(GripConfig(), hand) if which == 'allegro' else soft_config(hand)
        return self._grasp(hand, made_of, config, kind, seed, force, film)

    def _grasp(
        self,
        hand: HandModel,
        made_of: Calibrated,
        config: GripConfig,
        kind: str,
        seed: int,
        force: float,
        film: Watcher,
    ) -> Grasped:
        with Tips(made_of, list(hand.pads), seed) as tips:
            scene = GraspScene(self._rig(hand, tips, config), kind, seed)
            scene.world.watchers.append(film)
            return scene.grasp(force)

    def carry(self, handling: Handling, seed: int, grip: Grip, film: Watcher = unseen) -> Carried:
        """The parallel hand holds a load that changes."""
        hand = parallel_hand(rate_hz=grip.config.rate_hz)
        with Tips(self.strong, list(hand.pads), seed) as tips:
            scene = LoadScene(self._rig(hand, tips, grip.config), handling)
            scene.world.watchers.append(film)
            return scene.carry(grip.force, grip.adapt)


@dataclass(frozen=True)
class Grip:
    """Grip of a load."""

    config: GripConfig  # of the law
    force: float  # at which it begins (N)
    adapt: bool  # whether slip and load raise it


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


class Tips:
    """Fingertips while a scene runs: a context that gives them by name."""

    def __init__(self, made_of: Calibrated, names: Sequence[str], seed: int) -> None:
        self._made_of, self._names, self._seed = made_of, names, seed
        self._opened = ExitStack()

    def __enter__(self) -> dict[str, Fingertip]:
        """Make and tare them."""
        return dict(self._each())

    def _each(self) -> Iterator[tuple[str, Fingertip]]:
        for i, name in enumerate(self._names):
            made_of = self._made_of
            tip = Fingertip(made_of.skin, made_of.pipeline, 100 * self._seed + i, made_of.steady)
            self._opened.enter_context(tip)
            tip.tare()
            yield name, tip

    def __exit__(self, *_: object) -> None:
        """Let their boards go."""
        self._opened.close()


def fitted(config: GripConfig, hand: HandModel) -> GripConfig:
    """Gains of a hand: its lag and speed, how stiff it is, how noisy gradiometers are."""
    return replace(
        config,
        stiffness_low=SOFTEST,
        stiffness_high=hand.stiffness,
        force_noise=NOISE,
        lag=hand.lag,
    )


def soft_config(hand: HandModel) -> GripConfig:
    """Gains of the soft hand, which comes slowly since it reacts late."""
    softest = SOFTEST_SHARE * hand.stiffness
    return replace(fitted(qb_softhand(), hand), stiffness_low=softest, closing_rate=SLOWLY)


def noisy(config: GripConfig) -> GripConfig:
    """The same for magnet pads, whose small forces are unsure."""
    return replace(config, force_noise=PAD_NOISE)
