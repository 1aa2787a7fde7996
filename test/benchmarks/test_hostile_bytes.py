"""Hostile bytes in a stream cost a framed decoder nothing but themselves, and tell of one."""

from __future__ import annotations

import pytest

from benchmarks.harness.fuzz import BoardSubject, FramedSubject, suffer_bytes
from tactile_ros.devices import framed_protocol
from tactile_ros.devices.framed_protocol import three_axis_chips


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
