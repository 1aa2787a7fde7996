# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a client hears of its grasp: at once, then as often as it can use, and the end once."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.action import Grasp
from tactile_ros.control import GraspOutcome, GraspProgress, GripPhase
from tactile_ros.nodes import grasp_server
from tactile_ros.nodes.grasp_server import FEEDBACK_S, GraspServer

STEP_S = 1e-3  # between decisions


class Handle:
    """A goal as rclpy hands it over."""

    def __init__(self, number: int) -> None:
        self.request = Grasp.Goal(target_force=2.0)
        self.goal_id = SimpleNamespace(uuid=bytes([number]))
        self.is_cancel_requested = False
        self.feedback: list[Grasp.Feedback] = []
        self.publish_feedback = self.feedback.append
        self.executed = 0

    def execute(self) -> None:
        self.executed += 1


class Clock:
    """Time of a machine that stands still between two steps (s)."""

    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(grasp_server, 'time', clock)
    monkeypatch.setattr(grasp_server, 'ActionServer', lambda *_, **__: None)
    return clock


@pytest.fixture
def server(clock: Clock) -> GraspServer:
    return GraspServer(SimpleNamespace(), lambda _: '', lambda _: None, lambda: None)


def decision(force: float, ended: GraspProgress | None = None) -> SimpleNamespace:
    made = SimpleNamespace(
        phase=GripPhase.CLOSE, force=np.array([force]), slip_margin=np.array([math.nan, 0.5])
    )
    return SimpleNamespace(made=made, ended=ended)


def told(server: GraspServer, clock: Clock, handle: Handle, steps: int) -> list[float]:
    """Times (s) after the first step at which feedback came, while every step is told."""
    begin, found = clock.now_s, []
    for step in range(steps):
        before = len(handle.feedback)
        server.note(decision(float(step)))
        server.tell()
        if len(handle.feedback) > before:
            found.append(clock.now_s - begin)
            assert handle.feedback[-1].force[0] == step  # the newest
        clock.now_s += STEP_S
    return found


def test_feedback_comes_at_once_and_then_no_oftener_than_its_period(
    server: GraspServer, clock: Clock
) -> None:
    handle = Handle(1)
    server._on_accepted(handle)
    times = np.array(told(server, clock, handle, 100))
    assert times[0] == 0.0
    assert np.diff(times).min() >= FEEDBACK_S - 1e-9
    assert np.diff(times).max() <= FEEDBACK_S + 1.5 * STEP_S
    assert handle.feedback[0].slip_margin == 0.5


def test_a_new_goal_hears_at_once_however_lately_the_last_was_told(
    server: GraspServer, clock: Clock
) -> None:
    first, second = Handle(1), Handle(2)
    server._on_accepted(first)
    assert told(server, clock, first, 2) == [0.0]
    server._on_accepted(second)
    assert first.executed == 1
    assert told(server, clock, second, 2) == [0.0]
    assert len(first.feedback) == 1


def test_an_end_waits_for_no_period_and_is_told_once(server: GraspServer, clock: Clock) -> None:
    handle = Handle(1)
    server._on_accepted(handle)
    assert told(server, clock, handle, 2) == [0.0]
    server.note(decision(2.0, GraspProgress(GraspOutcome.HELD, 'held')))
    server.note(decision(2.1))  # steps go on before the executor has its turn
    server.tell()
    assert (handle.executed, server.is_busy) == (1, False)
    ending, result = server._ends[b'\x01']
    assert (ending, result.outcome, list(result.force)) == ('succeed', Grasp.Result.HELD, [2.0])
    server.tell()
    assert (handle.executed, len(handle.feedback)) == (1, 1)
