# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pictures of how sensors are connected: python docs/images/draw_wiring.py."""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).resolve().parent
STYLE = (
    '<style>text{font:13px sans-serif;fill:#222}.box{fill:#eef3f5;stroke:#556}'
    '.note{font-size:11px;fill:#556}@media(prefers-color-scheme:dark){text{fill:#eee}'
    '.box{fill:#2a3338;stroke:#9ab}.note{fill:#9ab}}</style>'
)
COLOURS = {
    '3V3': '#c0392b', 'GND': '#7f8c8d', 'SDA': '#2980b9', 'SCL': '#b7950b', 'USB': '#8e44ad',
    'A': '#c0392b', 'B': '#2980b9', 'C': '#b7950b',
    'D': '#27ae60', 'foil': '#8e44ad', 'row': '#2980b9', 'column': '#b7950b',
}  # fmt: skip
TOP, PITCH, WIDTH, APART = 44, 24, 150, 120
CENTRED = 'text-anchor="middle"'


Box = tuple[str, tuple[str, ...], tuple[str, ...]]  # title, lines, wires to the box on the left


def drawn(*boxes: Box) -> str:
    """Boxes in a row, each wired to the one before it."""
    rows = max(max(len(lines), len(wires)) for _, lines, wires in boxes)
    height, width = TOP + PITCH * rows, len(boxes) * (WIDTH + APART) - APART
    parts = []
    for number, (title, lines, wires) in enumerate(boxes):
        left = 10 + number * (WIDTH + APART)
        middle = left + WIDTH / 2
        parts.append(
            f'<rect class="box" x="{left}" y="10" width="{WIDTH}" height="{height - 8}" rx="6"/>'
            f'<text x="{middle}" y="30" text-anchor="middle" font-weight="bold">{title}</text>'
        )
        for row, line in enumerate(lines):
            y = TOP + 10 + PITCH * row
            parts.append(f'<text class="note" x="{middle}" y="{y}" {CENTRED}>{line}</text>')
        for row, wire in enumerate(wires):
            y, colour = TOP + 6 + PITCH * row, COLOURS[wire.split()[0]]
            parts.append(
                f'<path d="M{left - APART} {y}H{left}" stroke="{colour}" stroke-width="2.5"/>'
                f'<text class="note" x="{left - APART / 2}" y="{y - 4}" {CENTRED}>{wire}</text>'
            )
    size = f'viewBox="0 0 {width + 20} {height + 14}" width="{width + 20}" height="{height + 14}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{STYLE}{"".join(parts)}</svg>\n'


BUS = ('3V3', 'GND', 'SDA', 'SCL')
USB: Box = ('computer', ('/dev/ttyACM0',), ('USB',))
DRAWINGS: dict[str, tuple[Box, ...]] = {
    'wiring_usb': (
        ('sensor board', ('5 x MLX90393', 'under the skin'), ()),
        ('controller', ('reads the chips,', '115200 baud'), BUS),
        USB,
    ),
    'wiring_i2c': (
        ('MLX90393', ('address by', 'pins A0, A1'), ()),
        ('TCA9548A', ('only for more', 'than 4 chips', 'on a bus'), BUS),
        ('computer', ('/dev/i2c-1', 'pull-ups to 3V3,', 'smaller with', 'many chips'), BUS),
    ),
    'wiring_taxels': (
        ('taxel matrix', ('piezoresistive', 'between rows', 'and columns'), ()),
        (
            'microcontroller',
            ('drives one column,', 'reads each row', 'over R0 to ground'),
            ('column 1..n', 'row 1..m'),
        ),
        USB,
    ),
    'wiring_five_wires': (
        ('five-wire skin', ('wires at corners', 'A, B, C, D;', 'foil under Velostat'), ()),
        (
            'microcontroller',
            ('drives A and C,', 'then B and D,', 'then all; reads', 'the foil, last', 'over R0'),
            ('A', 'B', 'C', 'D', 'foil'),
        ),
        USB,
    ),
}

if __name__ == '__main__':
    for stem, boxes in DRAWINGS.items():
        (HERE / f'{stem}.svg').write_text(drawn(*boxes))
