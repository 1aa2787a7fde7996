# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Diagrams of the pages, from wires to commands: python docs/images/draw_diagrams.py."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1])]

from tactile_ros.devices import framed_protocol  # noqa: E402

STYLE = (
    '<style>text{font:14px sans-serif;fill:#222}.card{fill:#fff}.note{font-size:12px;fill:#444}'
    '.box{fill:#eef3f5;stroke:#556}.part{fill:#fff;stroke:#222;stroke-width:1.5}'
    '.head{font-weight:600}.wire{fill:none;stroke-width:2.5}.ground{fill:none;stroke:#222;stroke-width:2}'
    '@media(prefers-color-scheme:dark){text{fill:#eee}.card{fill:#1b1e23}.note{fill:#cdd}'
    '.box{fill:#2a3338;stroke:#9ab}.part{fill:#1b1e23;stroke:#eee}.ground{stroke:#eee}}</style>'
)
GREEN, RED, GREY = '#27ae60', '#d0493a', '#7f8c8d'
COLOURS = {
    '3V3': '#d0493a', 'VCC': '#d0493a', 'GND': '#7f8c8d', 'SDA': '#2f8fd0', 'SCL': '#b7950b',
    'A': '#d0493a', 'B': '#2f8fd0', 'C': '#b7950b', 'D': '#27ae60', 'foil': '#a05cc0',
    'R0': '#a05cc0', 'row': '#2f8fd0', 'column': '#b7950b', 'Bx,': '#2f8fd0', 'A0': '#b7950b',
    'select': '#27ae60',
    'live:': '#d0493a', 'batch:': '#2f8fd0', 'replay:': '#27ae60', 'checked:': '#27ae60',
    'TRUSTED:': '#d0493a', 'OPEN:': '#d0493a',
}  # fmt: skip
TOP, PITCH, WIDTH, APART = 46, 25, 156, 124
HEAD = 26  # pixels of a title above boxes in a row
STACK, LETTER = 440, 6.4  # pixels: width of a column of boxes; a letter
CENTRED = 'text-anchor="middle"'


Box = tuple[str, tuple[str, ...], tuple[str, ...]]  # title, lines, wires to the box on the left


def drawn(title: str, *boxes: Box, grounded: str = '') -> str:
    """Boxes in a row, each wired to the one before it; what ties the first bundle to ground.

    A wire `R0` leaves the wire above it through a resistor.
    """
    rows = max(max(len(lines), len(wires)) for _, lines, wires in boxes)
    longest = max(len(wire) for _, _, wires in boxes for wire in wires)
    apart = max(APART, LETTER * longest + 12)
    height, width = TOP + PITCH * (rows + bool(grounded)), len(boxes) * (WIDTH + apart) - apart
    parts = []
    for number, (name, lines, wires) in enumerate(boxes):
        left = 10 + number * (WIDTH + apart)
        middle, last = left + WIDTH / 2, 0.0
        parts.append(
            f'<rect class="box" x="{left}" y="10" width="{WIDTH}" height="{height - 8}" rx="6"/>'
            f'<text x="{middle}" y="30" {CENTRED} class="head">{name}</text>'
        )
        for row, line in enumerate(lines):
            y = TOP + 10 + PITCH * row
            parts.append(f'<text class="note" x="{middle}" y="{y}" {CENTRED}>{line}</text>')
        for row, wire in enumerate(wires):
            y = last = TOP + 8 + PITCH * row
            parts.append(wired(wire, left, y, apart))
        if grounded and number == 1:
            parts.append(to_ground(left - apart + 18, last, grounded))
    shown = text(width / 2 + 10, 24, title, 'class="head"')
    parts = [shown, f'<g transform="translate(0 {HEAD})">', *parts, '</g>']
    return whole(title, width + 20, height + 14 + HEAD, parts)


def whole(title: str, width: float, height: float, parts: list[str]) -> str:
    """A file of SVG; the title is for those who cannot see it."""
    size = f'viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}"'
    card = '<rect class="card" width="100%" height="100%"/>'
    about = f'role="img" aria-label="{title}"'
    parts = [STYLE, card, f'<title>{title}</title>', *parts]
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {about}>{"".join(parts)}</svg>\n'


def stacked(title: str, *boxes: Box) -> str:
    """Boxes below one another under the title; arrows carry the wires of a box, in words."""
    parts, y = [text(STACK / 2 + 10, 24, title, 'class="head"')], 36.0
    for name, lines, wires in boxes:
        if wires:
            down = 16 * len(wires) + 14
            parts.append(f'<path class="ground" d="M30 {y}v{down}m-5 -7l5 7l5 -7"/>')
            parts += [note(44, y + 16 + 16 * i, words) for i, words in enumerate(wires)]
            y += down
        high = 30 + 17 * len(lines)
        parts.append(f'<rect class="box" x="10" y="{y}" width="{STACK}" height="{high}" rx="6"/>')
        parts.append(text(22, y + 20, name, 'class="head"', 'start'))
        parts += [note(22, y + 39 + 17 * i, line) for i, line in enumerate(lines)]
        y += high
    return whole(title, STACK + 20, y + 10, parts)


