# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""How fast drivers are: the rows of the bench, short."""

from __future__ import annotations

import os

from benchmarks.harness.driver_speed import bus_rows, decoding_rows, memory_rows, resident_kib


def test_twenty_chips_use_the_bus() -> None:
    rows = {row.what: row for row in bus_rows()}
    assert len(rows) == 8
    for what, row in rows.items():
        assert row.ours is not None
        if row.aim is not None:
            assert row.ours >= row.aim, what
        assert row.bound is None or row.ours <= 1.001 * row.bound, what


def test_every_codec_is_timed_alone_and_among_many() -> None:
    rows = decoding_rows()
    assert len(rows) == 4
    assert all(row.ours is not None and 0 < row.ours < 1e4 for row in rows)
    assert sum(row.us_batch is not None for row in rows) == 3


def test_memory_is_watched_through_both_decoders() -> None:
    rows = memory_rows(20_000)
    assert [row.unit for row in rows] == ['KiB', 'KiB']
    assert all(row.ours is not None and row.ours < 4096 for row in rows)
    assert 1e3 < resident_kib() < 1e8
    assert resident_kib(os.getpid()) > 1e3
