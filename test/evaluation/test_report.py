# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The report: whole, escaped, readable in both schemes, with drawings of their own."""

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace as Framed
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tactile_ros.evaluation import figures, metrics
from tactile_ros.evaluation.figures import STYLE, Plot, drift, hysteresis, standalone
from tactile_ros.evaluation.metrics import Agreement, ContactErrors, class_errors, target_errors
from tactile_ros.evaluation.report import (
    Answer,
    Dataset,
    Result,
    colours_of,
    figures_of,
    headline,
    render,
    table,
    write_report,
)
from tactile_ros.types import ContactStates, Layout, Recording

LAYOUT = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T')
HOSTILE = '<script>alert(1)</script> & "quotes" \'too\''


def answer_of(name: str, scale: float, seed: int, us: float = 50.0) -> Answer:
    """Errors of place (scale in mm) and of two force components (scale in N)."""
    rng = np.random.default_rng(seed)
    place = np.repeat(rng.uniform(-0.015, 0.015, (60, 2)), 4, axis=0)
    force = np.column_stack(
        [3 * np.sin(np.arange(240) / 9), np.full(240, np.nan), 9 + 9 * np.cos(np.arange(240) / 30)]
    )
    position = np.column_stack([place, np.full(240, np.nan)])
    truth = {'position': position, 'force': force}
    stamps = np.arange(240) * 100_000_000
    recording = Recording.from_arrays(LAYOUT, np.zeros((240, 5, 3)), stamp_ns=stamps, truth=truth)
    off = np.append(rng.normal(0, 1e-3 * scale, (240, 2)), np.zeros((240, 1)), 1)
    known = {
        'position': position + off,
        'position_cov': np.tile(1e-6 * scale**2 * np.eye(3), (240, 1, 1)),
        'force': force + rng.normal(0, scale, (240, 3)),
        'force_cov': np.tile(scale**2 * np.eye(3), (240, 1, 1)),
        'valid': np.arange(240) != 5,
    }
    states = ContactStates.assemble(240, 5, known)
    return Answer(name, target_errors(recording, states), us, us / 20)


def result_of(**changes: object) -> Result:
    rng = np.random.default_rng(0)
    answers = (answer_of('kernel_ridge', 0.4, 1, 60), answer_of(HOSTILE, 1.0, 2, 20))
    dataset = Dataset(
        'spatial', f'Held-out {HOSTILE}', answers, 240, 3, LAYOUT.positions,
        1e-3 * rng.gamma(3, 0.5, 240), Agreement(240, 7, {'force': 2e-13}),
        (f'/camera{HOSTILE} was left out',),
    )  # fmt: skip
    facts = {'python': '3.11', HOSTILE: HOSTILE}
    result = Result(f'Replay {HOSTILE}', f'tactile replay {HOSTILE}', facts, (dataset,))
    return replace(result, **changes)


class Checker(HTMLParser):
    """Balanced tags, and every attribute that could fetch something."""

    VOID = frozenset({'meta', 'link', 'img', 'br', 'hr', 'input'})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.fetching: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        fetching = ('src', 'href', 'xlink:href', 'srcset')
        self.fetching += [
            f'{k}={v}' for k, v in attrs
            if k in fetching or k.startswith('on') or 'url(' in (v or '')
        ]  # fmt: skip
        self.open += [tag] * (tag not in self.VOID)

    def handle_endtag(self, tag: str) -> None:
        assert tag in self.VOID or self.open.pop() == tag


def test_report_is_whole_escaped_and_self_contained(tmp_path: Path) -> None:
    path = write_report(tmp_path / 'new' / 'report.html', result_of())
    assert path.stat().st_size < 1_000_000
    text = path.read_text(encoding='utf-8')
    checker = Checker()
    checker.feed(text)
    assert (checker.open, checker.fetching) == ([], [])
    assert not {'script', 'link', 'img', 'iframe', 'object'} & checker.seen
    assert not re.search(r'<script|https?://|//[a-z]|@import|url\(', text)
    assert 'tactile replay &lt;script&gt;' in text


