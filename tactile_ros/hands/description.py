# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A hand as `config/hands/<hand>.yaml` describes it: its driver, its fingers, their sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from tactile_ros.control import GripConfig
from tactile_ros.files import read_yaml
from tactile_ros.hands.drivers import HandDriver, in_order, load_driver
from tactile_ros.types import Array, Integers, JointLimits, admit_name
from tactile_ros.types.config_fields import admit, array, number, text_of, texts, whole

FULL = 0.95  # of the torque at which a drive clips
SOFTLY = 0.5  # 1/s, approach of drives that give way
SIDEWAYS = 0.25  # of the longest lever: of joints that the normal force does not load
TELLS = 0.1  # of the fastest joint's motion, below which a joint tells no closure


@dataclass(frozen=True)
class Finger:
    """One finger as a hand's file describes it; ValueError if lengths differ or nothing closes.

    Its closure goes from 0, the open posture, straight to the pre-grasp posture and from there
    along the synergy `closing` to 1, at even speed in joint space. A hand whose joints are
    synergies has such a finger too.
    """

    joints: tuple[str, ...] = texts(('joint',), 'names of its joints')
    open: Array = array([0.0], 'posture when open', 'rad', (-1,), -10.0, 10.0)
    pre_grasp: Array = array([0.0], 'posture from which it closes', 'rad', (-1,), -10.0, 10.0)
    closing: Array = array([1.0], 'motion from pre_grasp to closed', 'rad', (-1,), -10.0, 10.0)
    lever: Array = array(
        [0.0], 'torque of each joint per force along the normal of the pad', 'm', (-1,), -1.0, 1.0
    )
    kp: Array = array(
        [0.0], 'gain of the position loop of each joint; 0: not known', 'N m/rad', (-1,), 0.0, 1e4
    )
    torque: Array = array(
        [0.0], 'where each drive clips its torque; 0: not known', 'N m', (-1,), 0.0, 1e3
    )
    kp_factor: float = number(1.3, 'factor by which kp may be wrong either way', '1', 1.0, 10.0)
    free_effort: float = number(0.08, 'torque that moves a joint free of load', 'N m', 0.0, 10.0)
    side: int = whole(0, '1, and -1 for what opposes it, such as a thumb; 0: not stated', -1, 1)
    sensors: tuple[str, ...] = texts(('finger',), 'namespaces of its sensors')
    frame: str = text_of('', 'link of the pad in robot_description, z out of the skin')

    def __post_init__(self) -> None:
        """Hold every value to its range and length."""
        admit(self)
        count = len(self.joints)
        for name in ('open', 'pre_grasp', 'closing', 'lever', 'kp', 'torque'):
            values = getattr(self, name)
            if len(values) == 1 and name in ('lever', 'kp', 'torque'):
                values = np.repeat(values, count)
                object.__setattr__(self, name, values)
            if len(values) != count:
                msg = (
                    f'{name} of Finger must have one number for each of its {count} joints; '
                    f'received {len(values)}'
                )
                raise ValueError(msg)
        if not self.closing.any():
            msg = 'closing of Finger must move at least one joint; received zeros'
            raise ValueError(msg)
        for name in self.sensors:
            admit_name('sensors of Finger', name)

    @cached_property
    def corner(self) -> float:
        """Closure of the pre-grasp posture."""
        before = float(np.linalg.norm(self.pre_grasp - self.open))
        return before / (before + float(np.linalg.norm(self.closing)))

    @cached_property
    def slope(self) -> Array:
        """Motion of the joints (n,) per closure beyond the pre-grasp posture."""
        per_closure: Array = self.closing / (1.0 - self.corner)
        return per_closure

    @cached_property
    def opening(self) -> Array:
        """Motion of the joints (n,) per closure before the pre-grasp posture."""
        return (self.pre_grasp - self.open) / self.corner if self.corner else self.slope

    def posture(self, closure: float) -> Array:
        """Joint positions (n,) at a closure, before any limit."""
        slope = self.opening if closure < self.corner else self.slope
        return self.pre_grasp + slope * (closure - self.corner)

    @cached_property
    def _lines(self) -> tuple[Array, list[float]]:
        """Both directions of the path (n, 2), and their squared lengths."""
        lines = np.stack([self.opening, self.slope], axis=1)
        return lines, np.einsum('ni,ni->i', lines, lines).tolist()

    def closure_of(self, position: Array) -> float:
        """Closure whose posture lies nearest to joint positions (n,); beyond 0 and 1 too."""
        lines, lengths = self._lines
        first, second = ((position - self.pre_grasp) @ lines).tolist()
        before, after = min(first / lengths[0], 0.0), max(second / lengths[1], 0.0)
        # squared distances to both lines, without the part that they share
        far = lengths[0] * before**2 - 2.0 * before * first
        near = lengths[1] * after**2 - 2.0 * after * second
        beyond: float = before if far < near else after
        return self.corner + beyond

    def depth(self, position: Array, closure: float) -> float:
        """Way of the pad along its normal beyond that of a closure, in closures."""
        if not self.is_soft:
            return self.closure_of(position) - closure
        return float(self.lever @ (position - self.posture(closure))) / self.travel

    def shortfall(self, closure: float, contact: float, wanted: Array, sent: Array) -> float:
        """Closure that joints (n,) lack which were sent instead of those of a closure.

        Where drives press it is the force that is lacking; before that it is the way of the joint
        which comes closest: where one follows, the finger still closes.
        """
        if self.is_soft and closure > contact:
            return float(self.lever @ (wanted - sent)) / self.travel
        moves, slope = self._motions[int(closure >= self.corner)]
        behind = (wanted - sent)[moves] / slope
        return float(behind[np.abs(behind).argmin()])

    @cached_property
    def _motions(self) -> list[tuple[Integers, Array]]:
        """Joints that move, and by how much per closure, before and from the pre-grasp posture."""
        slopes = (self.opening, self.slope)
        moves = [np.flatnonzero(np.abs(s) > TELLS * np.abs(s).max()) for s in slopes]
        return [(own, slope[own]) for own, slope in zip(moves, slopes, strict=True)]

    @cached_property
    def is_soft(self) -> bool:
        """Judge whether gains and levers of its drives are known: they press by their lag."""
        return bool(self.kp.all() and self.lever @ self.slope > 0.0)

    @cached_property
    def travel(self) -> float:
        """Motion of the pad along its normal, per closure (m); NaN: not known."""
        return float(self.lever @ self.slope) if self.lever.any() else float('nan')

    @cached_property
    def _compliance(self) -> float:
        """Way of the pad along its normal per force (m/N), while its drives hold their targets."""
        return float((self.lever**2 / self.kp).sum())

    @cached_property
    def stiffness(self) -> float:
        """Force of the pad per closure on a rigid object (N); NaN where it is not known."""
        return self.travel / self._compliance if self.is_soft else float('nan')

    @cached_property
    def press(self) -> Array:
        """Motion of the joints' targets (n,) per closure that presses the pad along its normal.

        Torques J^T f over gains: so the pad presses along its normal alone, in any posture.
        """
        pushes: Array = self.lever / self.kp * self.stiffness if self.is_soft else self.slope
        return pushes

    def pass_on(self, wanted: Array, lower: Array, upper: Array) -> Array:
        """The same way of the pad (n,), where a joint at its limit leaves it to the others."""
        inside = np.minimum(np.maximum(wanted, lower), upper)
        free = inside == wanted
        if free.all() or not self.is_soft:
            return wanted
        others = np.where(free, self.lever / self.kp, 0.0)
        way, reach = float(self.lever @ (wanted - inside)), float(self.lever @ others)
        return inside + others * (way / reach) if way > 0.0 and reach > 0.0 else wanted

    def force_of(self, lead: Array) -> float:
        """Force of the pad (N) where targets lead the joints by angles (n,); NaN: not known."""
        return float(self.lever @ lead) / self._compliance if self.is_soft else float('nan')

    @cached_property
    def clipping(self) -> Array:
        """Angle (n,) from which a target leads a joint that carries the pad at all its torque."""
        known = (self.torque > 0) & (self.kp > 0) & (self.lever != 0)
        return np.where(known, FULL * self.torque / np.where(known, self.kp, 1.0), np.inf)

    def reach(self, lower: Array, upper: Array, most_offset: float) -> float:
        """Largest force of the pad (N) that its drives give where they can best; inf: not known.

        Torques are clipped, and bounded by how far a target may lead its joint.
        """
        if not self.is_soft:
            return float('inf')
        carries, best = np.abs(self.lever) >= SIDEWAYS * np.abs(self.lever).max(), 0.0
        for share in np.linspace(0.0, 1.0, 11):
            at = self.pre_grasp + share * self.closing
            room = np.where(self.lever > 0, upper - at, at - lower)
            torque = self.kp_factor * self.kp * np.minimum(room, most_offset)
            torque = np.where(self.torque > 0, np.minimum(torque, self.torque), torque)
            best = max(best, float((torque[carries] / np.abs(self.lever[carries])).min()))
        return best

    def fastest(self, velocity: Array) -> float:
        """Closure per second at which the first joint reaches its speed (n,)."""
        steepest = np.abs([self.slope, self.opening, self.press]).max(axis=0)
        moving = steepest > 0
        return float((velocity[moving] / steepest[moving]).min())

    def extend(self, offset: float) -> Finger:
        """The same finger with longer levers of the joints that bend it (m)."""
        bends = np.abs(self.lever) >= np.abs(self.lever[-1])  # as the last joint does
        return replace(self, lever=self.lever + bends * np.sign(self.lever) * offset)

    def caps(self, force: float) -> Array:
        """Largest torques (n,) that hold a force at the pad (N); NaN where no lever is stated."""
        return self._least_levers * force + self.free_effort

    @cached_property
    def _least_levers(self) -> Array:
        """Levers (n,) of torque caps, also for joints that a normal force does not load."""
        lever = np.abs(self.lever)
        return (
            np.maximum(lever, SIDEWAYS * lever.max())
            if lever.any()
            else np.full_like(lever, np.nan)
        )


