# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drawings as files of their own, and colours that can be read in the light and in the dark."""

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tactile_ros.evaluation.figures import STYLE, Plot, standalone

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


@pytest.mark.parametrize('scheme', [LIGHT, DARK], ids=['light', 'dark'])
def test_words_and_lines_can_be_read_in_both_schemes(scheme: dict[str, str]) -> None:
    assert contrast('#000000', '#ffffff') == pytest.approx(21.0)
    assert scheme.keys() == LIGHT.keys()
    poor = [
        (name, ground)
        for names, least in ((WORDS, FOR_WORDS), (LINES, FOR_LINES))
        for name in names
        for ground in GROUNDS
        if contrast(scheme[name], scheme[ground]) < least
    ]
    assert poor == []


def plot() -> Plot:
    drawn = Plot(
        (1, 100), (1e-3, 1e3), 'time', 'error', log_x=True, log_y=True, description='Error & time'
    )
    drawn.line(np.array([1.0, 100.0]), np.array([1e-3, 1e3]), 'line c0')
    drawn.mark(10.0, 1.0, 0, 'fill c1')
    return drawn


def test_a_drawing_is_whole_and_brings_its_colours() -> None:
    text = standalone(plot())
    root = ET.fromstring(text)
    assert root.tag == '{http://www.w3.org/2000/svg}svg'
    assert root.get('viewBox') == '0 0 360 270'
    assert root.get('aria-label') == 'Error & time'
    style = root.findtext('{http://www.w3.org/2000/svg}style')
    assert '--c0: #0060a8' in style
    assert 'path.line' in style
    assert '.c4 {' in style
    assert 'h1' not in style
    assert style.count('{') == style.count('}')


def test_plot_maps_linear_and_logarithmic_values_to_pixels() -> None:
    linear = Plot((0, 10), (0, 1), 'x', 'y', (360, 270))
    assert [*linear.x(np.array([0.0, 10.0])), linear.y(0.0)] == [46, 346, 228]
    linear.line(np.array([0, 5, np.nan, 10]), np.array([0, 1, 0, 1]), 'line')
    assert 'd="M46.0 228.0L196.0 30.0M346.0 30.0"' in linear.__html__()
    drawn = plot()
    assert np.isclose(drawn.y(1.0), (drawn.y(1e-3) + drawn.y(1e3)) / 2)
    assert np.isclose(drawn.x(10.0), (drawn.x(1.0) + drawn.x(100.0)) / 2)
    assert drawn.x.value(float(drawn.x(10.0))) == pytest.approx(10.0)