def text(x: float, y: float, words: str, more: str = '', anchor: str = 'middle') -> str:
    """Words at a place."""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" {more}>{words}</text>'


def note(x: float, y: float, words: str, anchor: str = 'start') -> str:
    """Small words at a place."""
    return text(x, y, words, 'class="note"', anchor)


def marks(title: str, columns: tuple[str, ...], rows: dict[str, str]) -> str:
    """A table of discs, filled for `x` and empty for `-`: a letter of a row for each column."""
    first, step = 190, 250 / len(columns)
    parts = [text(STACK / 2 + 10, 24, title, 'class="head"')]
    places = [first + step * (i + 0.5) for i in range(len(columns))]
    for x, words in zip(places, columns, strict=True):
        parts += [note(x, 48 + 15 * i, part, 'middle') for i, part in enumerate(words.split())]
    for i, (name, letters) in enumerate(rows.items()):
        y = 94 + 28 * i
        parts.append(note(12, y + 4, name))
        for x, letter in zip(places, letters, strict=True):
            fill = GREEN if letter == 'x' else 'none'
            stroke = GREEN if letter == 'x' else GREY
            parts.append(f'<circle cx="{x:g}" cy="{y}" r="7" fill="{fill}" stroke="{stroke}"/>')
    y = 94 + 28 * len(rows)
    parts.append(note(12, y + 6, 'filled: done; empty: not yet'))
    return whole(title, STACK + 20, y + 20, parts)


