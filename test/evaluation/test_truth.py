# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Truth of a load cell on a clock of its own finds its frames."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from reference import made_bags as make
from tactile_ros.evaluation.recording_files import Bag
from tactile_ros.evaluation.truth import Association, Delay, estimate_delay
from tactile_ros.types import Recording

FRAMES, STEP_NS, START_NS = 1500, 10_000_000, 10**9
CLOCK_NS = 5_000_000_000_000  # by which the load cell's clock is ahead


def pressed(seconds: float) -> float:
    """Presses at uneven distances."""
    phase = seconds % 2.7
    return float(sum(expit((phase - a) / 0.02) * expit((a + 0.4 - phase) / 0.02)
                     for a in (0.3, 1.1, 1.8)))  # fmt: skip


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('survey') / 'bag'
    rng = np.random.default_rng(1)
    with make.Bag(path) as writer:
        writer.put('/layout', make.layout(), START_NS)
        for k in range(FRAMES):
            stamp = START_NS + k * STEP_NS
            values = rng.normal(0, 1e-6, 15) + 1e-4 * pressed(k / 100)
            writer.put('/frame', make.frame(k, values, stamp), stamp + 1_000_000)
            push = (0.0, 0.0, 2.0 * pressed(k / 100 - 0.03))
            wrench = make.wrench(stamp + CLOCK_NS, push, push)
            writer.put('/cell/wrench', wrench, stamp + 1_000_000)
    return path


def read_truth(path: Path, topic: str, association: Association) -> tuple[str, Recording]:
    """Sentence about a topic, and times of frames with truth."""
    bag = Bag(path, None, (topic,), association)
    assert len([*bag]) == 1
    (sensor,) = bag.sensors.values()
    recording = sensor.whole().recording
    (found,) = sensor.truth.values()
    return found.sentence, recording


def test_delay_of_another_clock_is_estimated_with_its_uncertainty(bag: Path) -> None:
    sentence, recording = read_truth(bag, 'wrench', Association(None, None))
    assert sentence.startswith('within 5 ms, 5e+06 ms late (estimated: 5e+06 +- ')
    std, correlation = re.search(r'\+- (\S+) ms .* correlation (\S+)\)', sentence).groups()
    assert float(std) < 0.5e-6 * STEP_NS
    assert float(correlation) > 0.9
    wanted = [2.0 * pressed(k / 100) for k in range(FRAMES - 3)]  # it is 30 ms late
    np.testing.assert_allclose(recording.truth['force'][:-3, 2], wanted, atol=1e-5)


def test_stated_delay_and_tolerance_go_first(bag: Path) -> None:
    asked = Association(4_000_000, CLOCK_NS + 7_000_000, ' as was said')
    sentence, recording = read_truth(bag, 'wrench', asked)
    assert sentence == 'within 4 ms, 5e+06 ms late as was said'
    wanted = [2.0 * pressed((k + 1) / 100 - 0.03) for k in range(FRAMES - 1)]
    np.testing.assert_allclose(recording.truth['force'][:-1, 2], wanted, atol=1e-5)
    _, recording = read_truth(bag, 'wrench', Association(4_000_000, CLOCK_NS + 5_000_000))
    assert 'force' not in recording.truth  # half a step from every frame


def test_truth_that_names_its_frames_has_no_delay(tmp_path: Path) -> None:
    path = make.write_bag(tmp_path / 'bag')
    assert read_truth(path, 'truth/contacts', Association(None, None))[0].endswith(', 0 ms late')


SECOND_NS = 1_000_000_000


def presses(times: np.ndarray) -> np.ndarray:
    """Presses of irregular length: smooth ramps, as a probe makes them (time in s)."""
    rng = np.random.default_rng(3)
    total = np.zeros(len(times))
    for at in np.cumsum(rng.uniform(0.6, 1.8, 60)):
        width = rng.uniform(0.1, 0.3)
        rise = expit((times - at) / 0.02)
        total += rng.uniform(0.5, 2) * rise * expit((at + width - times) / 0.02)
    return total


def read_delay(late_s: float, seed: int, noise: float = 0.05) -> Delay | None:
    rng = np.random.default_rng(seed)
    frames = np.arange(4000) * 0.01
    frames = frames + rng.uniform(0, 0.001, 4000)
    cell = np.arange(8000) * 0.005
    skin = presses(frames) + noise * rng.normal(size=4000)
    force = -3 * presses(cell - late_s) + noise * rng.normal(size=8000)
    return estimate_delay(
        (frames * SECOND_NS).astype(np.int64), skin, (cell * SECOND_NS).astype(np.int64), force
    )


@pytest.mark.parametrize('late_s', [-0.2, 0.0, 0.0137, 0.31])
def test_a_delay_is_found_to_within_what_it_claims(late_s: float) -> None:
    found = read_delay(late_s, seed=int(1000 * abs(late_s)))
    error = abs(found.delay_ns * 1e-9 - late_s)
    assert error < 0.001
    assert error < 5 * found.std_ns * 1e-9
    assert (abs(found.delay_ns) > 3 * found.std_ns) == (late_s != 0.0)
    assert found.stretches >= 8
