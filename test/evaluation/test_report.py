from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation.figures import drift, hysteresis
from tactile_ros.evaluation.metrics import Agreement, class_errors, target_errors
from tactile_ros.evaluation.report import (
    Answer,
    Dataset,
    Result,
    colours_of,
    figure_text,
    figures_of,
    headline,
    render,
    table,
    write_report,
)
from tactile_ros.types import ContactStates, Layout, Recording

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import SimpleNamespace as Framed

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
    known = {
        'position': position
        + np.append(rng.normal(0, 1e-3 * scale, (240, 2)), np.zeros((240, 1)), 1),
        'position_cov': np.tile(1e-6 * scale**2 * np.eye(3), (240, 1, 1)),
        'force': force + rng.normal(0, scale, (240, 3)),
        'force_cov': np.tile(scale**2 * np.eye(3), (240, 1, 1)),
        'valid': np.arange(240) != 5,
    }
    states = ContactStates.assemble(240, 5, known)
    return Answer(name, target_errors(recording, states), us, us / 20)


def result_of(**changes: object) -> Result:
    rng = np.random.default_rng(0)
    dataset = Dataset(
        name='spatial',
        summary='Held-out places.',
        answers=(answer_of('kernel_ridge', 0.4, 1, 60), answer_of(HOSTILE, 1.0, 2, 20)),
        frames=240,
        dropped=3,
        chips=LAYOUT.positions,
        latency_s=1e-3 * rng.gamma(3, 0.5, 240),
        agreement=Agreement(240, 7, {'force': 2e-13}),
        problems=(f'/camera{HOSTILE} was left out',),
    )
    fields = {
        'title': f'Replay {HOSTILE}',
        'command': f'tactile replay {HOSTILE}',
        'environment': {'python': '3.11', 'cpu': HOSTILE},
        'datasets': (dataset,),
    }
    return Result(**{**fields, **changes})


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
        self.fetching += [
            f'{k}={v}' for k, v in attrs if k in ('src', 'href', 'xlink:href', 'srcset')
        ]
        self.fetching += [
            f'{k}={v}' for k, v in attrs if k.startswith('on') or 'url(' in (v or '')
        ]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_is_whole_escaped_alone_and_where_it_was_asked_for(tmp_path: Path) -> None:
    path = write_report(tmp_path / 'new' / 'report.html', result_of())
    assert path.stat().st_size < 1_000_000
    text = path.read_text(encoding='utf-8')
    assert text == render(result_of())
    checker = Checker()
    checker.feed(text)
    assert checker.open == []
    assert checker.fetching == []
    assert not {'script', 'link', 'img', 'iframe', 'object'} & checker.seen
    assert '<script' not in text
    assert not re.search(r'https?://|//[a-z]|@import|url\(', text)
    assert 'tactile replay &lt;script&gt;' in text


def test_every_drawing_is_there_and_says_its_finding() -> None:
    (dataset,) = result_of().datasets
    colours = colours_of(result_of())
    figures = figures_of(dataset, colours)
    titles = [figure.title for figure in figures]
    assert titles == [
        'Where on the pad it errs',
        'How far off the place is',
        'Normal force against the scale',
        'Shear force x against the scale',
        'Are the covariances honest?',
        'Speed against error',
        'How late a contact is',
        'Hysteresis of shear force x',
        'Drift of normal force',
        'Drift of shear force x',
        'Normal force over time',
        'Shear force x over time',
    ]
    place = dataset.answers[0].target('position')
    assert f'{1e3 * place.spread.mean:.2f} mm on average' in figures[1].caption
    assert f'{dataset.answers[0].target("force_z").spread.rms:.2f} N' in figures[2].caption
    assert '3 of 243 frames were lost' in figures[6].caption
    assert all('nan' not in figure.drawing for figure in figures)