def frame_on_the_wire() -> str:
    """Bytes of the frame of a gradiometer, as `encode` writes them, with the names of fields."""
    counts = [[1, -2], [300, -400], [32767, -32767], [0, 21]]
    payload = framed_protocol.gradiometer()
    frame = framed_protocol.encode(payload, counts, 258, 16909060, 26.53)
    fields = (
        (2, 'sync', '#7f8c8d'), (2, 'version, kind', '#b7950b'), (2, 'pixels', '#2f8fd0'),
        (2, 'payload bytes', '#a05cc0'), (4, 'sequence', GREEN), (4, 'time (us)', '#d0493a'),
        (16, 'Bx, Bz of 4 pixels', '#2f8fd0'), (2, 'temperature', '#b7950b'), (4, 'CRC-32', RED),
    )  # fmt: skip
    title = f'One frame of a gradiometer: {len(frame)} bytes'
    parts, at = [text(STACK / 2 + 10, 24, title, 'class="head"')], 0
    for size, name, colour in fields:
        for i in range(at, at + size):
            x, y = 10 + 54.5 * (i % 8), 40 + 48 * (i // 8)
            parts.append(
                f'<rect x="{x + 1:g}" y="{y}" width="52.5" height="24" fill="{colour}" '
                f'fill-opacity="0.25" stroke="{colour}"/>'
            )
            parts.append(text(x + 27, y + 17, f'{frame[i]:02x}'))
            if i == at or i % 8 == 0:
                parts.append(note(x + 2, y + 38, f'{i}: {name}' if i == at else f'{i}: ...'))
        at += size
    return whole(title, STACK + 20, 40 + 48 * 5, parts)


def wired(wire: str, left: float, y: float, apart: float) -> str:
    """A wire that ends at a box, with its name."""
    stroke = f'class="wire" stroke="{COLOURS[wire.split(maxsplit=1)[0]]}"'
    if wire.startswith('R0'):
        return (
            f'<path {stroke} d="M{left - 34} {y - PITCH}V{y}H{left}"/>'
            f'<rect class="part" x="{left - 39}" y="{y - 19}" width="10" height="15"/>'
            f'<text class="note" x="{left - 44}" y="{y - 2}" text-anchor="end">{wire}</text>'
        )
    return (
        f'<path {stroke} d="M{left - apart:g} {y:g}H{left:g}"/>'
        f'<text class="note" x="{left - apart / 2:g}" y="{y - 4:g}" {CENTRED}>{wire}</text>'
    )


def to_ground(x: float, y: float, words: str) -> str:
    """A resistor from a wire to ground, with its name."""
    return (
        f'<path class="ground" d="M{x} {y}v30m-9 0h18m-14 4h10m-7 4h4"/>'
        f'<rect class="part" x="{x - 5}" y="{y + 6}" width="10" height="16"/>'
        f'<text class="note" x="{x + 12}" y="{y + 19}">{words}</text>'
    )


BUS = ('3V3', 'GND', 'SDA', 'SCL')
DRAWINGS: dict[str, str] = {
    'wiring_usb': drawn(
        'ReSkin, AnySkin and eFlesh boards',
        ('sensor board', ('5 x MLX90393', 'under the skin'), ()),
        ('QT Py or Trinket M0', ('I2C at 400 kHz;', 'USB to', '/dev/ttyACM0'), BUS),
    ),
    'wiring_i2c': drawn(
        'MLX90393 on I2C',
        ('MLX90393', ('CS to 3V3: I2C', 'A0, A1 to GND or', '3V3: 0x0C to 0x0F'), ()),
        (
            'computer, /dev/i2c-1',
            ('pull-ups to 3V3,', 'smaller for many;', 'over 4 chips: a', 'TCA9548A between'),
            BUS,
        ),
    ),
    'wiring_chips': drawn(
        'MLX90393 behind a microcontroller',
        ('MLX90393', ('CS to 3V3: I2C', 'A0, A1 to GND or', '3V3: 0x0C to 0x0F'), ()),
        (
            'microcontroller',
            ('reads the chips;', 'sends frames of', 'kind chips; USB', 'to /dev/ttyACM0'),
            BUS,
        ),
    ),
    'wiring_framed': drawn(
        'Four Hall pixels behind a microcontroller',
        ('four pixels', ('each gives', 'Bx and Bz'), ()),
        (
            'microcontroller',
            ('A0 to A7, 12 bits,', 'at 1 kHz; USB to', '/dev/ttyACM0'),
            ('3V3', 'GND', 'Bx, Bz of each'),
        ),
    ),
    'wiring_taxels': drawn(
        'A matrix of taxels behind a microcontroller',
        ('taxel matrix', ('piezoresistive', 'between rows', 'and columns'), ()),
        (
            'microcontroller',
            ('one row at VREF,', 'the others at GND;', 'converts columns;', 'USB'),
            ('row 1..m', 'column 1..n'),
        ),
        grounded='R0, each column',
    ),
    'wiring_lines': drawn(
        'Taxels on an Arduino that prints text',
        ('16 taxels', ('from VCC through', 'a multiplexer', 'to A0'), ()),
        (
            'Arduino',
            ('prints a line a', 'frame, 115200 baud;', 'USB'),
            ('VCC', 'select pins', 'A0'),
        ),
        grounded='R0',
    ),
    'wiring_five_wires': drawn(
        'Five wires behind a microcontroller',
        ('five-wire skin', ('wires at corners', 'A, B, C, D;', 'foil under Velostat'), ()),
        (
            'microcontroller',
            (
                '1: A high, C low', '2: B high, D low', '3: A to D high,', 'R0 pin low',
                '(open in 1, 2);', 'converts the foil',
            ),
            ('A', 'B', 'C', 'D', 'foil', 'R0 to a pin'),
        ),
    ),
    'frame_bytes': frame_on_the_wire(),
    'replay_ways': drawn(
        'The same frames give the same contacts three ways',
        ('frames of a bag', ('with its tares,', 'starts and', 'failed frames'), ()),
        (
            'contacts',
            ('equal to 1e-9:', 'a test and a', 'bench compare'),
            ('live: contact_node', 'batch: process_batch', 'replay: tactile replay'),
        ),
    ),
    'trust': drawn(
        'What comes in, and whether it is checked',
        (
            'from outside',
            ('green: not', 'trusted', 'red: trusted, or', 'open until you', 'close it'),
            (),
        ),
        (
            'tactile_ros',
            ('no eval, no shell,', 'no pickle;', 'a refusal is one', 'sentence'),
            (
                'checked: sizes of npz, bags', 'checked: fields of yaml',
                'checked: bytes of boards', 'checked: shapes of messages',
                'OPEN: DDS without SROS2', 'TRUSTED: your own Python',
                'TRUSTED: ROS parameter files',
            ),
        ),
    ),
    'commands': stacked(
        'Commands in the order of use',
        ('begin', ('list, doctor, demo; for a sensor of your own new, design',), ()),
        ('record', ('calibrate --live, or run and record',), ('a sensor that answers',)),
        (
            'calibrate', ('calibrate, calibration show, enrol',),
            ('presses with reference values',),
        ),
        ('use', ('run, view',), ('calibration, one .npz file',)),
        ('evaluate', ('replay, compare, report, export; bench',), ('bag of the run',)),
    ),
    'nodes': stacked(
        'Nodes of a sensor and of a grip',
        ('sensor_node', ('reads the board or a simulated one, and sets its faults',), ()),
        (
            'contact_node',
            ('serves tare, enrol, forget', 'also publishes wrench, markers, baseline, surface'),
            ('topics frame, layout',),
        ),
        (
            'grip_node', ('serves grasp, enable; also publishes grip_node/state',),
            ('topic contacts, of each finger',),
        ),
        (
            'driver of the hand, not ours', ('its joint states go back to grip_node',),
            ('the command topic of the hand',),
        ),
    ),
    'delay': stacked(
        'What a delay runs through, in one process',
        ('board', ('writes the bytes of a frame: the delay begins',), ()),
        (
            'thread of the sensor',
            ('wakes, reads, estimates; frames that waited go together',),
            ('serial port',),
        ),
        (
            'law of the grip', ('a step by the thread that brings the last new force',),
            ('a call, no message',),
        ),
        ('hand', ('hears the command: the delay ends when it is sent',), ('DDS',)),
        (
            'everyone else', ('contacts, markers and diagnostics are published after it',),
            ('DDS, once the command is out',),
        ),
    ),
    'messages': stacked(
        'Messages between the nodes',
        ('sensor_node', ('reads the board or a simulated one',), ()),
        (
            'contact_node', ('baseline, estimation; also publishes baseline, calibration',),
            ('frame: TactileFrame, one for each reading', 'layout: TactileLayout, latched'),
        ),
        (
            'grip_node', ('the law of the grip; also publishes its GripState',),
            (
                'contacts: TactileContacts, one for each frame',
                'wrench: WrenchStamped, for tools that know no other',
            ),
        ),
        ('hand', ('joint states go back to grip_node',), ('commands of the driver of the hand',)),
    ),
    'devices': stacked(
        'From bytes to a frame, in tactile_ros/devices',
        (
            'board or chips, or simulated ones', ('simulated_serial.py, simulated_i2c.py',), (),
        ),
        ('port or bus', ('transport.py opens it, again after unplugging',), ('bytes',)),
        (
            'codec',
            (
                'framed_protocol.py, reskin_protocol.py, text_lines.py, mlx90393.py',
                'finds frames, checks what can be checked, counts damage',
            ),
            ('bytes, cut anywhere',),
        ),
        (
            'driver',
            (
                'serial_board.py, chip_array.py: SI units, recovery',
                'timestamps.py: time of acquisition; fault_flags.py: status bits',
            ),
            ('counts of the converter, time of the board',),
        ),
        (
            'sensor_node, or your Python', ('device.read(1.0)',),
            ('Frame: values, status, stamp, sequence',),
        ),
    ),
    'method': stacked(
        'Where a method is named and what calls it',
        ('estimators/nearest.py', ('fit(x, y, groups) and predict(x)',), ()),
        (
            'sensors/regression.py', ('fit compares all methods on held-out groups',),
            ('one entry in methods()',),
        ),
        (
            'calibration file', ('arrays that end in _, held-out errors; no code',),
            ('the best, or that of --estimator',),
        ),
        (
            'pipeline', ('calls predict: live, in batches and in replays',),
            ('checked, and built by its own class',),
        ),
    ),
    'python': stacked(
        'Classes and what they give',
        ('sensor = tr.sensor(key)', ('recordings(), config(), open() for a live board',), ()),
        ('board = sensor.fit(recording)', ('also tr.load(path); save(path)',), ('Recording',)),
        (
            'board.process(frame), board.process_batch(recording)', ('tare and enrol, too',),
            ('calibration: a fitted Pipeline',),
        ),
        (
            'board.evaluate(recording)', ('errors against reference values, and their figures',),
            ('ContactState, ContactStates: force, position, covariances',),
        ),
    ),
    'floors': stacked(
        'Floors: imports run downward',
        ('nodes, cli', ('ROS 2 and the command line',), ()),
        ('simulation, evaluation, view', ('hands, figures, a page in the browser',), ('import',)),
        ('sensors, hands', ('a folder for each sensor; descriptions of hands',), ('import',)),
        ('pipeline', ('faults, baseline, contact, estimation of one frame',), ('import',)),
        (
            'conditioning, estimators, control, devices',
            ('and messages, calibration: one step each, none knows another',), ('import',),
        ),
        ('physics, types, errors', ('arrays, records, models of fields',), ('import',)),
    ),
    'hardware': marks(
        'What each part was tried with',
        ('real data', 'simulated part', 'simulated physics', 'real part'),
        {
            'eFlesh on a ReSkin board': 'xxx-',
            'AnySkin board': '-xx-',
            'MLX90393 on I2C': '-xx-',
            'framed boards, 4 sensors': '-xx-',
            'Allegro V4, V5, Sense, Plexus': '-xx-',
            'qb SoftHand': '-x--',
        },
    ),
}  # fmt: skip

if __name__ == '__main__':
    for stem, drawing in DRAWINGS.items():
        (HERE / f'{stem}.svg').write_text(drawing)
