# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Lines of numbers: what is read as one, what is not, and that nothing hostile hangs."""

import time

import numpy as np
import pytest

from tactile_ros.devices.connections import LineConnection, open_lines
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.devices.text_lines import MOST_LINES, LineDecoder, encode
from tactile_ros.errors import DeviceTimeout
from tactile_ros.types import Layout, TaxelStatus

GOOD = b'1,2,3\r\n'


def decoder_of(*data: bytes, count: int = 3) -> tuple[LineDecoder, list[list[float]], list[int]]:
    """A decoder that was fed, its lines, and the losses before each."""
    decoder = LineDecoder(count)
    fed = [decoder.feed(part) for part in data]
    numbers = [row for decoded in fed for row in decoded.numbers.tolist()]
    return decoder, numbers, [loss for decoded in fed for loss in decoded.lost]


@pytest.mark.parametrize(
    'line',
    [
        b'1,2,3\n', b'1, 2, 3\r\n', b'1 2 3\n', b'1\t2\t3\n', b'1;2;3\r\n', b' 1.0 2e0 +3 \n',
        b'fsr,1,2,3\n', b'FSR: 1 2 3\n', b'FSR:1,2,3\n', b'81230\t1\t2\t3\n', b'12:30:05,1,2,3\n',
    ],
)  # fmt: skip
def test_decoder_reads_what_boards_print(line: bytes) -> None:
    decoder, numbers, lost = decoder_of(b'3\n' + line * 3)
    assert numbers == [[1.0, 2.0, 3.0]] * 3
    assert lost == [0, 0, 0]
    assert decoder.counts.malformed == 0


@pytest.mark.parametrize(
    'line',
    [
        b'nan,2,3\n', b'1,inf,3\n', b'1e999,2,3\n', b'1,2,0x3\n', b'1_0,2,3\n', b'1,,3\n',
        b'1,2\n', b'1,2,3,4,5\n', b'1,2,\xb2\n', b'\xff,1,2,3\n', b'1,2,3-\n', b'ready\n',
        b'1,2,3,a\n', b'7,1,2,3\n', b'\x00\x00\x00\n',
    ],
)  # fmt: skip
def test_decoder_counts_what_it_cannot_read_as_lost(line: bytes) -> None:
    decoder, numbers, lost = decoder_of(b'\n' + GOOD + line + GOOD)
    assert numbers == [[1.0, 2.0, 3.0]] * 2
    assert lost == [0, max(1, round(len(line) / len(GOOD)))]
    assert decoder.counts.malformed == 1
    assert decoder.last.isprintable()


def test_decoder_gives_the_same_however_the_bytes_are_cut() -> None:
    data = b'3\n' + GOOD + b'broken\n4,5' + b',6\n' + GOOD * 3
    _, whole, lost = decoder_of(data)
    assert len(whole) == 5
    for size in (1, 2, 3, 7):
        parts = [data[i : i + size] for i in range(0, len(data), size)]
        assert decoder_of(*parts)[1:] == (whole, lost)


def test_decoder_believes_another_column_when_it_comes_twice() -> None:
    _, numbers, lost = decoder_of(b'\n' + GOOD + b'9,4,5,6\n9,4,5,6\n9,4,5,6\n4,5,6\n9,4,5,6\n')
    assert numbers == [[1, 2, 3], [4, 5, 6], [4, 5, 6], [4, 5, 6]]
    assert sum(lost) == 2


def test_decoder_leaves_out_the_first_line_after_a_reset() -> None:
    decoder, numbers, _ = decoder_of(b'5,6,7\n' + GOOD + b'1,2')
    assert numbers == [[1.0, 2.0, 3.0]]
    decoder.reset()
    again = decoder.feed(b',3\n' + GOOD)
    assert again.lost == [0]


def test_decoder_outlives_a_million_bytes_without_an_end() -> None:
    decoder, _, _ = decoder_of(b'\n' + GOOD)
    began = time.process_time()
    for _ in range(256):
        decoder.feed(b'1,' * 2048)
        assert len(decoder._rest) <= MOST_LINES * decoder.size
    assert decoder.feed(b'\n' + GOOD).lost == [round(MOST_LINES * decoder.size / len(GOOD))]
    assert decoder.feed(b'1 ' * 500_000 + b'\n' + GOOD).numbers.tolist() == [[1, 2, 3]]
    assert decoder.counts.malformed == 2
    assert time.process_time() - began < 10.0


def test_encode_prints_a_line_that_is_read_back() -> None:
    values = np.array([[-0.004, 12.346], [0.5, 1e6]])
    line = encode(values, 2)
    assert line == b'0.00,12.35,0.50,1000000.00\r\n'
    assert decoder_of(b'\n' + line, count=4)[1] == [[0.0, 12.35, 0.5, 1e6]]


def test_board_without_a_sensor_is_read_with_scale() -> None:
    layout = Layout(np.zeros((4, 3)), ('reading',), '1', rate_hz=50.0)
    half = LineConnection(scale=1 / 1023).simulate(layout, lambda t: np.full((4, 1), 0.5), 0, 0)
    with half as twin, open_lines(twin.port, 4, scale=1 / 1023) as board:  # type: ignore[attr-defined]
        frames = [board.read(60.0) for _ in range(3)]
    for frame in frames:
        np.testing.assert_allclose(frame.values, 0.5, atol=0.51 / 1023)
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    assert frames[-1].dropped == 0


def test_board_marks_its_limit_and_shows_a_line_that_it_cannot_read() -> None:
    with SimulatedSerialPort() as port, open_lines(port.port, 2) as board:
        port.send(b'\nwarming up \xb0C\n')
        with pytest.raises(DeviceTimeout, match=r"no line of 2 numbers .*'warming up \\xb0C'$"):
            board.read(0.1)
        port.send(b'1,2\n')
        assert board.read(60.0).status is None
        assert board.counters()['malformed'] == 1
    limited = LineConnection().simulate(
        Layout(np.zeros((2, 3)), ('c',), '1', saturation=np.array([9.0]), rate_hz=50.0),
        lambda t: np.array([[9.0], [1.0]]), 0.0, 0,
    )  # fmt: skip
    with limited as twin, twin.device(time.monotonic_ns) as device:
        status = device.read(60.0).status
    assert status.tolist() == [TaxelStatus.SATURATED, 0]


def test_connection_refuses_a_scale_of_nothing() -> None:
    with pytest.raises(ValueError, match='scale of LineConnection must not be 0'):
        LineConnection(scale=0.0)
    with pytest.raises(ValueError, match='scale of LineConnection must be a number'):
        LineConnection(scale=float('nan'))
