"""Truth of a load cell on a clock of its own finds its frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.special import expit

from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.fleet import Job, associated
from tactile_ros.evaluation.survey import survey

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
    found = survey(bag, ['wrench'])
    delay = found['/cell/wrench']
    assert delay is not None
    assert delay.told
    assert delay.delay_ns - CLOCK_NS == pytest.approx(30e6, abs=0.2 * STEP_NS)
    assert delay.std_ns < 0.5 * STEP_NS
    assert delay.correlation > 0.9


def test_what_was_asked_for_goes_first(bag: Path) -> None:
    told = associated(bag, Job(str(bag), (), ('wrench',), 4_000_000, 7))
    assert (told.tolerance_ns, dict(told.delays)) == (4_000_000, {'/cell/wrench': 7})
    found = associated(bag, Job(str(bag), (), ('wrench',)))
    assert found.delays['/cell/wrench'] - CLOCK_NS == pytest.approx(30e6, abs=0.2 * STEP_NS)
    assert 'estimated: 5e+06 +- ' in found.known['/cell/wrench']


def test_truth_that_names_its_frames_has_no_delay(
    write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    assert survey(write_bag(tmp_path / 'bag'), ['truth/contacts']) == {}
