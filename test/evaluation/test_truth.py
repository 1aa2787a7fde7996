"""Truth of a load cell on a clock of its own finds its frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.special import expit

from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.truth import Delay, associate, estimate_delay, truth_delays

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import SimpleNamespace

FRAMES, STEP_NS, START_NS = 1500, 10_000_000, 10**9
CLOCK_NS = 5_000_000_000_000  # by which the load cell's clock is ahead


def pressed(seconds: float) -> float:
    """Presses at uneven distances."""
    phase = seconds % 2.7
    return float(sum(expit((phase - a) / 0.02) * expit((a + 0.4 - phase) / 0.02)
                     for a in (0.3, 1.1, 1.8)))  # fmt: skip


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory, make: SimpleNamespace) -> Path:
    path = tmp_path_factory.mktemp('survey') / 'bag'
    rng = np.random.default_rng(1)
    with BagWriter(path) as writer:

        def put(topic: str, message: object, log_ns: int) -> None:
            writer.write(topic, message.__msgtype__, log_ns, make.cdr(message))

        put('/layout', make.layout(), START_NS)
        for k in range(FRAMES):
            stamp = START_NS + k * STEP_NS
            values = rng.normal(0, 1e-6, 15) + 1e-4 * pressed(k / 100)
            put('/frame', make.frame(k, values, stamp), stamp + 1_000_000)
            push = make.Vector3(x=0.0, y=0.0, z=2.0 * pressed(k / 100 - 0.03))
            wrench = make.Wrench(force=push, torque=push)
            late = make.header(stamp + CLOCK_NS)
            put('/cell/wrench', make.WrenchStamped(header=late, wrench=wrench), stamp + 1_000_000)
    return path


def test_the_delay_of_another_clock_is_told_with_its_uncertainty(bag: Path) -> None:
    found = truth_delays(bag, ['wrench'])
    delay = found['/cell/wrench']
    assert delay is not None
    assert delay.significant
    assert delay.delay_ns - CLOCK_NS == pytest.approx(30e6, abs=0.2 * STEP_NS)
    assert delay.std_ns < 0.5 * STEP_NS
    assert delay.correlation > 0.9


def test_what_was_asked_for_goes_first(bag: Path) -> None:
    told = associate(bag, ('wrench',), 4_000_000, 7)
    assert (told.tolerance_ns, dict(told.delays)) == (4_000_000, {'/cell/wrench': 7})
    found = associate(bag, ('wrench',), None, None)
    assert found.delays['/cell/wrench'] - CLOCK_NS == pytest.approx(30e6, abs=0.2 * STEP_NS)
    assert 'estimated: 5e+06 +- ' in found.remarks['/cell/wrench']


def test_truth_that_names_its_frames_has_no_delay(
    write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    assert truth_delays(write_bag(tmp_path / 'bag'), ['truth/contacts']) == {}


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
    assert found is not None
    error = abs(found.delay_ns * 1e-9 - late_s)
    assert error < 0.001
    assert error < 5 * found.std_ns * 1e-9
    assert found.significant == (late_s != 0.0)
    assert found.stretches >= 8


def test_signals_that_have_nothing_in_common_tell_nothing() -> None:
    assert read_delay(0.1, seed=1, noise=30.0) is None


def test_a_short_or_silent_recording_tells_nothing() -> None:
    times = np.arange(100, dtype=np.int64) * 10_000_000
    assert estimate_delay(times, np.zeros(100), times, np.zeros(100)) is None
    times = np.arange(5000, dtype=np.int64) * 10_000_000
    assert estimate_delay(times, np.zeros(5000), times, np.zeros(5000)) is None
