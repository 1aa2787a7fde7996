# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A hand in MuJoCo with its sensors' bytes and its driver's messages in one loop.

Physics, sensors and the controller each have a rate of their own on one virtual clock. What the
controller sends is the message of the hand's adapter, filled and read back as the driver reads it;
DDS alone is left out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from tactile_ros.hands.drivers import JOINT_STATE, TRAJECTORY, read_command, read_joint_states
from tactile_ros.nodes.grip_loop import Decision, GripLoop
from tactile_ros.simulation.hands import HandModel, load_engine
from tactile_ros.simulation.skins import Fingertip
from tactile_ros.types import Array, ContactState

TIME_STEP = 1e-3  # s


def scene_text(bodies: str, rest: str) -> str:
    """MJCF of a scene: a light, `bodies` inside of `worldbody`, and what moves them beside it.

    Friction is Coulomb's cone (elliptic) and hardly creeps; a pad's own coefficient holds wherever
    it touches, since pads have priority.
    """
    return f"""<mujoco model="grasp">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{TIME_STEP}" integrator="implicitfast" cone="elliptic" impratio="20"
    noslip_iterations="3"/>
  <visual>
    <global offwidth="640" offheight="480"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0.93 0.94 0.96" rgb2="0.93 0.94 0.96"
      width="8" height="8"/>
  </asset>
  <worldbody>
    <light pos="0.3 -0.4 1" dir="-0.3 0.4 -1" diffuse="0.4 0.4 0.4" castshadow="false"/>
    {bodies}
  </worldbody>
  {rest}
</mujoco>"""


@dataclass(frozen=True)
class PadState:
    """A pad at one instant."""

    # (3,) true contact force and its centre in the sensor frame (N, m); 0 and NaN untouched
    force: Array
    place: Array
    state: ContactState  # estimate of sensor and pipeline


@dataclass(frozen=True)
class Rig:
    """A hand with its sensors and its controller."""

    hand: HandModel
    tips: Mapping[str, Fingertip]  # by sensor, tared; the order is that of the stage's fingers
    stage: GripLoop  # of the same hand
    rate_hz: float  # of the controller (Hz)


