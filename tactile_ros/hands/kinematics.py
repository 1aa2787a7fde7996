# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Kinematics of a hand: its URDF, and closures along a synergy or along a pad's normal."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.types import Array, JointLimits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.hands.description import Finger
    from tactile_ros.types import Array

MOST_CHARACTERS = 20_000_000
MOST_DEPTH = 100
WIDEST = 0.12  # m, between thumb and fingers of a hand that has closed
MOVING = ('revolute', 'continuous', 'prismatic')


@dataclass(frozen=True)
class Joint:
    """One joint of a description.

    Attributes
    ----------
    name, kind, parent, child : str
        Its name, URDF type and links.
    origin : ndarray, shape (4, 4)
        Pose of its frame in that of the parent (m).
    axis : ndarray, shape (3,)
        Unit vector in its frame.
    limits : tuple of float
        lower, upper (rad, m), velocity, effort; NaN where the description is silent.
    mimic : tuple of (str, float, float) or None
        Joint that it follows, multiplier, offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float, float, float]
    mimic: tuple[str, float, float] | None


def _root(text: str) -> ET.Element:
    """Root element of a document without document type and entities."""
    if len(text) > MOST_CHARACTERS:
        msg = f'robot_description must be shorter than {MOST_CHARACTERS} characters'
        raise ValueError(msg)
    parser, builder = expat.ParserCreate(), ET.TreeBuilder()
    depth = 0

    def refuse(*_: object) -> None:
        msg = 'robot_description must have no document type and no entities'
        raise ValueError(msg)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            msg = f'robot_description must be nested at most {MOST_DEPTH} deep'
            raise ValueError(msg)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, UnicodeError) as err:
        msg = f'robot_description is no XML: {err}'
        raise ValueError(msg) from err
    return builder.close()


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
    """Joints of a URDF.

    Parameters
    ----------
    text : str
        The document.

    Raises
    ------
    ValueError
        With one sentence, where it is none, too large, or has a document type or entities.
    """

    def __init__(self, text: str) -> None:
        root = _root(text)
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

        Of speeds and torques the smaller holds: descriptions have placeholders there. ValueError
        if a joint is not in the description.
        """
        missing = [name for name in names if name not in self.joints]
        if missing:
            msg = f'robot_description must have every joint of the hand; it lacks {missing[0]}'
            raise ValueError(msg)
        said = np.array([self.joints[name].limits for name in names])
        known = np.isfinite(said)
        known[:, 2:] &= said[:, 2:] > 0  # zero stands for "not known" in many descriptions
        other = np.stack(
            [otherwise.lower, otherwise.upper, otherwise.velocity, otherwise.effort], axis=1
        )
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
        """Raise ValueError where thumb and fingers of a hand do not meet here as they close.

        The postures are those of another hand then: of a right one, say, on a left one.
        """
        tips: dict[int, list[Array]] = {0: [], 1: [], -1: []}
        for finger in fingers.values():
            tips[finger.side].append(self.fingertip(finger.joints, finger.posture(1.0)))
        if not (tips[1] and tips[-1]):
            return
        apart = float(np.linalg.norm(np.mean(tips[1], axis=0) - np.mean(tips[-1], axis=0)))
        if apart > WIDEST:  # false of NaN
            msg = (
                f'thumb and fingers of robot_description are {1e3 * apart:.0f} mm apart where '
                f'{hand} has closed: its postures are of another hand, a right one say'
            )
            raise ValueError(msg)

    def chain(self, frame: str, joints: tuple[str, ...], tip_offset: float = 0.0) -> Chain:
        """Chain from the parent of a finger's first joint to the link `frame` of its pad.

        The pad lies by `tip_offset` (m) farther from the last of the joints than described.
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
    """Serial chain from the base of a finger to its pad.

    Attributes
    ----------
    path : tuple of Joint
        From the base to the pad.
    joints : tuple of str
        Names of those that a position is given for.
    tip_offset : float
        By which the pad lies farther from the last of them (m).
    """

    path: tuple[Joint, ...]
    joints: tuple[str, ...]
    tip_offset: float = 0.0

    def pose_and_jacobian(self, position: Array) -> tuple[Array, Array]:
        """Pose of the pad in the base, and how its origin moves.

        Parameters
        ----------
        position : ndarray, shape (n,)
            Of `joints` (rad, m).

        Returns
        -------
        pose : ndarray, shape (4, 4)
            Of the link in the frame of the finger's first parent.
        jacobian : ndarray, shape (3, n)
            Velocity of the link's origin per joint velocity.
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


class PadNormal:
    """Path of a finger whose pad moves along its normal beyond the pre-grasp posture.

    Parameters
    ----------
    finger : Finger
        Whose joints move, as far as its synergy would.
    chain : Chain
        Of its pad, z out of the skin.
    lower, upper : ndarray, shape (n,)
        Limits of its joints.

    Notes
    -----
    Damped least squares: dq = J^T (J J^T + d^2 I)^-1 n, with n the pad's normal in the base, made
    as long as the synergy, so that speeds and gains of the closure keep their meaning. Where
    it would open what the synergy closes, the synergy is followed. The singular values of J
    carry the solution: no matrix is inverted.
    """

    def __init__(self, finger: Finger, chain: Chain, lower: Array, upper: Array) -> None:
        self.finger, self._chain = finger, chain
        self._lower, self._upper = lower, upper
        self._turned = np.zeros(len(finger.joints))  # what the normal has led beside the synergy
        self._closure = np.nan

    def direction(self, position: Array) -> Array:
        """Motion of the joints (n,) per closure at joint positions (n,)."""
        pose, jacobian = self._chain.pose_and_jacobian(position)
        u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
        step: Array = vt.T @ (s / (s**2 + DAMPING**2) * (u.T @ pose[:3, 2]))
        length, synergy = float(np.linalg.norm(step)), self.finger.slope
        if not length > 0 or step @ synergy <= 0:
            return synergy
        return step * (np.linalg.norm(synergy) / length)

    def joints(self, closure: float, contact: float, dt: float) -> Array:
        """Joint targets (n,) of a closure, a time dt (s) after the last; see `Path`."""
        at = contact if closure > contact else closure
        corner, before = self.finger.corner, self._closure if np.isfinite(self._closure) else at
        on_path = self.finger.posture(at)
        moved, self._closure = max(at, corner) - max(before, corner), at
        turned = self._turned + moved * (
            self.direction(on_path + self._turned) - self.finger.slope
        )
        if at <= corner:
            turned = self._turned * exp(-dt / EASE_S)
        position = np.clip(on_path + turned, self._lower, self._upper)
        self._turned = position - on_path
        pressed: Array = position + self.finger.press * (closure - at)
        return pressed
