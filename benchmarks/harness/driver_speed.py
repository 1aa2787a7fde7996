# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Speed of drivers: chips on simulated buses, decoding, memory over many frames.

Buses are on a virtual clock; decoding and memory are this machine's.
"""

from functools import partial

import numpy as np

from benchmarks.harness.fuzz import PIECE, cut
from benchmarks.harness.live import resident_kib
from benchmarks.harness.rows import Row, shortest
from reference.wires import clusters
from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.chip_array import Mode
from tactile_ros.devices.framed_protocol import (
    FramedDecoder,
    Kind,
    Payload,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, Decoder
from tactile_ros.devices.reskin_protocol import ReskinDecoder
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.types import Layout

CHUNK, REPEATED, FRAMES = 1000, 20, 200
AIMS: dict[Mode, float] = {'single': 104.0, 'burst': 180.0}


def bus_rows() -> list[Row]:
    """Twenty chips on one bus of 400 kHz, with and without a switch, on the virtual clock."""
    wirings = {
        'behind a switch': clusters(),
        'on one bus without a switch': [ChipPlace(0x0C + i) for i in range(20)],
    }
    rows = []
    for name, places in wirings.items():
        for mode, aim in AIMS.items():
            share, rate = _bus(places, mode)
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
        for _ in range(FRAMES):
            array.read(1.0)
        elapsed_s = (clock.now_ns() - begun_ns) * 1e-9
        return (twin.buses[0].busy_s - busy_s) / elapsed_s, FRAMES / elapsed_s


def _framed(payload: Payload, count: int) -> tuple[FramedDecoder, bytes, int]:
    """A decoder, frames of random counts, and the length of one."""
    high = 1023 if payload.kind == Kind.TAXELS else 30_000
    counts = np.random.default_rng(0).integers(0, high, (count, payload.count, payload.channels))
    data = framed_protocol.encode(payload, counts, 0, np.arange(count) * 1000, 25.0)
    return FramedDecoder(payload), data, framed_protocol.frame_bytes(payload)


def _board(chips: int, count: int) -> tuple[ReskinDecoder, bytes, int]:
    """The same of a ReSkin board."""
    values = np.random.default_rng(0).integers(-2500, 2500, (count, chips, 3)) * 2.4e-6
    data = reskin_protocol.encode(values, np.full((count, chips), 25.0))
    return ReskinDecoder(chips), data, reskin_protocol.frame_bytes(chips)


def decoding_rows() -> list[Row]:
    """Time to decode one frame, alone and among many; a row for each codec."""
    settings = ChipSettings()
    chips = Decoder(settings, np.zeros(20))
    answers = bytearray(np.random.default_rng(0).bytes(20 * settings.answer_bytes))
    alone = shortest(lambda: chips.values(chips.words(answers)[1]), REPEATED)
    times = [('MLX90393 answers, 20 chips', 20.0, 1e6 * alone, None)]
    for name, aim, (decoder, stream, size) in (
        ('framed, 20 chips', 20.0, _framed(three_axis_chips(20), 256)),
        ('framed, 2000 taxels', 100.0, _framed(taxel_matrix(2000), 256)),
        ('ReSkin, 20 chips', 20.0, _board(20, 256)),
    ):
        pieces = cut(stream, size)
        single, batch = (
            1e6 * shortest(partial(_feed, decoder, parts), REPEATED) / len(pieces)
            for parts in (pieces, [stream])
        )
        times.append((name, aim, single, batch))
    return [
        Row(f'decode a frame: {name}', 'us', one, aim=aim, us_single=one, us_batch=many)
        for name, aim, one, many in times
    ]


def _feed(decoder: FramedDecoder | ReskinDecoder, parts: list[bytes]) -> None:
    for part in parts:
        decoder.feed(part)


def memory_rows(count: int) -> list[Row]:
    """Growth of memory over `count` frames, one in 32 of them damaged, through each decoder."""
    rows = []
    for name, (decoder, stream, size) in (
        ('framed', _framed(gradiometer(), CHUNK)), ('ReSkin', _board(5, CHUNK)),
    ):  # fmt: skip
        hurt = bytearray(stream)
        hurt[:: 32 * size] = bytes(b ^ 4 for b in hurt[:: 32 * size])
        passes = count // CHUNK
        for i in range(passes):
            if i == passes // 10:
                before = resident_kib()
            _feed(decoder, cut(bytes(hurt), PIECE))
        what = f'memory grown over {count} frames, {name} decoder'
        rows.append(Row(what, 'KiB', resident_kib() - before, bound=0.0, aim=1024.0))
    return rows