T = TypeVar('T')
MOST_BYTES = 200_000
NEEDED = {'joints', 'open', 'pre_grasp', 'closing', 'sensors'}


@dataclass(frozen=True)
class HandDescription:
    """A hand, its driver and its fingers by name, in the order of the file.

    ValueError if a finger names a joint that the driver does not have, or a posture outside its
    limits.
    """

    name: str
    driver: HandDriver
    fingers: Mapping[str, Finger]

    def __post_init__(self) -> None:
        """Check the fingers against the driver."""
        if not self.fingers:
            msg = f'fingers of hand {self.name} must be one or more; received none'
            raise ValueError(msg)
        limits = self.driver.limits
        for name, finger in self.fingers.items():
            try:
                place = in_order(self.driver.joints, finger.joints)
            except ValueError as err:
                msg = f'finger {name} of hand {self.name}: {err}'
                raise ValueError(msg) from err
            for posture in ('open', 'pre_grasp'):
                angles = getattr(finger, posture)
                if not ((limits.lower[place] <= angles) & (angles <= limits.upper[place])).all():
                    msg = (
                        f'{posture} of finger {name} of hand {self.name} must lie within the '
                        f'limits of its joints; received {angles.tolist()}'
                    )
                    raise ValueError(msg)

    def places(self, finger: str) -> Integers:
        """Places of a finger's joints in the command, shape (n,)."""
        return in_order(self.driver.joints, self.fingers[finger].joints)

    def posture(self, which: str, rest: Array) -> Array:
        """Whole hand (j,) with all fingers in `open` or `pre_grasp`, other joints at `rest`."""
        position = np.array(rest, np.float64)
        for name, finger in self.fingers.items():
            position[self.places(name)] = getattr(finger, which)
        return position

    def with_tips(self) -> HandDescription:
        """The same hand with the levers of its real tips, by `tip_offset` of its driver."""
        offset = self.driver.tip_offset
        return replace(self, fingers={n: f.extend(offset) for n, f in self.fingers.items()})

    def driven_by(self, driver: HandDriver) -> HandDescription:
        """The same hand by another driver; where it names joints anew, they follow by place."""
        before, now = self.driver.joints, driver.joints
        fingers = self.fingers
        if set(now).isdisjoint(before) and len(now) == len(before):
            new = dict(zip(before, now, strict=True))
            fingers = {
                name: replace(finger, joints=tuple(new[joint] for joint in finger.joints))
                for name, finger in fingers.items()
            }
        return HandDescription(self.name, driver, fingers)

    def grip(self) -> GripConfig:
        """Parameters of the grip law to begin with."""
        config = self.driver.grip()
        if all(finger.is_soft for finger in self.fingers.values()):
            return replace(config, closing_rate=SOFTLY)
        return config

    def paced(self, rate_hz: float) -> HandDescription:
        """The same hand for commands at a rate (Hz)."""
        return replace(self, driver=self.driver.paced(rate_hz))

    def with_limits(self, limits: JointLimits) -> HandDescription:
        """The same hand with the limits of its `robot_description`; postures are drawn inside.

        ValueError where that leaves a finger no way to close.
        """
        lower, upper = limits.lower, limits.upper
        effort = limits.effort if np.isfinite(limits.effort).all() else None
        driver = replace(
            self.driver, lower=lower, upper=upper, velocity=limits.velocity, effort=effort
        )
        drawn = {}
        for name, finger in self.fingers.items():
            place = self.places(name)
            opened, begun, closed = np.clip(
                [finger.open, finger.pre_grasp, finger.pre_grasp + finger.closing],
                lower[place], upper[place],
            )  # fmt: skip
            if (closed == begun).all():
                msg = (
                    f'finger {name} of hand {self.name} cannot close within {lower[place]} and '
                    f'{upper[place]}'
                )
                raise ValueError(msg)
            drawn[name] = replace(finger, open=opened, pre_grasp=begun, closing=closed - begun)
        return HandDescription(self.name, driver, drawn)