def test_figures_of_say_their_findings() -> None:
    (dataset,) = result_of().datasets
    figures = {f.title: f for f in figures_of(dataset, colours_of(result_of()))}
    assert [*figures] == [
        'Where on the pad it errs', 'How far off the place is', 'Normal force against the scale',
        'Shear force x against the scale', 'Are the covariances honest?', 'Speed against error',
        'How late a contact is', 'Hysteresis of shear force x', 'Drift of normal force',
        'Drift of shear force x', 'Normal force over time', 'Shear force x over time',
    ]  # fmt: skip
    answer = dataset.answers[0]
    place, force = (answer.target(name).spread for name in ('position', 'force_z'))
    assert f'{1e3 * place.mean:.3g} mm on average' in figures['How far off the place is'].caption
    assert f'RMSE {force.rms:.3g} N' in figures['Normal force against the scale'].caption
    assert '3 of 243 frames were lost' in figures['How late a contact is'].caption
    assert all('nan' not in standalone(*figure.plots) for figure in figures.values())


def remembering(force: np.ndarray, error: np.ndarray, time: np.ndarray) -> Dataset:
    """Presses along z with their error, and cells of which half of 0 is taken for 1."""
    count = len(force)
    z = np.column_stack([np.full((count, 2), np.nan), force])
    cell = (time // 10).astype(int)
    said = np.where(time < 5, 1, np.where(time >= 30, -1, cell))
    truth = {'force': z, 'cell': cell}
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((count, 5, 3)), np.round(1e9 * time).astype(np.int64), truth=truth
    )
    known = {'force': z + [[0, 0, 1]] * error[:, None], 'cell': said, 'valid': time >= 0}
    states = ContactStates.assemble(count, 5, known)
    answer = Answer('ridge', target_errors(recording, states), classes=class_errors(truth, states))
    return Dataset('made', '', (answer,), count, 0, LAYOUT.positions)


def test_hysteresis_drift_and_confusion_measure_gap_slope_and_share() -> None:
    time = np.arange(800) * 0.05
    force = 5 - 5 * np.cos(2 * np.pi * time / 10)
    gap = remembering(force, np.where(np.gradient(force) < 0, 0.3, 0.0), time)
    words = 'differ by 0.3 N on average, at worst 0.3 N: 3 % of the range'
    assert words in hysteresis(gap.answers[0].target('force_z')).caption
    moved = drift(remembering(force, 0.02 * time, time).answers[0].target('force_z'), 'c0')
    assert 'Over 40 s the mean error moves by +0.799 N' in moved.caption
    (figure,) = [f for f in figures_of(gap, {'ridge': 'c0'}) if 'taken for' in f.title]
    assert figure.title == 'Which cell is taken for which'
    assert '62.5 % of 800 rows are named rightly, 25 % are not named' in figure.caption
    assert 'taken most often: 0 for 1 (50 %)' in figure.caption
    columns, (row,) = table(result_of(datasets=(gap,)))
    assert row[columns.index('named rightly (%)')] == 62.5
    still = drift(remembering(force, 0.0 * time, time).answers[0].target('force_z'), 'c0')
    assert 'nan' not in standalone(*moved.plots, *still.plots, *figure.plots)


@pytest.mark.parametrize('rate', [20.0, 200.0])
def test_hysteresis_at_any_rate_and_under_noise(rate: float) -> None:
    rng, corners = np.random.default_rng(1), np.array([0.0, 1, 4, 6, 7, 8, 9, 10])
    time = np.arange(round(60 * rate)) / rate
    part = time % 10
    force = np.interp(part, corners, [0, 0, 10, 10, 0, 0, 9.0, 0])  # a slow rise, quick ones
    error = np.where(((part > 6) & (part <= 7)) | (part > 9), 0.3, 0.0)
    held = (part > 4) & (part <= 6)
    error[held] = 2.0 * (part[held] - 4)  # creep under a hold is no hysteresis
    noisy = force + 0.01 * rng.normal(size=len(time))
    target = remembering(noisy, error, time).answers[0].target('force_z')
    caption = hysteresis(target).caption
    apart, worst = (float(word) for word in re.findall(r'([0-9.]+) N[ :]', caption)[:2])
    assert apart == pytest.approx(0.3, abs=0.02)
    assert worst == pytest.approx(0.3, abs=0.1)


