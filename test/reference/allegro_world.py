# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""An Allegro Hand of MuJoCo that `grip_node`'s loop moves: vendors' gains, clips and dead time.

The links are those of `tactile_ros.simulation`; drives, round tips, weight of the links, objects
and sensors are this world's own. Time is virtual, so that figures do not hang on the machine; DDS
alone is left out. The law is told noisy forces at the contact, joint states and efforts.
"""

from collections import deque

import mujoco
import numpy as np

from tactile_ros.control import GraspOutcome, GraspProgress
from tactile_ros.hands import load_hand
from tactile_ros.nodes.grip_loop import Decision, GripLoop
from tactile_ros.simulation.hands import allegro_bodies
from tactile_ros.types import Array

STEP, PERIOD, DEAD_TIME = 2e-3, 0.01, 0.015  # s
FINGERS = ('index', 'middle', 'ring', 'thumb')
GRAVITY = np.array([0.0, -9.81, 0.0])  # of a level grasp, in the palm's frame
# gains and torque clips (N m/rad, N m) of the joints of a finger and of the thumb
DRIVES = {
    'v4': (((0.417, 0.667, 0.75, 0.417), (0.312, 0.562, 0.375, 0.237)),
           ((0.833, 0.583, 0.5, 0.5), (0.438, 0.338, 0.225, 0.225))),
    'sense': (((1.0, 3.0, 0.6, 0.6), (0.168,) * 4), ((0.6, 0.8, 0.7, 0.7), (0.168,) * 4)),
    'stiff': (((3.0,) * 4, (0.4,) * 4), ((3.0,) * 4, (0.4,) * 4)),
}  # fmt: skip
SHIPPED = {'v4': 'allegro_v4', 'sense': 'allegro_v5_sense', 'stiff': 'allegro_v5_pinch'}
# shape, half sizes (m), mass (kg), width between the tips (m), contact's time constant (s)
OBJECTS = {
    'sphere': ('sphere', '0.03', 0.1, 0.06, 0.006),
    'box': ('box', '0.025 0.045 0.03', 0.12, 0.05, 0.006),
    'cylinder': ('cylinder', '0.0275 0.05', 0.15, 0.055, 0.006),
    'soft': ('sphere', '0.03', 0.06, 0.06, 0.022),
    'heavy': ('box', '0.025 0.045 0.04', 0.3, 0.05, 0.006),
    'beam': ('box', '0.025 0.03 0.07', 0.2, 0.05, 0.006),
}
DROPPED = 0.026  # m
REST = 0.4  # s before a grasp


class AllegroWorld:
    """A hand by its shipped file, an object held still where its tips meet, and the loop.

    Parameters
    ----------
    drive, kind : str
        Keys of `DRIVES` and `OBJECTS`; the hand's file is that of the drive.
    friction : float
        Of the tips.
    seed : int
        Of noise.
    noise : float
        Of each component of a force (N), as `wrench_covariance` states it.
    tilt : float
        By which the sensor frames are turned against the tips (rad).
    drawn : bool
        The seed draws gains, torque clips and dead time, which are not those of the file.

    Attributes
    ----------
    force : dict of str to float
        True normal force of every finger that takes part (N).
    trace : list of (float, dict)
        Those of every control step, and its time (s).
    """

    def __init__(
        self,
        drive: str = 'stiff',
        kind: str = 'box',
        friction: float = 0.7,
        seed: int = 0,
        noise: float = 0.02,
        tilt: float = 0.0,
        drawn: bool = False,
    ) -> None:
        self.hand, self.noise = load_hand(SHIPPED[drive]), noise
        self.rng, driver = np.random.default_rng(seed), self.hand.driver
        gain, clip, self._dead = 1.0, 1.0, DEAD_TIME
        if drawn:
            gain, clip = np.exp(self.rng.uniform(-0.6, 0.6)), self.rng.uniform(0.75, 1.5)
            self._dead = self.rng.uniform(0.005, 0.03)
        order = FINGERS if driver.joints[0] == 'joint_0_0' else ('thumb', *FINGERS[:3])
        places = [(FINGERS.index(name), i) for name in order for i in range(4)]
        joints = [f'joint_{4 * finger + i}_0' for finger, i in places]
        rows = [np.transpose(DRIVES[drive][FINGERS[finger] == 'thumb'])[i] for finger, i in places]
        drives = [(name, gain * kp, clip * most)
                  for name, (kp, most) in zip(joints, rows, strict=True)]  # fmt: skip
        self.model = mujoco.MjModel.from_xml_string(_scene(kind, friction, drives))
        self.data = mujoco.MjData(self.model)
        self._q = np.array([self.model.joint(name).qposadr[0] for name in joints])
        self._v = np.array([self.model.joint(name).dofadr[0] for name in joints])
        for name, low, high in zip(joints, driver.lower, driver.upper, strict=True):
            self.model.jnt_range[self.model.joint(name).id] = low, high
        self._tips = {self.model.geom(f'{name}_pad').id: name for name in self.hand.fingers}
        self._sites = {name: self.model.site(f'{name}_pad').id for name in self.hand.fingers}
        self._turn = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [0, 1, 0],
                               [np.sin(tilt), 0, np.cos(tilt)]])  # fmt: skip
        self._object = self.model.body('object').id
        self._waiting: deque[tuple[float, Array]] = deque()
        self._steps = 0
        self.bias: dict[str, float] = {}  # N, added to what a sensor reads
        self.gain: dict[str, float] = {}  # of a sensor; 0: dead but valid
        self.silent: set[str] = set()
        self.frozen = self.mute = False  # forces with fresh stamps; no joint states
        self._read: dict[str, tuple[list[float], list[float] | None]] = {}
        self.trace: list[tuple[float, dict[str, float]]] = []
        self._place(OBJECTS[kind][3])
        self.restart()
        self.made = self.run(REST)

    @property
    def time(self) -> float:
        """Virtual time (s)."""
        return self._steps * STEP

    @property
    def force(self) -> dict[str, float]:
        """True normal forces now (N)."""
        return {name: total for name, (_, _, total) in self._feel().items()}

    @property
    def moved(self) -> float:
        """Way of the object from where it was placed (m)."""
        return float(np.linalg.norm(self.data.xpos[self._object] - self._start))

    def restart(self) -> None:
        """Begin a fresh loop on the hand as it is, as after a restart of the node."""
        self.loop = GripLoop(self.hand, self.hand.grip())
        self.loop.enable()

    def _posture(self, closure: float) -> Array:
        """Joints (j,) with every finger at a closure."""
        lower, upper = self.hand.driver.lower, self.hand.driver.upper
        position = self.hand.posture('open', np.clip(0.0, lower, upper))
        for name, finger in self.hand.fingers.items():
            position[self.hand.places(name)] = finger.posture(closure)
        return np.clip(position, lower, upper)

    def _put(self, position: Array) -> None:
        """Place joints and their targets."""
        self.data.qpos[self._q] = self.data.ctrl[:] = position
        mujoco.mj_forward(self.model, self.data)

    def _place(self, width: float) -> None:
        """Hold the object where the tips come within its width; the hand opens."""
        for closure in np.arange(0.0, 1.25, 0.005):
            self._put(self._posture(closure))
            at = {name: self.data.site_xpos[site].copy() for name, site in self._sites.items()}
            thumb = at.pop('thumb')
            others = np.mean(list(at.values()), axis=0)
            if np.linalg.norm(others - thumb) <= width:
                break
        along = (others - thumb) / np.linalg.norm(others - thumb)
        up = -GRAVITY + along * (along @ GRAVITY)
        up /= np.linalg.norm(up)
        axes = np.stack([along, np.cross(up, along), up], axis=1)
        turned = np.zeros(4)
        mujoco.mju_mat2Quat(turned, np.ascontiguousarray(axes).ravel())
        self._start = 0.5 * (others + thumb)
        self.data.qpos[-7:-4], self.data.qpos[-4:] = self._start, turned
        self.model.eq_data[0, 3:10] = [*self._start, *turned]
        self.data.qvel[:] = 0.0
        self._put(self._posture(0.0))

    def _feel(self) -> dict[str, tuple[Array, Array | None, float]]:
        """Force and normal of each tip in its sensor frame, and the normal force (N)."""
        world = {name: np.zeros((2, 3)) for name in self._sites}
        total, six = dict.fromkeys(self._sites, 0.0), np.zeros(6)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            for which, geom in enumerate(contact.geom):
                name = self._tips.get(int(geom))
                if name is not None:
                    mujoco.mj_contactForce(self.model, self.data, i, six)
                    frame = contact.frame.reshape(3, 3) * (1.0 if which == 0 else -1.0)
                    world[name] += frame.T @ six[:3], frame[0] * six[0]
                    total[name] += six[0]
        felt = {}
        for name, site in self._sites.items():
            axes = self.data.site_xmat[site].reshape(3, 3) @ self._turn
            force, normal = world[name] @ axes
            felt[name] = force, normal if total[name] > 0 else None, total[name]
        return felt

    def run(self, seconds: float) -> Decision:
        """Let time pass; the last step of the loop."""
        for _ in range(round(seconds / PERIOD)):
            made = self.step()
        return made

    def step(self) -> Decision:
        """One control step, and physics until the next."""
        felt = self._feel()
        self.trace.append((self.time, {name: total for name, (_, _, total) in felt.items()}))
        for i, name in enumerate(self.loop.fingers):
            force, normal, _ = felt[name]
            if name in self.silent:
                continue
            if not (self.frozen and name in self._read):
                reading = self.gain.get(name, 1.0) * force + self.rng.normal(0.0, self.noise, 3)
                reading[2] += self.bias.get(name, 0.0)
                self._read[name] = reading.tolist(), None if normal is None else normal.tolist()
            covariance = (self.noise**2 * np.eye(3)).ravel().tolist()
            told, seen = self._read[name]
            self.loop.take_touch([i], told, True, -1, self.time, seen, covariance)
        if not self.mute:
            position = self.data.qpos[self._q] + self.rng.normal(0.0, 2e-4, len(self._q))
            self.loop.take_joints(position, self.time, self.data.actuator_force.copy())
        self.made = made = self.loop.step(self.time, round(1e9 * self.time))
        if made.command is not None:
            self._waiting.append((self.time + self._dead, made.command.position))
        for _ in range(round(PERIOD / STEP)):
            while self._waiting and self._waiting[0][0] <= self.time:
                self.data.ctrl[:] = self._waiting.popleft()[1]
            self._push()
            mujoco.mj_step(self.model, self.data)
            self._steps += 1
        return made

    handed_over, pull = np.inf, 0.0  # s; N

    def _push(self) -> None:
        """Carry the weight until half a second after the hand-over, then pull down."""
        since = self.time - self.handed_over
        weight = self.model.body_mass[self._object] * 9.81
        carried = weight * (1.0 - np.clip(since / 0.5, 0.0, 1.0))
        pulled = self.pull * np.clip(since - 1.5, 0.0, 1.0)
        self.data.xfrc_applied[self._object, :3] = (pulled - carried) * GRAVITY / 9.81

    def hand_over(self, pull: float = 0.0) -> None:
        """Free the object: its weight comes within 0.5 s, a pull (N) after 1.5 s."""
        self.data.eq_active[0] = 0
        self.handed_over, self.pull = self.time, pull

    def slippery(self, friction: float) -> None:
        """Change the friction of all tips."""
        self.model.geom_friction[list(self._tips), 0] = friction

    def grasp(self, force: float, seconds: float = 8.0, adapt: bool = True) -> GraspProgress:
        """Ask for a force (N) and wait for the end of the grasp."""
        try:
            self.loop.admit(force, (), seconds)
        except ValueError as err:
            return GraspProgress(None, str(err))
        self.loop.grasp(force, (), seconds, adapt)
        for _ in range(round(seconds / PERIOD) + 2):
            made = self.step()
            if made.ended is not None:
                return made.ended
        return GraspProgress(GraspOutcome.TIMEOUT, 'no end')

    def errors(self, seconds: float = 0.2) -> float:
        """Largest share by which a finger's mean force of late is off its target."""
        rows = [forces for at, forces in self.trace if at > self.time - seconds]
        asked = dict(zip(self.loop.fingers, self.made.made.target_force.tolist(), strict=True))
        mean = {name: np.mean([row[name] for row in rows]) for name in asked}
        return max(abs(mean[name] / asked[name] - 1.0) for name in asked if asked[name] > 0)


def _scene(kind: str, friction: float, drives: list[tuple[str, float, float]]) -> str:
    """MJCF of hand, drives and an object that is held still."""
    shape, size, mass, _, soft = OBJECTS[kind]
    actuators = ''.join(
        f'<general name="{name}" joint="{name}" biastype="affine" gainprm="{gain}" '
        f'biasprm="0 -{gain} -{0.02 * gain + 0.01}" forcerange="-{clip} {clip}"/>'
        for name, gain, clip in drives
    )
    bodies = allegro_bodies(friction, capsule=True).replace('gravcomp="1"', '')
    bodies = bodies.replace('damping="0.2"', 'damping="0.03" frictionloss="0.01"')
    bodies = bodies.replace('solref="0.006 1"', f'solref="{soft} 1"')
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>
  <option timestep="{STEP}" gravity="{' '.join(map(str, GRAVITY))}" cone="elliptic" impratio="10"
    integrator="implicitfast"/>
  <worldbody>{bodies}
    <body name="object"><freejoint/><geom type="{shape}" size="{size}" mass="{mass}" condim="4"/>
    </body></worldbody>
  <equality><weld body1="world" body2="object" solref="0.02 1"/></equality>
  <actuator>{actuators}</actuator></mujoco>"""
