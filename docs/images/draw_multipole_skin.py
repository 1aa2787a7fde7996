# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Draw the images of `docs/multipole_skin.md`: python docs/images/draw_multipole_skin.py."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parents[1] / 'test')]

from benchmarks.multipole_skin import SENSOR, Trials  # noqa: E402

STYLE = (
    '<style>text{font:13px sans-serif;fill:#333}.title{font-weight:600}.card{fill:#fff}'
    '.head{fill:#ddd;stroke:#888}.line{stroke:#111;stroke-width:1.5}@media(prefers-color-scheme:dark){text{fill:#ddd}'
    '.card{fill:#1b1e23}.head{fill:#444}.line{stroke:#eee}}</style>'
)
DEPTH = 0.6e-3
PLACE = np.array([19e-3, 20e-3, 0.0])
RED, BLUE = '#d6604d', '#4393c3'


def templates() -> str:
    """Changes of field of nine heads at one place, chip by chip."""
    trials = Trials(1)
    recogniser = SENSOR.pipeline(trials.config).fit(trials.one).estimation.recogniser_
    bank = recogniser.templates[0]
    parts = bank.at(np.arange(9), np.tile(PLACE, (9, 1)))[:, 0]
    fields = np.tensordot(DEPTH ** np.arange(1, 4), parts, axes=(0, 1)).reshape(9, -1, 3)
    chips = recogniser.model.chips
    most = np.abs(fields).max()
    drawn = []
    for i, head in enumerate(trials.heads):
        left, top = 190 * (i % 3), 205 * (i // 3)
        at = np.array([left + 95, top + 105])
        outline = at + (head.loops[0] + PLACE[:2]) * [2000, -2000]
        corners = ' '.join(f'{x:.1f},{y:.1f}' for x, y in outline)
        drawn.append(f'<polygon class="head" points="{corners}"/>')
        drawn.append(f'<text x="{left + 8}" y="{top + 16}">{head.name}</text>')
        for (x, y), (bx, by, bz) in zip(
            at + chips[:, :2] * [2000, -2000], fields[i] / most, strict=True
        ):
            size, colour = 14 * np.sqrt(abs(bz)), RED if bz > 0 else BLUE
            drawn.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" fill="{colour}" '
                f'fill-opacity="0.5"/><path class="line" '
                f'd="M{x:.1f} {y:.1f}l{40 * bx:.1f} {-40 * by:.1f}"/>'
            )
    words = (
        f'disc: change of Bz, red up, blue down; largest {1e3 * most:.1f} mT; area by size',
        f'line from a chip: change of Bx and By; {1e3 * most:.1f} mT is 20 mm long; bar: 10 mm',
    )
    drawn += [f'<text x="8" y="{632 + 18 * k}">{line}</text>' for k, line in enumerate(words)]
    drawn.append('<path class="line" d="M530 646h20"/>')
    return _svg(f'Change of field under nine heads, {1e3 * DEPTH:g} mm deep', 570, 660, drawn)


def confusion() -> str:
    """Heads named against heads that pressed, at new places after 20 presses of one head."""
    trials = Trials(1)
    labels = np.arange(108) % 9
    test = trials.random(labels, trials.config)
    states = SENSOR.pipeline(trials.config).fit(trials.one).process_batch(test)
    named = states.label[trials.ends(test)]
    names = [head.name for head in trials.heads]
    drawn = []
    for i in range(9):
        for j in range(9):
            share = float((named[labels == i] == j).mean())
            x, y = 110 + 42 * j, 60 + 42 * i
            drawn.append(
                f'<rect x="{x}" y="{y}" width="41" height="41" fill="{BLUE}" '
                f'fill-opacity="{0.04 + 0.9 * share:.2f}"/>'
            )
            if share > 0:
                ink = ' style="fill:#fff"' if share > 0.5 else ''
                drawn.append(
                    f'<text x="{x + 20}" y="{y + 25}" text-anchor="middle"{ink}>'
                    f'{100 * share:.0f}</text>'
                )
        drawn.append(
            f'<text x="104" y="{85 + 42 * i}" text-anchor="end">{names[i]}</text>'
            f'<text transform="translate({134 + 42 * i} 54) rotate(-35)">'
            f'{names[i]}</text>'
        )
    drawn.append('<text x="110" y="458">pressed (rows), named (columns), % of presses</text>')
    return _svg('Nine heads at new places, after 20 presses of one', 560, 470, drawn)


def _svg(title: str, width: int, height: int, drawn: list[str]) -> str:
    """A whole drawing below its title."""
    size = f'width="{width}" viewBox="0 -30 {width} {height + 30}" role="img" aria-label="{title}"'
    shown = f'<text class="title" x="{width / 2}" y="-8" text-anchor="middle">{title}</text>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{STYLE}'
        f'<rect class="card" y="-30" width="{width}" height="{height + 30}"/>'
        f'{shown}{"".join(drawn)}</svg>\n'
    )


if __name__ == '__main__':
    (HERE / 'multipole_templates.svg').write_text(templates())
    (HERE / 'multipole_confusion.svg').write_text(confusion())