def narrowed(described: JointLimits, asked: JointLimits, shipped: JointLimits) -> JointLimits:
    """Limits of a `robot_description`, drawn in where a user asked for others than are shipped."""
    lower = np.where(
        asked.lower != shipped.lower, np.maximum(described.lower, asked.lower), described.lower
    )
    upper = np.where(
        asked.upper != shipped.upper, np.minimum(described.upper, asked.upper), described.upper
    )
    return replace(described, lower=lower, upper=upper)


def folder() -> Path | None:
    """Folder of the shipped hands: beside the sources, or in the share of an installation."""
    package = Path(__file__).resolve().parents[1]
    installed = [p / 'share' / 'tactile_ros' / 'config' for p in package.parents]
    places = [place / 'hands' for place in (package.parent / 'config', *installed)]
    return next((place for place in places if place.is_dir()), None)


def list_hands() -> list[str]:
    """Names of the hands that the package describes."""
    place = folder()
    return [] if place is None else sorted(path.stem for path in place.glob('*.yaml'))


def load_hand(name: str) -> HandDescription:
    """Hand of `list_hands()`, or of a path that ends in .yaml.

    ValueError with one sentence that names the file and what it must hold.
    """
    place, path = folder(), Path(name)
    if path.suffix != '.yaml':
        if name not in list_hands() or place is None:
            msg = f'hand must be one of {", ".join(list_hands())}, or a .yaml; received {name!r}'
            raise ValueError(msg)
        path = place / f'{name}.yaml'
    try:
        if path.stat().st_size > MOST_BYTES or not path.is_file():
            msg = f'it must be a file smaller than {MOST_BYTES} bytes'
            raise ValueError(msg)  # noqa: TRY301
        content = read_yaml(path.read_text('utf-8'))
    except (OSError, ValueError) as err:
        why = (isinstance(err, OSError) and err.strerror) or ' '.join(str(err).split())[:200]
        msg = f'{path} cannot be read: {why}'
        raise ValueError(msg) from err
    try:
        return parse(path.stem, content)
    except ValueError as err:
        msg = f'{path}: {err}'
        raise ValueError(msg) from err


