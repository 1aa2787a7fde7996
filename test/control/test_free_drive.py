"""A soft drive at a hard object: its joint stands still, and the force follows its commands."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from tactile_ros.control import GripConfig, GripForce, GripInput
from tactile_ros.control.force_pi import FreeDrive

PERIOD, FINE = 0.01, 1e-3  # s
CONTACT = 0.3
TARGET = 4.0  # N
PUSHED = 2e-2  # closure per newton


class SoftDrive:
    """A torque that grows with command less joint, behind dead time and lag, at a hard object.

    Stronger fingers push the object, and this joint, back: what it tells is not how force grows.
    """

    def __init__(self, stiffness: float, dead_time: float, lag: float, seed: int) -> None:
        self.stiffness, self.lag = stiffness, lag
        self.rng = np.random.default_rng(seed)
        self.target = 0.0
        self.queue = deque([0.0] * round(dead_time / FINE))

    @property
    def force(self) -> float:
        return self.stiffness * max(self.target - CONTACT, 0.0)

    def given(self) -> GripInput:
        closure = min(self.target, CONTACT) - PUSHED * self.force
        return GripInput(
            normal=np.array([self.force + 0.01 * self.rng.normal()]),
            tangential=np.zeros(1), valid=np.ones(1, bool), slip=np.full(1, -1, np.int8),
            age=np.zeros(1), closure=np.array([closure]), closure_age=0.0,
        )  # fmt: skip

    def advance(self, command: float) -> None:
        for _ in range(round(PERIOD / FINE)):
            self.queue.append(command)
            self.target += FINE / self.lag * (self.queue.popleft() - self.target)


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('stiffness', [7.0, 13.0])
def test_a_soft_drive_settles_at_a_hard_object(stiffness: float, seed: int) -> None:
    config = GripConfig(stiffness_low=1.0, stiffness_high=13.1, lag=0.01, closure_rate=7.0)
    drive = SoftDrive(stiffness, config.dead_time, config.lag, seed)
    law = GripForce(config, (0,))
    law.enable()
    law.grasp(TARGET, adapt=False)
    forces = []
    for _ in range(600):
        made = law.step(drive.given(), PERIOD)
        drive.advance(float(made.closure[0]))
        forces.append(drive.force)
    assert max(forces) < 1.1 * TARGET
    late = np.array(forces[-200:])
    assert np.abs(late / TARGET - 1.0).max() < 0.05


def test_a_drive_that_nothing_hinders_is_where_its_commands_have_brought_it() -> None:
    config = GripConfig(dead_time=0.03, lag=0.05)
    drive, now = FreeDrive(config), 0.0
    drive.seat(0.2)
    sent, rng = [], np.random.default_rng(0)
    for _ in range(40):
        command, dt = rng.uniform(0.0, 1.0), rng.uniform(0.005, 0.02)
        drive.step(command, dt)
        sent.append((now + config.dead_time, command))
        now += dt
    closure, target, at = 0.2, 0.2, 0.0
    for due, command in [*[one for one in sent if one[0] < now], (now, np.nan)]:
        closure += (target - closure) * (1.0 - np.exp((at - due) / config.lag))
        target, at = command, due
    assert drive.closure == pytest.approx(closure, rel=1e-9)