class HandWorld:
    """A hand, an object and the loop.

    Parameters
    ----------
    rig : Rig
        The hand, its sensors and its controller.
    objects, rest : str
        MJCF of what is grasped, inside and beside `worldbody`.
    place : callable
        From the centre of a contact in the sensor frame to the place on the sensor's skin.
    field : callable or None
        Field (t, 3) (T) in the sensor frame of what is around: of elements (t, 3) (m) in the
        world, and the sensor's axes (3, 3).

    Attributes
    ----------
    pads : dict of str to PadState
        The newest of every pad.
    read_force : callable
        Force (3,) (N) and whether it may be used; as the pipeline says unless a scene differs.
    before_step : callable
        Called before every step of physics: what happens to the object.
    watchers : list of callable
        Called at every control step.
    """

    def __init__(
        self, rig: Rig, objects: str, rest: str = '',
        place: Callable[[Array], Array] = lambda centre: centre,
        field: Callable[[Array, Array], Array] | None = None,
    ) -> None:  # fmt: skip
        hand, tips = rig.hand, rig.tips
        self.engine = load_engine()
        text = scene_text(hand.bodies + objects, hand.rest + rest)
        self.model = self.engine.MjModel.from_xml_string(text)
        self.data = self.engine.MjData(self.model)
        self.hand, self.tips, self.stage = hand, tips, rig.stage
        self.pads: dict[str, PadState] = {}
        self.steps = 0  # of physics since the start
        self.read_force: Callable[[Fingertip, ContactState], tuple[Array, bool]] = (
            lambda _, state: (state.force, bool(state.valid))
        )
        self.before_step: Callable[[], None] = lambda: None
        self.watchers: list[Callable[[HandWorld], None]] = []
        self._place, self._field = place, field
        self._driver = hand.description.driver
        joints = [self.model.joint(name) for name in self._driver.joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._ctrl = np.array([self.model.actuator(name).id for name in self._driver.joints])
        self._geoms = {self.model.geom(hand.pads[name]).id: name for name in tips}
        self._sites = {name: self.model.site(hand.pads[name]).id for name in tips}
        self._waiting: deque[tuple[float, Array, float]] = deque()
        self._line: tuple[float, Array, Array, float] | None = None
        (sensors_hz,) = {tip.skin.config.rate_hz for tip in tips.values()}
        self._ticks, self._sensor_ticks = (
            round(1.0 / hertz / self.model.opt.timestep) for hertz in (rig.rate_hz, sensors_hz)
        )
        self.put(hand.description.posture('open', np.zeros(len(joints))))

    @property
    def time(self) -> float:
        """Virtual time (s)."""
        return float(self.steps * self.model.opt.timestep)

    def put(self, position: Array) -> None:
        """Place joints (j,) and their drives."""
        self.data.qpos[self._qpos] = self.data.ctrl[self._ctrl] = position
        self.data.act[self.model.actuator_actadr[self._ctrl]] = position
        self.engine.mj_forward(self.model, self.data)

    def run(
        self, seconds: float, watch: Callable[[HandWorld, Decision], bool | None] | None = None
    ) -> None:
        """Let time pass; `watch` sees every control step, and True from it ends the run."""
        for _ in range(round(seconds / self.model.opt.timestep)):
            if self.steps % self._sensor_ticks == 0:
                self._sense()
            ended = False
            if self.steps % self._ticks == 0:
                decided = self._control()
                for watcher in self.watchers:
                    watcher(self)
                ended = watch is not None and watch(self, decided) is True
            self._follow()
            self.before_step()
            self.engine.mj_step(self.model, self.data)
            self.steps += 1
            if ended:
                return

    def pad_forces(self) -> dict[str, tuple[Array, Array]]:
        """For each pad, force on what it touches and its centre, in the sensor frame (N, m)."""
        force = {name: np.zeros(3) for name in self.tips}
        moment = {name: np.zeros(3) for name in self.tips}
        weight = dict.fromkeys(self.tips, 0.0)
        six = np.zeros(6)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            for which in (0, 1):
                name = self._geoms.get(int(contact.geom[which]))
                if name is None:
                    continue
                self.engine.mj_contactForce(self.model, self.data, i, six)
                acts = contact.frame.reshape(3, 3).T @ six[:3]
                force[name] += acts if which == 0 else -acts
                moment[name] += six[0] * contact.pos
                weight[name] += six[0]
        found = {}
        for name, site in self._sites.items():
            if weight[name] <= 0:
                found[name] = np.zeros(3), np.full(3, np.nan)
                continue
            axes = self.data.site_xmat[site].reshape(3, 3)
            centre = moment[name] / weight[name] - self.data.site_xpos[site]
            found[name] = axes.T @ force[name], axes.T @ centre
        return found

    def _sense(self) -> None:
        """One frame of every pad, through bytes and pipeline, to the controller."""
        for i, (name, (force, place)) in enumerate(self.pad_forces().items()):
            tip, field = self.tips[name], None
            touched = self._place(place) if np.any(force) else place
            if self._field is not None:
                axes = self.data.site_xmat[self._sites[name]].reshape(3, 3)
                at = self.data.site_xpos[self._sites[name]]
                field = self._field(at + tip.skin.config.positions @ axes.T, axes)
            state = tip.estimate(touched, force, field)
            self.pads[name] = PadState(force, touched, state)
            estimated, valid = self.read_force(tip, state)
            self.stage.take_touch([i], estimated.tolist(), valid, int(state.slip), self.time)

    def _control(self) -> Decision:
        """Joint states to the controller, and its command through the adapter's messages."""
        states = message(JOINT_STATE)
        states.name = list(self._driver.joints)
        states.position = self.data.qpos[self._qpos].tolist()
        position = read_joint_states(states, self._driver.joints)
        assert position is not None
        self.stage.take_joints(position, self.time)
        decided = self.stage.step(self.time, round(1e9 * self.time))
        if decided.command is not None:
            topic = self._driver.topics[-1]
            sent = message(topic.kind)
            topic.fill(sent, decided.command)
            target, horizon = read_command(topic.kind, sent, self._driver.joints)
            self._waiting.append((self.time + self.hand.dead_time, target, horizon))
        return decided

    def _follow(self) -> None:
        """Move the drives' targets: at once, or along a line to a trajectory's point."""
        while self._waiting and self._waiting[0][0] <= self.time:
            begins, target, horizon = self._waiting.popleft()
            self._line = begins, self.data.ctrl[self._ctrl].copy(), target, horizon
        if self._line is not None:
            begins, start, target, horizon = self._line
            share = min((self.time - begins) / horizon, 1.0) if horizon > 0 else 1.0
            self.data.ctrl[self._ctrl] = start + share * (target - start)


def message(kind: str) -> SimpleNamespace:
    """A blank message with the fields that adapters fill."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id='')
    if kind == TRAJECTORY:
        duration = SimpleNamespace(sec=0, nanosec=0)
        point = SimpleNamespace(positions=[], time_from_start=duration)
        return SimpleNamespace(header=header, joint_names=[], points=[point])
    if kind == JOINT_STATE:
        return SimpleNamespace(header=header, name=[], position=[], velocity=[], effort=[])
    return SimpleNamespace(data=[])