def test_a_recording_without_truth_or_answers_still_has_its_report() -> None:
    (full,) = result_of().datasets
    fields = {'frames': 1, 'dropped': 0, 'chips': full.chips}
    bare = Dataset('bare', '', (), **fields)
    blind = Dataset('blind', '', (Answer('ridge', ()),), **fields)
    zeros = np.zeros((3, 3))
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((3, 5, 3)), truth={'force': zeros, 'position': zeros}
    )
    states = ContactStates.assemble(3, 5, {'valid': np.ones(3, bool)})
    nothing = Answer('ridge', target_errors(recording, states), 1.0)
    text = render(result_of(datasets=(bare, blind, Dataset('lost', '', (nothing,), **fields))))
    assert 'bare' in text
    assert 'nan' not in text
    assert '3 frames without an estimate' in text
    assert render(result_of(datasets=()))


def test_of_a_force_that_never_varied_there_is_no_drawing_and_no_headline() -> None:
    result = result_of()
    (dataset,) = result.datasets
    first = dataset.answers[0]
    flat = [
        replace(t, truth=np.zeros_like(t.truth)) if t.name == 'force_z' else t
        for t in first.targets
    ]
    dataset = replace(dataset, answers=(replace(first, targets=tuple(flat)),))
    titles = [figure.title for figure in figures_of(dataset, {first.name: 'c0'})]
    assert 'Shear force x against the scale' in titles
    assert not [title for title in titles if 'ormal force' in title]
    dataset = replace(dataset, latency_s=np.full(9, 0.1234))
    figures = headline(result_of(datasets=(dataset,)))
    assert ('123', 'ms', 'latency (p99 123 ms)') in figures
    words = [words for _, _, words in figures]
    assert 'RMSE of shear force' in words
    assert 'RMSE of normal force' not in words


def test_the_table_has_one_row_per_estimator_in_millimetres_and_newton() -> None:
    result = result_of()
    columns, rows = table(result)
    first, second = (dict(zip(columns, row, strict=True)) for row in rows)
    answer = result.datasets[0].answers[0]
    assert first['place mean (mm)'] == pytest.approx(1e3 * answer.target('position').spread.mean)
    assert first['normal RMSE (N)'] == answer.target('force_z').spread.rms
    assert first['shear RMSE (N)'] == pytest.approx(answer.target('force_x').spread.rms)
    assert first['place in 1 sigma (%)'] == pytest.approx(68, abs=8)
    assert first['latency p50 (ms)'] == pytest.approx(
        1e3 * np.median(result.datasets[0].latency_s)
    )
    assert second['latency p50 (ms)'] is None
    assert (first['us/frame'], second['us/frame']) == (60, 20)
    assert 'class="best">' in render(result)


def test_columns_that_nobody_fills_are_left_out() -> None:
    (full,) = result_of().datasets
    answer = Answer('ridge', (full.answers[0].target('force_z'),))
    dataset = Dataset('normal', '', (answer,), 3, 0, full.chips)
    columns, _ = table(result_of(datasets=(dataset,)))
    wanted = 'recording, estimator, normal RMSE (N), force in 1 sigma (%), groups, dropped'
    assert ', '.join(columns) == wanted


def test_numbers_have_the_digits_they_deserve() -> None:
    assert figure_text(0.3612, 'mm') == '0.36'
    assert figure_text(36.12, 'us/frame') == '36.1'
    assert figure_text(68.3, 'in 1 sigma (%)') == '68'
    assert figure_text(4805, 'frames') == '4,805'
    assert figure_text(float('nan'), 'mm') == figure_text(None, 'mm') == '–'


@pytest.mark.parametrize('width', [390, 1200])
def test_a_browser_shows_it_without_a_complaint_and_without_scrolling_sideways(
    framed: Callable[[str, int], Framed], width: int
) -> None:
    seen = framed(render(result_of()), width)
    assert seen.wide == seen.window == width
    assert seen.plots >= 9
    assert width < 1200 or seen.cut == 0
    assert seen.complaints == ''


