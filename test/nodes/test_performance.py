"""Playing without ROS: a driver in a thread stands for the graph."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import ReskinBoard
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.nodes import player
from tactile_ros.nodes.player import Ledger, Performance, Score, Stopped, Tally
from tactile_ros.types import Recording

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S = 120.0


class Echo:
    """Reads the port and tells the ledger what came, as the graph does."""

    def __init__(self, path: Path, recording: Recording, ledger: Ledger) -> None:
        self.board = ReskinBoard(str(path), recording.layout)
        self.ledger = ledger
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
            row = self.ledger.match(frame)
            if row is not None and not self.deaf.is_set():
                self.rows += [row] if row >= 0 else []
                self.ledger.acknowledge(frame.sequence)


@pytest.fixture
def short(touches: Recording) -> Recording:
    return touches.select(slice(0, 12))


@pytest.fixture
def echo(short: Recording, tmp_path: Path) -> Iterator[Echo]:
    with Echo(tmp_path / 'port', short, Ledger()) as running:
        yield running


def score_of(short: Recording, tmp_path: Path, patience_s: float = 10.0) -> Score:
    return Score(short, str(tmp_path / 'port'), float('inf'), 1e6, 4, patience_s)


def test_every_row_comes_back_and_every_rest_is_tared(
    short: Recording, tmp_path: Path, echo: Echo
) -> None:
    through, tallies = [], []

    def tare(_: float) -> tuple[bool, str]:
        through.append(list(echo.rows))
        return len(through) != 2, 'not now'

    played = Performance(score_of(short, tmp_path), echo.ledger, tare, lambda: '')
    played.play(loop=False, on_end=tallies.append)
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

    played = Performance(score_of(short, tmp_path, PATIENCE_S), echo.ledger, None, missing)
    with pytest.raises(DeviceError, match='contact_node is missing'):
        played.play(loop=False, on_end=print)


def test_a_port_that_nobody_reads_is_said(short: Recording, tmp_path: Path) -> None:
    played = Performance(score_of(short, tmp_path, 0.2), Ledger(), None, lambda: '')
    with pytest.raises(DeviceError, match='nobody opens the simulated port'):
        played.play(loop=False, on_end=print)


def test_a_graph_that_falls_silent_is_given_up(
    short: Recording, tmp_path: Path, echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player, 'LOST_S', 0.02)

    def tare(_: float) -> tuple[bool, str]:
        echo.deaf.set()
        return True, ''

    played = Performance(score_of(short, tmp_path), echo.ledger, tare, lambda: '')
    with pytest.raises(DeviceError, match='did not come back'):
        played.play(loop=False, on_end=print)


def test_stop_ends_a_loop(short: Recording, tmp_path: Path, echo: Echo) -> None:
    played = Performance(score_of(short, tmp_path), echo.ledger, None, lambda: '')
    rounds: list[Tally] = []

    def count(tally: Tally) -> None:
        rounds.append(tally)
        if len(rounds) == 2:
            played.stop()

    with pytest.raises(Stopped):
        played.play(loop=True, on_end=count)
    assert rounds[-1].rows == 24


def test_truth_of_tare_rows_is_untouched(short: Recording) -> None:
    states = player.truth_states(short)
    assert states.in_contact[short.tare].tolist() == [0] * 6
    assert states.in_contact[~short.tare].tolist() == [-1] * 6
    np.testing.assert_array_equal(states.position, short.truth['position'])


def test_runs_of_resting_rows() -> None:
    tare = np.array([True, True, False, True, False, False])
    assert player.runs(tare) == [(0, 2, True), (2, 3, False), (3, 4, True), (4, 6, False)]
    assert player.runs(np.zeros(0, bool)) == []


def test_values_as_the_driver_reads_them(short: Recording) -> None:
    got = player.as_received(encode(short.values[0]))
    np.testing.assert_allclose(got, short.values[0], atol=1e-10)
