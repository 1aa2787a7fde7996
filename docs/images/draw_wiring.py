# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pictures of how sensors and nodes are connected: python docs/images/draw_wiring.py."""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).resolve().parent
STYLE = (
    '<style>text{font:14px sans-serif;fill:#222}.card{fill:#fff}.note{font-size:12px;fill:#444}'
    '.box{fill:#eef3f5;stroke:#556}.part{fill:#fff;stroke:#222;stroke-width:1.5}'
    '.wire{fill:none;stroke-width:2.5}.ground{fill:none;stroke:#222;stroke-width:2}'
    '@media(prefers-color-scheme:dark){text{fill:#eee}.card{fill:#1b1e23}.note{fill:#cdd}'
    '.box{fill:#2a3338;stroke:#9ab}.part{fill:#1b1e23;stroke:#eee}.ground{stroke:#eee}}</style>'
)
COLOURS = {
    '3V3': '#d0493a', 'VCC': '#d0493a', 'GND': '#7f8c8d', 'SDA': '#2f8fd0', 'SCL': '#b7950b',
    'A': '#d0493a', 'B': '#2f8fd0', 'C': '#b7950b', 'D': '#27ae60', 'foil': '#a05cc0',
    'R0': '#a05cc0', 'row': '#2f8fd0', 'column': '#b7950b', 'Bx,': '#2f8fd0', 'A0': '#b7950b',
    'select': '#27ae60', 'frame': '#2f8fd0', 'layout': '#7f8c8d', 'contacts': '#27ae60',
}  # fmt: skip
TOP, PITCH, WIDTH, APART = 46, 25, 156, 124
CENTRED = 'text-anchor="middle"'


Box = tuple[str, tuple[str, ...], tuple[str, ...]]  # title, lines, wires to the box on the left


def drawn(title: str, *boxes: Box, grounded: str = '') -> str:
    """Boxes in a row, each wired to the one before it; what ties the first bundle to ground.

    A wire `R0` leaves the wire above it through a resistor.
    """
    rows = max(max(len(lines), len(wires)) for _, lines, wires in boxes)
    height, width = TOP + PITCH * (rows + bool(grounded)), len(boxes) * (WIDTH + APART) - APART
    parts = []
    for number, (name, lines, wires) in enumerate(boxes):
        left = 10 + number * (WIDTH + APART)
        middle, last = left + WIDTH / 2, 0.0
        parts.append(
            f'<rect class="box" x="{left}" y="10" width="{WIDTH}" height="{height - 8}" rx="6"/>'
            f'<text x="{middle}" y="30" {CENTRED} font-weight="bold">{name}</text>'
        )
        for row, line in enumerate(lines):
            y = TOP + 10 + PITCH * row
            parts.append(f'<text class="note" x="{middle}" y="{y}" {CENTRED}>{line}</text>')
        for row, wire in enumerate(wires):
            y = last = TOP + 8 + PITCH * row
            parts.append(wired(wire, left, y))
        if grounded and number == 1:
            parts.append(to_ground(left - APART + 18, last, grounded))
    size = f'viewBox="0 0 {width + 20} {height + 14}" width="{width + 20}" height="{height + 14}"'
    card = '<rect class="card" width="100%" height="100%"/>'
    about = f'role="img" aria-label="{title}"'
    parts = [STYLE, card, f'<title>{title}</title>', *parts]
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {about}>{"".join(parts)}</svg>\n'


def wired(wire: str, left: float, y: float) -> str:
    """A wire that ends at a box, with its name."""
    stroke = f'class="wire" stroke="{COLOURS[wire.split(maxsplit=1)[0]]}"'
    if wire.startswith('R0'):
        return (
            f'<path {stroke} d="M{left - 34} {y - PITCH}V{y}H{left}"/>'
            f'<rect class="part" x="{left - 39}" y="{y - 19}" width="10" height="15"/>'
            f'<text class="note" x="{left - 44}" y="{y - 2}" text-anchor="end">{wire}</text>'
        )
    return (
        f'<path {stroke} d="M{left - APART} {y}H{left}"/>'
        f'<text class="note" x="{left - APART / 2}" y="{y - 4}" {CENTRED}>{wire}</text>'
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
    'wiring_nodes': drawn(
        'Nodes of a sensor and of a grip',
        ('sensor_node', ('reads the board', 'or its twin'), ()),
        ('contact_node', ('tare, enrol;', 'wrench, markers'), ('frame', 'layout')),
        ('grip_node', ('grasp, enable;', 'commands the hand'), ('contacts',)),
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
}  # fmt: skip

if __name__ == '__main__':
    for stem, drawing in DRAWINGS.items():
        (HERE / f'{stem}.svg').write_text(drawing)