def remembering(gap: float, slope: float) -> Dataset:
    """Four presses of 10 N whose error is `gap` larger while they fall, and grows by `slope`."""
    time = np.arange(800) * 0.05
    force = 5 - 5 * np.cos(2 * np.pi * time / 10)
    error = np.where(np.gradient(force) < 0, gap, 0.0) + slope * time
    truth = {'force': np.column_stack([np.full((800, 2), np.nan), force]), 'cell': time // 10}
    stamps = np.arange(800) * 50_000_000
    recording = Recording.from_arrays(LAYOUT, np.zeros((800, 5, 3)), stamp_ns=stamps, truth=truth)
    told = np.column_stack([np.full((800, 2), np.nan), force + error])
    cell = np.where(time < 5, 1, time // 10).astype(int)  # half of cell 0 is taken for 1
    cell[-200:] = -1
    states = ContactStates.assemble(
        800, 5, {'force': told, 'valid': np.ones(800, bool), 'cell': cell}
    )
    errors, classes = target_errors(recording, states), class_errors(recording, states)
    answer = Answer('ridge', errors, classes=classes)
    return Dataset('made', '', (answer,), 800, 0, LAYOUT.positions)


def test_hysteresis_and_drift_are_measured() -> None:
    figure = hysteresis(remembering(gap=0.3, slope=0.0).answers[0].target('force_z'))
    assert '0.30 N apart on average, at worst 0.30 N: 3.0 % of the range' in figure.caption
    moved = drift(remembering(gap=0.0, slope=0.02).answers[0].target('force_z'), 'c0')
    assert 'Over 40 s the mean error moves by +0.80 N' in moved.caption
    assert 'nan' not in moved.drawing
    still = drift(remembering(gap=0.0, slope=0.0).answers[0].target('force_z'), 'c0')
    assert 'nan' not in still.drawing


@pytest.mark.parametrize('rate', [20.0, 2000.0])
def test_hysteresis_is_measured_at_any_rate_and_under_noise(rate: float) -> None:
    rng, corners = np.random.default_rng(1), np.array([0.0, 1, 4, 6, 7, 8, 9, 10])
    time = np.arange(round(60 * rate)) / rate
    part = time % 10
    force = np.interp(part, corners, [0, 0, 10, 10, 0, 0, 9.0, 0])  # a slow rise, quick ones
    falls = ((part > 6) & (part <= 7)) | (part > 9)
    error = np.where(falls, 0.3, 0.0)
    held = (part > 4) & (part <= 6)
    error[held] = 2.0 * (part[held] - 4)  # creep under a hold is no hysteresis
    noisy = force + 0.01 * rng.normal(size=len(time))
    blank = np.full((len(time), 2), np.nan)
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((len(time), 5, 3)), stamp_ns=np.round(1e9 * time).astype(np.int64),
        truth={'force': np.column_stack([blank, noisy])},
    )  # fmt: skip
    told = np.column_stack([blank, noisy + error])
    states = ContactStates.assemble(
        len(time), 5, {'force': told, 'valid': np.ones(len(time), bool)}
    )
    answer = Answer('ridge', target_errors(recording, states))
    figure = hysteresis(answer.target('force_z'))
    apart, worst = (float(word) for word in re.findall(r'([0-9.]+) N[ :]', figure.caption)[:2])
    assert apart == pytest.approx(0.3, abs=0.02)
    assert worst == pytest.approx(0.3, abs=0.1)


def test_confusions_are_counted_and_named() -> None:
    dataset = remembering(0.0, 0.0)
    (figure,) = [f for f in figures_of(dataset, {'ridge': 'c0'}) if 'taken for' in f.title]
    assert figure.title == 'Which cell is taken for which'
    assert '62.5 % of 800 rows are named rightly, 25.0 % are not named' in figure.caption
    assert 'taken most often: 0 for 1 (50 %)' in figure.caption
    assert 'nan' not in figure.drawing
    columns, (row,) = table(result_of(datasets=(dataset,)))
    assert row[columns.index('named rightly (%)')] == 62.5


def test_answers_of_one_name_are_drawn_once_the_first_first() -> None:
    (full,) = result_of().datasets
    first, other = full.answers
    dataset = Dataset('x', '', (first, other, first), 3, 0, full.chips)
    assert [*dataset.competitors] == [first.name, other.name]
    assert len(table(result_of(datasets=(dataset,)))[1]) == 3
