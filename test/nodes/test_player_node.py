# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows are recognised by order and content, also when some are lost or look alike."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from std_msgs.msg import Header

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import ReskinBoard
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.nodes import player_node as player
from tactile_ros.nodes.parameters import PlayerOptions
from tactile_ros.nodes.player_node import FrameMatcher, Playback, PlaybackCounts, Stopped
from tactile_ros.nodes.standard_messages import TruthMessages
from tactile_ros.types import Frame, Recording

PATIENCE_S = 120.0


class Echo:
    """Reads the port and tells the matcher which frames came, as the graph does."""

    def __init__(self, path: Path, recording: Recording) -> None:
        self.path, self.recording = path, recording
        self.board = ReskinBoard(str(path), recording.layout)
        self.matcher = FrameMatcher()
        self.rows: list[int] = []
        self.stop, self.deaf = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self) -> Echo:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.thread.join()
        self.board.close()

    def run(self) -> None:
        while not self.stop.is_set():
            try:
                frame = self.board.read(0.02)
            except DeviceTimeout:
                continue
            row = self.matcher.match(frame)
            if row is not None and not self.deaf.is_set():
                self.rows += [row] if row >= 0 else []
                self.matcher.acknowledge(frame.sequence)

    def playback(
        self,
        tare: Callable[[float], tuple[bool, str]] | None = None,
        missing: Callable[[], str] = str,
        **options: object,
    ) -> Playback:
        """Playback into the port, as fast as it goes."""
        chosen = {'patience_s': PATIENCE_S, 'speed_up': float('inf'), 'rate_hz': 1e6, 'window': 4}
        made = PlayerOptions(port=str(self.path), **{**chosen, **options})
        return Playback(self.recording, made, self.matcher, tare, missing)


@pytest.fixture
def short(touches: Recording) -> Recording:
    return touches.select(slice(0, 12))


@pytest.fixture
def echo(short: Recording, tmp_path: Path) -> Iterator[Echo]:
    with Echo(tmp_path / 'port', short) as running:
        yield running


def test_every_row_comes_back_and_every_rest_is_tared(echo: Echo) -> None:
    through, ends = [], []

    def tare(_: float) -> tuple[bool, str]:
        through.append(list(echo.rows))
        return len(through) != 2, 'not now'

    echo.playback(tare).play(ends.append)
    assert echo.rows == list(range(12))
    # each tare is asked for after its resting row went through, and before the touch is sent
    assert [rows[-1] for rows in through] == [0, 2, 4, 6, 8, 10]
    counts = ends[0]
    assert (counts.rows, counts.lost, counts.tares, counts.refused) == (12, 0, 5, 1)
    assert counts.refusal == 'not now'
    assert 'played 12 rows' in str(counts)
    assert not echo.path.is_symlink()


def test_rows_are_played_at_their_times(echo: Echo) -> None:
    begin = time.monotonic()
    echo.playback(rate_hz=200.0).play(print)
    assert time.monotonic() - begin >= 11 * 5e-3


def test_what_the_graph_lacks_is_said(echo: Echo, monkeypatch: pytest.MonkeyPatch) -> None:
    ahead = [0.0]
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + ahead[0])
    monkeypatch.setattr(player, 'time', clock)

    def missing() -> str:
        ahead[0] += PATIENCE_S  # only once the port is read, which takes a busy machine long
        return 'contact_node is missing'

    with pytest.raises(DeviceError, match='contact_node is missing'):
        echo.playback(missing=missing, patience_s=PATIENCE_S).play(print)


def test_a_port_that_nobody_reads_is_said(short: Recording, tmp_path: Path) -> None:
    unread = Echo(tmp_path / 'port', short)
    with pytest.raises(DeviceError, match='nobody opens the simulated port'):
        unread.playback(patience_s=0.2).play(print)


def test_a_graph_that_falls_silent_is_given_up(
    echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player, 'LOST_S', 0.02)

    def tare(_: float) -> tuple[bool, str]:
        echo.deaf.set()
        return True, ''

    with pytest.raises(DeviceError, match='did not come back'):
        echo.playback(tare).play(print)


def test_stop_ends_a_loop(echo: Echo) -> None:
    played = echo.playback(loop=True)
    rounds: list[PlaybackCounts] = []

    def count(counts: PlaybackCounts) -> None:
        rounds.append(counts)
        if len(rounds) == 2:
            echo.matcher.stop()

    with pytest.raises(Stopped):
        played.play(count)
    assert rounds[-1].rows == 24


def test_truth_of_tare_rows_is_untouched(short: Recording) -> None:
    truth = TruthMessages(short)
    rows = [truth.message(row, Header(), row) for row in range(len(short))]
    assert [row.in_contact for row in rows] == np.where(short.tare, 0, -1).tolist()
    contact = rows[1].contacts[0].position
    np.testing.assert_array_equal([contact.x, contact.y, contact.z], short.truth['position'][1])
    got = player.as_received(encode(short.values[0]))
    np.testing.assert_allclose(got, short.values[0], atol=1e-10)


def frame(sequence: int, value: float) -> Frame:
    return Frame(sequence, sequence, np.full((1, 1), value))


def sent(*values: float) -> FrameMatcher:
    matcher = FrameMatcher()
    for row, value in enumerate(values):
        matcher.send(10 + row, np.full((1, 1), value))
    return matcher


@pytest.mark.parametrize(
    ('values', 'returned', 'rows', 'lost'),
    [
        ((1, 1, 2), (1, 1, 2), [10, 11, 12], 0),
        ((1, 2, 3), (3, 3), [12, None], 2),
        ((1,), (5, 1), [None, 10], 0),
        ((np.nan,), (np.nan,), [10], 0),
    ],
    ids=['alike', 'lost', 'a stranger', 'nan'],
)
def test_matcher_knows_rows_by_order_and_content(
    values: tuple[float, ...], returned: tuple[float, ...], rows: list[int | None], lost: int
) -> None:
    matcher = sent(*values)
    assert [matcher.match(frame(7 + i, v)) for i, v in enumerate(returned)] == rows
    assert matcher.lost == lost


def test_through_needs_both_the_frame_and_the_acknowledgement() -> None:
    matcher = sent(1, 2)
    matcher.acknowledge(5)
    assert matcher.through == 0
    matcher.match(frame(5, 1))
    assert matcher.through == 1
    matcher.match(frame(6, 2))
    assert matcher.through == 1
    matcher.acknowledge(6)
    assert matcher.wait(2, 1.0)
