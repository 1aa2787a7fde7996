# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Decoders and chips under random and damaged bytes."""

import numpy as np
import pytest

from benchmarks.harness.fuzz import BoardSubject, FramedSubject, suffer_answers, suffer_bytes
from tactile_ros.devices import fault_flags, framed_protocol
from tactile_ros.devices.framed_protocol import three_axis_chips
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


def test_a_framed_decoder_delivers_nothing_wrong() -> None:
    found = suffer_bytes(FramedSubject(three_axis_chips(5)), 1000, 1)
    assert (found.strings, found.wrong, found.lost) == (1000, 0, 0)
    assert found.held < 200


def test_a_format_without_checksum_is_seen_to_believe_some() -> None:
    found = suffer_bytes(BoardSubject(5), 1000, 1)
    assert 0 < found.wrong < 500
    assert found.lost <= 1


def test_a_decoder_without_its_crc_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(framed_protocol.zlib, 'crc32', lambda data: framed_protocol.RESIDUE)
    assert suffer_bytes(FramedSubject(three_axis_chips(5)), 1000, 1).wrong > 0