def parse(name: str, content: object) -> HandDescription:
    """Hand of a yaml document: `driver`, `options` (fields of it, may be missing) and `fingers`.

    ValueError with one sentence.
    """
    admit_name('name of a hand', name)
    document = _mapping('a description of a hand', content, {'driver', 'options', 'fingers'})
    kind = load_driver(str(document.get('driver')))
    options = _mapping(
        f'options of {name}', document.get('options') or {}, {f.name for f in fields(kind)}
    )
    known = {f.name for f in fields(Finger)}
    fingers = {}
    for key, entry in _mapping(f'fingers of {name}', document.get('fingers') or {}).items():
        values = _mapping(f'finger {key}', entry, known)
        if not values.keys() >= NEEDED:
            msg = f'finger {key} must have {", ".join(sorted(NEEDED - values.keys()))}'
            raise ValueError(msg)
        fingers[admit_name('name of a finger', key)] = _made(Finger, values, f'finger {key}')
    return HandDescription(name, _made(kind, options, f'options of {name}'), fingers)


def _made(kind: type[T], values: Mapping[str, object], what: str) -> T:
    """Dataclass of yaml values."""
    try:
        return kind(**values)
    except (ValueError, TypeError) as err:
        msg = f'{what}: {err}'
        raise ValueError(msg) from err


def _mapping(what: str, value: object, known: set[str] | None = None) -> dict[str, object]:
    """A mapping with texts as keys, all of them known."""
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        msg = f'{what} must be a mapping of names; received {str(value)[:80]}'
        raise ValueError(msg)
    unknown = sorted(value.keys() - known) if known else []
    if unknown:
        msg = f'{what} must have none but {", ".join(sorted(known or ()))}; received {unknown[0]}'
        raise ValueError(msg)
    return cast('dict[str, object]', value)
