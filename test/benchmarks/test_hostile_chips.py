"""Random answers of chips through the whole driver, and that a driver that believes them shows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.harness.fuzz import suffer_answers
from tactile_ros.devices import fault_flags
from tactile_ros.types import TaxelStatus


@pytest.mark.parametrize('resolution', [2, 3])
def test_random_answers_beyond_the_range_are_marked(resolution: int) -> None:
    found = suffer_answers(1000, resolution, False, np.random.default_rng(1))
    assert found.strings >= 1000
    assert found.beyond == 0
    assert found.recovery_s < 5.0


def test_random_status_bytes_let_no_wrong_reading_pass() -> None:
    found = suffer_answers(1000, 3, True, np.random.default_rng(1))
    assert (found.beyond, found.wrong) == (0, 0)
    assert found.recovery_s < 0.5


def test_a_driver_that_marks_nothing_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        fault_flags.ChipFaultDetector,
        'status',
        lambda self, codes, values, good, fresh: np.where(good, 0, TaxelStatus.ERROR),
    )
    assert suffer_answers(1000, 3, False, np.random.default_rng(1)).beyond > 0
