"""Rows are recognised by order and content, also when some are lost or look alike."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S = 120.0


class Echo:
    """Reads the port and tells the matcher which frames came, as the graph does."""

    def __init__(self, path: Path, recording: Recording, matcher: FrameMatcher) -> None:
        self.board = ReskinBoard(str(path), recording.layout)
        self.matcher = matcher
        self.rows: list[int] = []
        self.stop = threading.Event()
        self.deaf = threading.Event()
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


@pytest.fixture
def short(touches: Recording) -> Recording:
    return touches.select(slice(0, 12))


@pytest.fixture
def echo(short: Recording, tmp_path: Path) -> Iterator[Echo]:
    with Echo(tmp_path / 'port', short, FrameMatcher()) as running:
        yield running


def options_of(tmp_path: Path, patience_s: float = 10.0, loop: bool = False) -> PlayerOptions:
    return PlayerOptions(
        port=str(tmp_path / 'port'), speed_up=float('inf'), rate_hz=1e6, window=4,
        patience_s=patience_s, loop=loop,
    )  # fmt: skip


def test_every_row_comes_back_and_every_rest_is_tared(
    short: Recording, tmp_path: Path, echo: Echo
) -> None:
    through, tallies = [], []

    def tare(_: float) -> tuple[bool, str]:
        through.append(list(echo.rows))
        return len(through) != 2, 'not now'

    played = Playback(short, options_of(tmp_path), echo.matcher, tare, lambda: '')
    played.play(tallies.append)
    assert echo.rows == list(range(12))
    # each tare is asked for after its resting row went through, and before the touch is sent
    assert [rows[-1] for rows in through] == [0, 2, 4, 6, 8, 10]
    tally = tallies[0]
    assert (tally.rows, tally.lost, tally.tares, tally.refused) == (12, 0, 5, 1)
    assert tally.refusal == 'not now'
    assert 'played 12 rows' in str(tally)
    assert not (tmp_path / 'port').is_symlink()


def test_what_the_graph_lacks_is_said(
    short: Recording, tmp_path: Path, echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead = [0.0]
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + ahead[0])
    monkeypatch.setattr(player, 'time', clock)

    def missing() -> str:
        ahead[0] += PATIENCE_S  # only once the port is read, which takes a busy machine long
        return 'contact_node is missing'

    played = Playback(short, options_of(tmp_path, PATIENCE_S), echo.matcher, None, missing)
    with pytest.raises(DeviceError, match='contact_node is missing'):
        played.play(print)


def test_a_port_that_nobody_reads_is_said(short: Recording, tmp_path: Path) -> None:
    played = Playback(short, options_of(tmp_path, 0.2), FrameMatcher(), None, lambda: '')
    with pytest.raises(DeviceError, match='nobody opens the simulated port'):
        played.play(print)


def test_a_graph_that_falls_silent_is_given_up(
    short: Recording, tmp_path: Path, echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player, 'LOST_S', 0.02)

    def tare(_: float) -> tuple[bool, str]:
        echo.deaf.set()
        return True, ''

    played = Playback(short, options_of(tmp_path), echo.matcher, tare, lambda: '')
    with pytest.raises(DeviceError, match='did not come back'):
        played.play(print)


def test_stop_ends_a_loop(short: Recording, tmp_path: Path, echo: Echo) -> None:
    played = Playback(short, options_of(tmp_path, loop=True), echo.matcher, None, lambda: '')
    rounds: list[PlaybackCounts] = []

    def count(tally: PlaybackCounts) -> None:
        rounds.append(tally)
        if len(rounds) == 2:
            played.stop()

    with pytest.raises(Stopped):
        played.play(count)
    assert rounds[-1].rows == 24


def test_truth_of_tare_rows_is_untouched(short: Recording) -> None:
    truth = TruthMessages(short)
    rows = [truth.message(row, Header(), row) for row in range(len(short))]
    assert [rows[row].in_contact for row in np.flatnonzero(short.tare)] == [0] * 6
    assert [rows[row].in_contact for row in np.flatnonzero(~short.tare)] == [-1] * 6
    contact = rows[1].contacts[0].position
    np.testing.assert_array_equal([contact.x, contact.y, contact.z], short.truth['position'][1])


def test_runs_of_resting_rows() -> None:
    tare = np.array([True, True, False, True, False, False])
    assert player.runs(tare) == [(0, 2, True), (2, 3, False), (3, 4, True), (4, 6, False)]
    assert player.runs(np.zeros(0, bool)) == []


def test_values_as_the_driver_reads_them(short: Recording) -> None:
    got = player.as_received(encode(short.values[0]))
    np.testing.assert_allclose(got, short.values[0], atol=1e-10)


def frame(sequence: int, value: float) -> Frame:
    return Frame(sequence, sequence, np.full((1, 1), value))


def sent(*values: float) -> FrameMatcher:
    matcher = FrameMatcher()
    for row, value in enumerate(values):
        matcher.send(10 + row, np.full((1, 1), value))
    return matcher


def never() -> bool:
    return False


def test_rows_come_back_in_order_also_alike() -> None:
    matcher = sent(1, 1, 2)
    assert [matcher.match(frame(7 + i, v)) for i, v in enumerate((1, 1, 2))] == [10, 11, 12]
    assert matcher.lost == 0


def test_a_lost_row_is_counted_and_skipped() -> None:
    matcher = sent(1, 2, 3)
    assert matcher.match(frame(0, 3)) == 12
    assert matcher.lost == 2
    assert matcher.match(frame(1, 3)) is None


def test_a_stranger_is_no_row() -> None:
    matcher = sent(1)
    assert matcher.match(frame(0, 5)) is None
    assert matcher.match(frame(1, 1)) == 10


def test_nan_is_recognised() -> None:
    matcher = sent(np.nan)
    assert matcher.match(frame(0, np.nan)) == 10


def test_through_needs_both_the_frame_and_the_acknowledgement() -> None:
    matcher = sent(1, 2)
    matcher.acknowledge(5)
    assert not matcher.is_through(0)
    matcher.match(frame(5, 1))
    assert matcher.is_through(0)
    matcher.match(frame(6, 2))
    assert not matcher.is_through(1)
    matcher.acknowledge(6)
    assert matcher.wait(1, 1.0, never)


def test_waiting_ends_by_time_by_stop_and_by_giving_up() -> None:
    matcher = sent(1)
    assert not matcher.wait(0, 0.01, never)
    stop = threading.Event()
    threading.Timer(0.02, lambda: (stop.set(), matcher.wake())).start()
    assert not matcher.wait(0, 5.0, stop.is_set)
    assert matcher.give_up() == 1
    assert matcher.lost == 1
    assert matcher.wait(0, 0.0, never)
