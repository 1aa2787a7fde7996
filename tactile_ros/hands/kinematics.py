# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Kinematics of a hand: its URDF, and closures along a synergy or along a pad's normal."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.types import Array, JointLimits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.hands.description import Finger

MOST_CHARACTERS = 20_000_000
MOST_DEPTH = 100
WIDEST = 0.12  # m, between thumb and fingers of a hand that has closed
MOVING = ('revolute', 'continuous', 'prismatic')


@dataclass(frozen=True)
class Joint:
    """One joint of a description: its URDF type as `kind`, and its links.

    `origin` (4, 4) is the pose of its frame in that of the parent (m), `axis` (3,) a unit vector
    in its frame. `limits` are lower, upper (rad, m), velocity and effort, NaN where the
    description is silent; `mimic` has the joint that it follows, multiplier and offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float, float, float]
    mimic: tuple[str, float, float] | None


class _Builder(ET.TreeBuilder):
    """Tree of a document; it refuses document types, which hold entities, and deep nesting."""

    _depth = 0

    def doctype(self, *_: object) -> None:
        msg = 'robot_description must have no document type and no entities'
        raise ValueError(msg)

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        self._depth += 1
        if self._depth > MOST_DEPTH:
            msg = f'robot_description must be nested at most {MOST_DEPTH} deep'
            raise ValueError(msg)
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)


def _numbers(text: str | None, count: int, default: float, what: str) -> Array:
    """Finite numbers of an attribute, parted by spaces."""
    if text is None:
        return np.full(count, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if values.shape != (count,) or not np.isfinite(values).all():
        msg = f'{what} of robot_description must be {count} numbers; received {text[:40]!r}'
        raise ValueError(msg)
    return values


def turn_about(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) about a unit vector by an angle (rad); Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


def _attributes(element: ET.Element, tag: str) -> Mapping[str, str]:
    """Attributes of a child; none where it is missing."""
    child = element.find(tag)
    return {} if child is None else child.attrib


def _joint(element: ET.Element) -> Joint:
    """One <joint> of a robot."""
    name, kind = element.get('name', ''), element.get('type', '')
    what = f'joint {name}'
    place = _attributes(element, 'origin')
    origin = np.eye(4)
    origin[:3, 3] = _numbers(place.get('xyz'), 3, 0.0, f'origin of {what}')
    rpy = _numbers(place.get('rpy'), 3, 0.0, f'origin of {what}')
    origin[:3, :3] = Rotation.from_euler('xyz', rpy).as_matrix()
    axis = _numbers(_attributes(element, 'axis').get('xyz', '1 0 0'), 3, 0.0, f'axis of {what}')
    length = float(np.linalg.norm(axis))
    if kind in MOVING and not length > 0:
        msg = f'axis of {what} of robot_description must not be zero'
        raise ValueError(msg)
    said = _attributes(element, 'limit')
    lower, upper, velocity, effort = (
        float(_numbers(said.get(key), 1, np.nan, f'{key} of {what}')[0])
        for key in ('lower', 'upper', 'velocity', 'effort')
    )
    follows = _attributes(element, 'mimic')
    mimic = None
    if follows:
        factor = _numbers(follows.get('multiplier'), 1, 1.0, f'mimic of {what}')[0]
        offset = _numbers(follows.get('offset'), 1, 0.0, f'mimic of {what}')[0]
        mimic = (follows.get('joint', ''), float(factor), float(offset))
    parent, child = (_attributes(element, tag).get('link', '') for tag in ('parent', 'child'))
    limits = (lower, upper, velocity, effort)
    return Joint(name, kind, parent, child, origin, axis / (length or 1.0), limits, mimic)


class RobotDescription:
    """Joints of a URDF; ValueError where the text is none, too large, or has a document type."""

    def __init__(self, text: str) -> None:
        if len(text) > MOST_CHARACTERS:
            msg = f'robot_description must be shorter than {MOST_CHARACTERS} characters'
            raise ValueError(msg)
        try:
            root = ET.fromstring(text, ET.XMLParser(target=_Builder()))
        except (ET.ParseError, UnicodeError) as err:
            msg = f'robot_description is no XML: {err}'
            raise ValueError(msg) from err
        if root.tag != 'robot':
            msg = f'robot_description must be a <robot>; received <{root.tag[:40]}>'
            raise ValueError(msg)
        self.joints = {j.name: j for j in map(_joint, root.findall('joint'))}
        self._above = {joint.child: joint for joint in self.joints.values()}

    def has_link(self, name: str) -> bool:
        """A link hangs below a joint of the description."""
        return name in self._above

    def limits(self, names: tuple[str, ...], otherwise: JointLimits) -> JointLimits:
        """Limits of joints; what the description does not say is taken from `otherwise`.

        Of speeds and torques the smaller holds: descriptions have placeholders there.
        """
        missing = [name for name in names if name not in self.joints]
        if missing:
            msg = f'robot_description must have every joint of the hand; missing is {missing[0]}'
            raise ValueError(msg)
        said = np.array([self.joints[name].limits for name in names])
        known = np.isfinite(said)
        known[:, 2:] &= said[:, 2:] > 0  # zero stands for "not known" in many descriptions
        rest = otherwise
        other = np.stack([rest.lower, rest.upper, rest.velocity, rest.effort], axis=1)
        taken = np.where(known, said, other)
        taken[:, 2:] = np.minimum(taken[:, 2:], other[:, 2:])
        return JointLimits(*taken.T)

    def _above_link(self, link: str) -> list[Joint]:
        """Joints from the root down to a link."""
        path: list[Joint] = []
        while link in self._above and len(path) <= len(self._above):
            path.insert(0, self._above[link])
            link = path[0].parent
        return path

    def fingertip(self, joints: tuple[str, ...], position: Array) -> Array:
        """Place (3,) in the root of the link that is fixed farthest below the last of joints (n,).

        Joints of others are at 0; NaN where these are no chain.
        """
        fixed = {j.parent: j.child for j in self.joints.values() if j.kind == 'fixed'}
        link = self.joints[joints[-1]].child
        for _ in fixed:
            link = fixed.get(link, link)
        path = self._above_link(link)
        if not {joint.name for joint in path} >= set(joints):
            return np.full(3, np.nan)
        place: Array = Chain(tuple(path), joints).pose_and_jacobian(position)[0][:3, 3]
        return place

    def refuse_misfit(self, hand: str, fingers: Mapping[str, Finger]) -> None:
        """Raise ValueError where thumb and fingers of a hand do not meet here as they close."""
        tips: dict[int, list[Array]] = {0: [], 1: [], -1: []}
        for finger in fingers.values():
            tips[finger.side].append(self.fingertip(finger.joints, finger.posture(1.0)))
        if not (tips[1] and tips[-1]):
            return
        apart = float(np.linalg.norm(np.mean(tips[1], axis=0) - np.mean(tips[-1], axis=0)))
        if apart > WIDEST:  # false of NaN
            msg = (
                f'thumb and fingers of robot_description are {1e3 * apart:.0f} mm apart where '
                f'{hand} has closed: its postures are of another hand, of the other side say '
                '(names of left ones end in _left)'
            )
            raise ValueError(msg)

    def chain(self, frame: str, joints: tuple[str, ...], tip_offset: float = 0.0) -> Chain:
        """Chain from the parent of a finger's first joint to the link `frame` of its pad.

        ValueError if the link is not there, or the joints of the finger do not lie above it.
        """
        if frame not in self._above:
            msg = f'frame must be a link of robot_description below a joint; received {frame!r}'
            raise ValueError(msg)
        path = self._above_link(frame)
        driven = [i for i, j in enumerate(path) if j.name in joints]
        if {path[i].name for i in driven} != set(joints):
            msg = f'the joints above link {frame} of robot_description must include {joints}'
            raise ValueError(msg)
        return Chain(tuple(path[driven[0] :]), joints, tip_offset)


@dataclass(frozen=True)
class Chain:
    """Serial chain of joints (`path`) from the base of a finger to its pad.

    Positions are given for `joints`; the pad lies by `tip_offset` (m) farther from the last.
    """

    path: tuple[Joint, ...]
    joints: tuple[str, ...]
    tip_offset: float = 0.0

    def pose_and_jacobian(self, position: Array) -> tuple[Array, Array]:
        """Pose (4, 4) of the pad in the base, and Jacobian (3, n) of its origin.

        `position` (n,) is that of `joints` (rad, m).
        """
        pose = np.eye(4)
        columns: list[tuple[int, float, Array, Array, bool]] = []
        for joint in self.path:
            pose = pose @ joint.origin
            index, factor, offset = self._driver(joint)
            if index < 0:
                continue
            value = factor * float(position[index]) + offset
            axis = pose[:3, :3] @ joint.axis
            slides = joint.kind == 'prismatic'
            columns.append((index, factor, axis, pose[:3, 3].copy(), slides))
            step = np.eye(4)
            if slides:
                step[:3, 3] = joint.axis * value
            else:
                step[:3, :3] = turn_about(joint.axis, value)
            pose = pose @ step
        along = pose[:3, 3] - columns[-1][3] if columns else np.zeros(3)
        pose[:3, 3] += along * (self.tip_offset / (float(np.linalg.norm(along)) or 1.0))
        jacobian = np.zeros((3, len(self.joints)))
        for index, factor, axis, origin, slides in columns:
            moved = axis if slides else np.cross(axis, pose[:3, 3] - origin)
            jacobian[:, index] += factor * moved
        return pose, jacobian

    def _driver(self, joint: Joint) -> tuple[int, float, float]:
        """Which position moves a joint, times what, plus what; -1: none does."""
        name, factor, offset = joint.mimic or (joint.name, 1.0, 0.0)
        moves = joint.kind in MOVING and name in self.joints
        return (self.joints.index(name) if moves else -1, factor, offset)


DAMPING = 5e-3  # m per rad: near a singular posture the motion fades instead of racing
EASE_S = 0.5  # time constant in which what the normal led is left


class FingerPath:
    """Joint targets of a finger by its closure: along its synergy, or along its pad's normal.

    Without a chain the joints follow the synergy. With the chain of a pad (z out of the skin) the
    pad moves along its normal beyond the pre-grasp posture, inside of joint limits (n,). Beyond a
    contact the joints press as the drives do.

    Notes
    -----
    Damped least squares: dq = J^T (J J^T + d^2 I)^-1 n, with n the pad's normal in the base, made
    as long as the synergy, so that speeds and gains of the closure keep their meaning. Where
    it would open what the synergy closes, the synergy is followed. The singular values of J
    carry the solution: no matrix is inverted.
    """

    def __init__(self, finger: Finger, chain: Chain | None, lower: Array, upper: Array) -> None:
        self._finger, self._chain = finger, chain
        self._lower, self._upper = lower, upper
        self._turned = np.zeros(len(finger.joints))  # what the normal has led beside the synergy
        self._closure = np.nan

    def joints(self, closure: float, contact: float, dt: float) -> Array:
        """Joint targets (n,) of a closure beyond a contact (NaN: none), dt (s) after the last."""
        finger = self._finger
        at = contact if closure > contact else closure
        position = finger.posture(at)
        if self._chain is not None:
            position = self._led(self._chain, position, at, dt)
        if at == closure:
            return position
        return position + finger.press * (closure - at)

    def _led(self, chain: Chain, on_path: Array, closure: float, dt: float) -> Array:
        """Posture (n,) of a closure with what the pad's normal has led it beside the synergy."""
        corner, before = self._finger.corner, self._closure
        moved = max(closure, corner) - max(before if np.isfinite(before) else closure, corner)
        self._closure = closure
        if closure > corner:
            way = self._direction(chain, on_path + self._turned) - self._finger.slope
            turned = self._turned + moved * way
        else:
            turned = self._turned * exp(-dt / EASE_S)
        position: Array = np.clip(on_path + turned, self._lower, self._upper)
        self._turned = position - on_path
        return position

    def _direction(self, chain: Chain, position: Array) -> Array:
        """Motion of the joints (n,) per closure at joint positions (n,)."""
        pose, jacobian = chain.pose_and_jacobian(position)
        u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
        step: Array = vt.T @ (s / (s**2 + DAMPING**2) * (u.T @ pose[:3, 2]))
        length, synergy = float(np.linalg.norm(step)), self._finger.slope
        if not length > 0 or step @ synergy <= 0:
            return synergy
        return step * (np.linalg.norm(synergy) / length)
