# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""How fast drivers are: chips on simulated buses, decoding, memory over many frames.

Buses are on a virtual clock; decoding and memory are this machine's.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.fuzz import PIECE, cut
from benchmarks.harness.rows import Row, shortest
from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.framed_protocol import (
    FramedDecoder,
    Kind,
    Payload,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, Decoder, clusters
from tactile_ros.devices.reskin_protocol import ReskinDecoder
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.types import Layout

if TYPE_CHECKING:
    from tactile_ros.devices.chip_array import Mode

CHUNK, REPEATED = 1000, 50
PAGE_KIB = os.sysconf('SC_PAGE_SIZE') / 1024


def bus_rows() -> list[Row]:
    """Twenty chips on one bus of 400 kHz, with and without a switch, on the virtual clock."""
    wirings = {
        'behind a switch': clusters(),
        'on one bus without a switch': [ChipPlace(0x0C + i) for i in range(20)],
    }
    aims = {'single': 104.0, 'burst': 180.0}
    rows: list[Row] = []
    for name, places in wirings.items():
        for mode, aim in aims.items():
            share, rate = _bus(places, 'burst' if mode == 'burst' else 'single')
            what = f'20 chips {name}, {mode}'
            rows += [
                Row(f'{what}: share of the limit of the bus', '1', share, 'high', bound=1.0,
                    aim=0.9),
                Row(f'{what}: rate', 'Hz', rate, 'high', bound=rate / share,
                    aim=None if 'behind' in name else aim),
            ]  # fmt: skip
    return rows


def _bus(places: list[ChipPlace], mode: Mode) -> tuple[float, float]:
    """Share of the time that bytes are on the wire, and frames per second."""
    clock = VirtualClock()
    layout = Layout(np.zeros((20, 3)), ('Bx', 'By', 'Bz'), 'T')
    twin = ChipArrayTwin(places, layout, lambda t: np.full((20, 3), 1e-3), mode=mode, clock=clock)
    with twin, twin.device(clock.now_ns) as array:
        begun_ns, busy_s = clock.now_ns(), twin.buses[0].busy_s
        for _ in range(200):
            array.read(1.0)
        elapsed_s = (clock.now_ns() - begun_ns) * 1e-9
        return (twin.buses[0].busy_s - busy_s) / elapsed_s, 200 / elapsed_s


def decoding_rows() -> list[Row]:
    """Time to decode one frame, alone and among many; a row for each codec."""
    settings = ChipSettings()
    chips = Decoder(settings, np.zeros(20))
    answers = bytearray(np.random.default_rng(0).bytes(20 * settings.answer_bytes))
    alone = shortest(lambda: _decode(chips, answers), REPEATED)
    rows = [_time_row('MLX90393 answers, 20 chips', 20.0, alone)]
    subjects: list[tuple[str, float, bytes, int, FramedDecoder | ReskinDecoder]] = []
    for name, payload, aim in (
        ('framed, 20 chips', three_axis_chips(20), 20.0),
        ('framed, 2000 taxels', taxel_matrix(2000), 100.0),
    ):
        data, size = _stream(payload, 256)
        subjects.append((name, aim, data, size, FramedDecoder(payload)))
    values = np.random.default_rng(0).integers(-2500, 2500, (256, 20, 3)) * 2.4e-6
    data = reskin_protocol.encode(values, np.full((256, 20), 25.0))
    size = reskin_protocol.frame_bytes(20)
    subjects.append(('ReSkin, 20 chips', 20.0, data, size, ReskinDecoder(20)))
    for name, aim, stream, size, decoder in subjects:
        pieces = cut(stream, size)
        single = shortest(partial(_feed, decoder, pieces), REPEATED) / len(pieces)
        batch = shortest(partial(_feed, decoder, [stream]), REPEATED) / len(pieces)
        rows.append(_time_row(name, aim, single, batch))
    return rows


def _feed(decoder: FramedDecoder | ReskinDecoder, pieces: list[bytes]) -> None:
    """Frames, in so many pieces."""
    for piece in pieces:
        decoder.feed(piece)


def _decode(decoder: Decoder, answers: bytearray) -> None:
    """One frame of chips."""
    decoder.values(decoder.words(answers)[1])


def _time_row(name: str, aim: float, single: float, batch: float | None = None) -> Row:
    """Time of a frame that comes alone and of one among many (s)."""
    many = None if batch is None else 1e6 * batch
    return Row(f'decode a frame: {name}', 'us', 1e6 * single, aim=aim, us_single=1e6 * single,
               us_batch=many)  # fmt: skip


def _stream(payload: Payload, count: int) -> tuple[bytes, int]:
    """Frames of random counts, and the length of one."""
    high = 1023 if payload.kind == Kind.TAXELS else 30_000
    counts = np.random.default_rng(0).integers(0, high, (count, payload.count, payload.channels))
    data = framed_protocol.encode(payload, counts, 0, np.arange(count) * 1000, 25.0)
    return data, framed_protocol.frame_bytes(payload)


def processor_s(pid: int) -> float:
    """User and system time of a process so far (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def resident_kib(pid: str | int = 'self') -> float:
    """Resident memory of a process (KiB)."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE_KIB


def memory_rows(count: int) -> list[Row]:
    """Growth of memory over `count` frames, one in 32 of them damaged, through each decoder."""
    data, size = _stream(gradiometer(), CHUNK)
    values = np.random.default_rng(0).integers(-2500, 2500, (CHUNK, 5, 3)) * 2.4e-6
    board = reskin_protocol.encode(values, np.full((CHUNK, 5), 25.0))
    rows = []
    for name, decoder, stream, length in (
        ('framed', FramedDecoder(gradiometer()), data, size),
        ('ReSkin', ReskinDecoder(5), board, reskin_protocol.frame_bytes(5)),
    ):
        hurt = bytearray(stream)
        hurt[:: 32 * length] = bytes(b ^ 4 for b in hurt[:: 32 * length])
        grown = _growth(decoder, bytes(hurt), count)
        what = f'memory grown over {count} frames, {name} decoder'
        rows.append(Row(what, 'KiB', grown, bound=0.0, aim=1024.0))
    return rows


def _growth(decoder: FramedDecoder | ReskinDecoder, stream: bytes, count: int) -> float:
    """Growth of resident memory after the first tenth (KiB)."""
    passes = count // CHUNK
    before = 0.0
    for i in range(passes):
        if i == passes // 10:
            before = resident_kib()
        for piece in cut(stream, PIECE):
            decoder.feed(piece)
    return resident_kib() - before