def test_report_of_a_recording_without_truth_or_answers() -> None:
    (full,) = result_of().datasets
    fields = {'frames': 1, 'dropped': 0, 'chips': full.chips}
    blind = Dataset('blind', '', (Answer('ridge', ()),), **fields)
    truth = {'force': np.zeros((3, 3)), 'position': np.zeros((3, 3))}
    recording = Recording.from_arrays(LAYOUT, np.zeros((3, 5, 3)), truth=truth)
    states = ContactStates.assemble(3, 5, {'valid': np.ones(3, bool)})
    nothing = Answer('ridge', target_errors(recording, states), 1.0)
    bare, lost = Dataset('bare', '', (), **fields), Dataset('lost', '', (nothing,), **fields)
    text = render(result_of(datasets=(bare, blind, lost)))
    assert 'bare' in text
    assert 'nan' not in text
    assert '3 frames without an estimate' in text
    assert text.count('Latency not available') == 1
    assert 'Latency not available' not in render(result_of())
    assert render(result_of(datasets=()))


def test_constant_force_has_no_drawing_and_no_headline() -> None:
    (dataset,) = result_of().datasets
    first = dataset.answers[0]
    flat = (
        replace(t, truth=np.zeros_like(t.truth)) if t.name == 'force_z' else t
        for t in first.targets
    )
    answers = (replace(first, targets=tuple(flat)),)
    dataset = replace(dataset, answers=answers, latency_s=np.full(9, 0.0123))
    titles = [figure.title for figure in figures_of(dataset, {first.name: 'c0'})]
    assert 'Shear force x against the scale' in titles
    assert not [title for title in titles if 'ormal force' in title]
    figures = headline(result_of(datasets=(dataset,)))
    assert ('12.3', 'ms', 'latency (p99 12.3 ms)') in figures
    words = {words for _, _, words in figures}
    assert 'RMSE of shear force' in words
    assert 'RMSE of normal force' not in words


def test_the_covariance_drawing_shades_the_accepted_range() -> None:
    target = answer_of('ridge', 1.0, 1).targets[0]
    few = replace(target, groups=target.groups % 6)
    (plot,) = figures.sigma_calibration([few]).plots
    for end in metrics.coverage_range(0.7, 6):
        corner = float(plot.x(70.0)), float(plot.y(100 * end))
        assert '{:.1f} {:.1f}'.format(*corner) in plot.__html__()


def test_table_has_a_row_for_each_estimator_and_columns_with_values() -> None:
    result = result_of()
    (dataset,) = result.datasets
    columns, rows = table(result)
    first, second = (dict(zip(columns, row, strict=True)) for row in rows)
    answer = dataset.answers[0]
    assert first['place mean (mm)'] == pytest.approx(1e3 * answer.target('position').spread.mean)
    assert first['normal RMSE (N)'] == answer.target('force_z').spread.rms
    assert first['shear RMSE (N)'] == pytest.approx(answer.target('force_x').spread.rms)
    assert first['place in 1 sigma (%)'] == pytest.approx(68, abs=8)
    assert first['latency p50 (ms)'] == pytest.approx(1e3 * np.median(dataset.latency_s))
    assert second['latency p50 (ms)'] is None
    assert (first['us/frame'], second['us/frame']) == (60, 20)
    assert '<td class="best" data-label="p50">' in render(result)
    alone = Answer('ridge', (answer.target('force_z'),))
    columns, _ = table(result_of(datasets=(Dataset('n', '', (alone,), 3, 0, dataset.chips),)))
    wanted = 'recording, estimator, normal RMSE (N), force in 1 sigma (%), groups, dropped'
    assert ', '.join(columns) == wanted


@pytest.mark.parametrize('width', [390, 1200])
def test_report_fits_a_browser_without_complaints(
    framed: Callable[[str, int], Framed], width: int
) -> None:
    (dataset,) = result_of().datasets
    touched = np.arange(240) % 2 > 0
    contact = ContactErrors(touched, touched.astype(int), np.ones(240), np.ones(240), np.zeros(3))
    whole = tuple(replace(one, untared=one, contact=contact) for one in dataset.answers)
    seen = framed(render(result_of(datasets=(replace(dataset, answers=whole),))), width)
    assert seen.wide == seen.window == width
    assert seen.plots >= 9
    assert width < 1200 or seen.cut == 0
    assert seen.complaints == ''


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
