"""Words and lines of reports stand out from what is behind them, in the light and in the dark."""

from __future__ import annotations

import re

import pytest

from tactile_ros.evaluation.figures import STYLE

GROUNDS = 'paper', 'card', 'tint'
WORDS = 'ink', 'soft', 'warn', 'c0', 'c2'
LINES = 'c0', 'c1', 'c2', 'c3', 'c4'
FOR_WORDS, FOR_LINES = 4.5, 3.0  # WCAG 2.1, level AA
LIGHT, DARK = (
    dict(re.findall(r'--(\w+): (#\w{6})', block))
    for block in re.findall(r':root \{(.*?)\}', STYLE, re.DOTALL)
)


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return sum(w * p for w, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two colours, 1 to 21."""
    dark, light = sorted(map(luminance, (one, other)))
    return (light + 0.05) / (dark + 0.05)


def test_black_on_white_has_the_largest_contrast() -> None:
    assert contrast('#000000', '#ffffff') == pytest.approx(21.0)


@pytest.mark.parametrize('scheme', [LIGHT, DARK], ids=['light', 'dark'])
def test_words_and_lines_can_be_read_in_both_schemes(scheme: dict[str, str]) -> None:
    assert scheme.keys() == LIGHT.keys()
    poor = [
        (name, ground)
        for names, least in ((WORDS, FOR_WORDS), (LINES, FOR_LINES))
        for name in names
        for ground in GROUNDS
        if contrast(scheme[name], scheme[ground]) < least
    ]
    assert poor == []
