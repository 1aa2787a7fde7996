"""Levels and sentences of a sensor's diagnostics, and the aggregator's file against them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.mock_hand import MockHandNode
from tactile_ros.nodes.player import PlayerNode
from tactile_ros.nodes.record import RecordNode
from tactile_ros.nodes.sensor_node import (
    NOT_MEASURED,
    Health,
    Reading,
    SensorNode,
    pace,
    temperatures,
)
from tactile_ros.types import Frame, TaxelStatus

if TYPE_CHECKING:
    from conftest import Ros

AGGREGATOR = Path(__file__).parents[2] / 'config' / 'diagnostics.yaml'
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)


def frames(reading: Reading, count: int, period_s: float = 0.01, status: int = 0) -> None:
    """Let frames come."""
    bits = np.array([0, status], np.uint8) if status else None
    for _ in range(count):
        k = reading.frames
        reading.note(Frame(round(k * period_s * 1e9), k, np.zeros((2, 3)), status=bits))
    reading.sentence = ''


def test_regular_frames_are_well() -> None:
    health, reading = Health(100.0), Reading()
    frames(reading, 100)
    level, message, values = health.judge(reading, {'dropped': 0}, is_open=True)
    assert (level, message) == (OK, '100 frames in the last second')
    assert values['rate (Hz)'] == pytest.approx(100.0)
    assert values['jitter (ms)'] == pytest.approx(0.0, abs=1e-6)
    assert values['connection'] == 'streaming'
    assert values['crc_errors'] == 'not in this protocol'
    assert values['dropped'] == 0


def test_trouble_of_the_last_second_warns_and_is_forgotten() -> None:
    health, reading = Health(100.0), Reading()
    frames(reading, 50)
    frames(reading, 50, status=TaxelStatus.STUCK | TaxelStatus.SATURATED)
    level, message, values = health.judge(reading, {'crc_errors': 2}, is_open=True)
    assert level == WARN
    assert message.endswith('; saturated taxels; stuck taxels; 2 crc errors')
    assert values['stuck taxels'] == [1]
    frames(reading, 100)
    assert health.judge(reading, {'crc_errors': 2}, is_open=True)[0] == OK


def test_slow_and_irregular_frames_warn() -> None:
    health, reading = Health(100.0), Reading()
    frames(reading, 50, 0.02)
    level, message, _ = health.judge(reading, {}, is_open=True)
    assert (level, message) == (WARN, '50 frames in the last second; 50 Hz instead of 100 Hz')
    jumpy = Reading()
    for k, stamp in enumerate(np.cumsum([0.001, 0.019] * 50)):
        jumpy.note(Frame(round(stamp * 1e9), k, np.zeros((2, 3))))
    jumpy.sentence = ''
    level, message, _ = Health(100.0).judge(jumpy, {}, is_open=True)
    assert level == WARN
    assert 'irregularly: jitter 9 ms' in message


def test_silence_is_an_error_with_its_reason() -> None:
    health, reading = Health(100.0), Reading()
    reading.sentence = 'port x was unplugged; trying again'
    level, message, values = health.judge(reading, {}, is_open=True)
    assert (level, message) == (ERROR, 'port x was unplugged; trying again')
    assert values['connection'] == 'silent'
    assert health.judge(reading, {}, is_open=False)[2]['connection'] == 'not open'


def test_what_waits_for_its_listeners_is_stale() -> None:
    reading = Reading(waiting=True)
    level, message, _ = Health(100.0).judge(reading, {}, is_open=True)
    assert level == STALE
    assert 'listeners' in message


def test_pace_of_few_frames_is_unknown() -> None:
    assert np.isnan(pace([]).rate_hz)
    assert np.isnan(pace([5]).rate_hz)
    assert pace([0, 10_000_000]).rate_hz == pytest.approx(100.0)
    assert np.isnan(pace([0, 10_000_000]).jitter_s)


def test_temperatures_are_the_extremes_or_not_measured() -> None:
    warm = Frame(0, 0, np.zeros((2, 3)), np.array([31.0, np.nan]))
    assert list(temperatures(warm).values()) == [31.0, 31.0]
    assert set(temperatures(Frame(0, 0, np.zeros((2, 3)))).values()) == {NOT_MEASURED}
    assert set(temperatures(None).values()) == {NOT_MEASURED}


def analyzers() -> dict[str, dict[str, object]]:
    parameters = yaml.safe_load(AGGREGATOR.read_text())['analyzers']['ros__parameters']
    return {name: x for name, x in parameters.items() if isinstance(x, dict)}


@pytest.mark.parametrize('space', ['', 'hand/thumb'])
def test_the_aggregator_sorts_every_name_that_is_published(
    ros: Ros, space: str, tmp_path: Path
) -> None:
    arguments = [f'bag:={tmp_path}/bag', 'simulated:=true', 'recording:=spatial',
                 f'port:={tmp_path}/board', 'tare:=false', 'hand:=qb_softhand']  # fmt: skip
    ros.init(*arguments, remaps=[f'__ns:=/{space}'] if space else [])
    nodes = [ContactNode(), SensorNode(), RecordNode(), PlayerNode(), MockHandNode(), GripNode()]
    for node in nodes:
        ros.add(node)
    heard: dict[str, DiagnosticStatus] = {}
    listener = ros.add(Node('diagnostics_listener'))
    listener.create_subscription(
        DiagnosticArray, '/diagnostics', lambda m: heard.update({s.name: s for s in m.status}), 10
    )
    lifecycle.start(nodes)
    assert ros.until(lambda: len(heard) == len(nodes))
    for name in heard:
        matches = [
            key
            for key, analyzer in analyzers().items()
            if any(word in name for word in analyzer['contains'])
        ]
        assert len(matches) == 1, name
    words = {word for analyzer in analyzers().values() for word in analyzer['contains']}
    assert {word for word in words if any(word in name for name in heard)} == words
    for analyzer in analyzers().values():
        assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
        assert analyzer['timeout'] > lifecycle.DIAGNOSTICS_PERIOD_S
