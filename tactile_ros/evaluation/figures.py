# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures of an evaluation as SVG, light and dark as the reader prefers, and as PNG.

The writer is our own: text stays text, colours are variables of `drawing.css`, and a drawing of
thousands of dots is one path. PNG files are rendered by resvg.
"""

from __future__ import annotations

import base64
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from tactile_ros.conditioning.loading_direction import dead_band, loading_signs
from tactile_ros.errors import MissingPackageError, TactileError, load_package
from tactile_ros.evaluation import metrics
from tactile_ros.files import write_atomically
from tactile_ros.types import Array, Bools, Integers

STYLE = Path(__file__).with_name('drawing.css').read_text('utf-8').split('*/\n', 1)[1]
LEFT, RIGHT, TOP, BOTTOM = 46.0, 14.0, 30.0, 42.0  # pixels around the axes
LETTER, LINE = 6.4, 15.0  # pixels of a letter and of a line of labels
PAGE = 1180.0  # pixels across
MM = 1e3
SHADES = (0.5, 2.0, 5.0, 15.0)  # % of a class, from which a cell is shaded, and darker
MOST_PLACED = 1 << 16  # rows whose places are drawn
Span = tuple[float, float]
PREFIXES = {0: '', -3: 'm', -6: 'µ', -9: 'n'}
NAMES = {
    'position': 'place',
    'force_z': 'normal force',
    'force_x': 'shear force x',
    'force_y': 'shear force y',
}


def rounded(value: float, digits: int = 3) -> str:
    """So many digits, of large numbers all before the point; a true minus."""
    whole = abs(value) >= min(10**digits, 1000)
    return (f'{value:,.0f}' if whole else f'{value:.{digits}g}').replace('-', '−')


def quantity(value: float, unit: str) -> str:
    """Three digits and the unit, with an SI prefix below a tenth.

    Examples
    --------
    >>> quantity(0.123, 'N'), quantity(-0.00123, 'N'), quantity(0.0, 'N')
    ('0.123 N', '−1.23 mN', '0 N')
    """
    large = (power for power in PREFIXES if abs(value) >= 0.0995 * 10.0**power)
    power = next(large, -9) if value else 0
    return f'{rounded(value / 10.0**power)} {PREFIXES[power]}{unit}'


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round values that divide a range into about `count` steps."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((f * power for f in (1, 2, 2.5, 5, 10)), key=lambda s: abs(math.log(s / rough)))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Decades of a range, with 2 and 5 where there are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    factors = (1,) if last - first > 3 else (1, 2, 5)
    ticks = [f * 10.0**n for n in range(first, last + 1) for f in factors]
    return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]


class Scale(NamedTuple):
    """Map from the values of an axis to pixels."""

    values: tuple[float, float]
    pixels: tuple[float, float]
    log: bool

    def __call__(self, value: Array | float) -> Array:
        """Pixels of values."""
        (low, high), (start, end) = self.values, self.pixels
        part = np.asarray(value, np.float64)
        if self.log:
            part, low, high = np.log(part), math.log(low), math.log(high)
        return np.asarray(start + (part - low) / (high - low) * (end - start))

    def value(self, pixel: float) -> float:
        """Value at a pixel."""
        (low, high), (start, end) = self.values, self.pixels
        part = (pixel - start) / (end - start)
        return low * (high / low) ** part if self.log else low + part * (high - low)


class Plot:
    """One pair of axes over ranges of x and y; later marks lie over earlier ones.

    Labels are with units, the size in pixels; `description` is for those who cannot see the
    drawing, and `integer_ticks` labels whole numbers alone.
    """

    def __init__(
        self,
        x: Span,
        y: Span,
        x_label: str,
        y_label: str,
        size: tuple[int, int] = (360, 270),
        *,
        log_x: bool = False,
        log_y: bool = False,
        description: str = '',
        integer_ticks: bool = False,
    ) -> None:
        self.size, self.description, self.integer_ticks = size, description, integer_ticks
        self.labels = x_label, y_label
        self.x = Scale(x, (LEFT, size[0] - RIGHT), log_x)
        self.y = Scale(y, (size[1] - BOTTOM, TOP), log_y)
        self._marks: list[str] = []  # clipped to the axes
        self._over: list[str] = []

    @classmethod
    def plan(cls, x: Span, y: Span, unit: str, description: str) -> Plot:
        """Plan view: one scale for both axes."""
        height = round((360 - LEFT - RIGHT) * (y[1] - y[0]) / (x[1] - x[0]) + TOP + BOTTOM)
        return cls(x, y, f'x {unit}', f'y {unit}', (360, height), description=description)

    def _pixels(self, x: Array, y: Array) -> Iterable[tuple[float, float]]:
        return zip(self.x(x).tolist(), self.y(y).tolist(), strict=True)

    def line(self, x: Array, y: Array, kind: str, *, closed: bool = False) -> None:
        """Draw a line of class `kind`; NaN breaks it."""
        path, command = '', 'M'
        for px, py in self._pixels(x, y):
            shown = math.isfinite(px) and math.isfinite(py)
            path += f'{command}{px:.1f} {py:.1f}' if shown else ''
            command = 'L' if shown else 'M'
        self._marks.append(f'<path class="{kind}" d="{path}{"Z" * closed}"/>')

    def band(self, x: Array, low: Array, high: Array, kind: str) -> None:
        """Fill the area between two lines; NaN breaks it."""
        gaps = np.flatnonzero(~np.isfinite(x + low + high))
        for start, end in pairwise([-1, *gaps.tolist(), len(x)]):
            own = slice(start + 1, end)
            if end - start > 2:
                ends = np.append(low[own], high[own][::-1])
                self.line(np.append(x[own], x[own][::-1]), ends, kind, closed=True)

    def dots(self, x: Array, y: Array, kind: str) -> None:
        """Draw round dots, as one path of lines without length."""
        pixels = self._pixels(x, y)
        path = ''.join(f'M{a:.1f} {b:.1f}h0' for a, b in pixels if math.isfinite(a + b))
        self._marks.append(f'<path class="dots {kind}" d="{path}"/>')

    def _box(
        self, left: float, top: float, width: float, height: float, kind: str, title: str = ''
    ) -> None:
        place, size = f'x="{left:.1f}" y="{top:.1f}"', f'width="{width:.1f}" height="{height:.1f}"'
        hover = f'><title>{escape(title)}</title></rect>' if title else '/>'
        self._marks.append(f'<rect class="{kind}" {place} {size}{hover}')

    def boxes(
        self, x: Array, y: Array, side: float, kinds: Sequence[str], titles: Sequence[str] = ()
    ) -> None:
        """Draw squares around places (side in units of x), each of its own class and title."""
        wide = abs(float(self.x(side) - self.x(0.0)))
        each = zip(self._pixels(x, y), kinds, titles or [''] * len(kinds), strict=True)
        for (px, py), kind, title in each:
            self._box(px - wide / 2, py - wide / 2, wide, wide, kind, title)

    def bars(self, edges: Array, heights: Array, kind: str) -> None:
        """Draw the bars of a histogram."""
        floor, ends = float(self.y(0.0)), self.x(edges).tolist()
        for (left, right), top in zip(pairwise(ends), self.y(heights).tolist(), strict=True):
            if floor - top > 0.05:
                self._box(left + 0.5, top, max(right - left - 1, 0.5), floor - top, kind)

    def mark(self, x: float, y: float, shape: int, kind: str) -> None:
        """Draw one symbol; shapes differ for those who do not see colours."""
        a, b, r = float(self.x(x)), float(self.y(y)), 6.0
        shapes = (
            f'M{a - r} {b}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0Z',
            f'M{a - r} {b - r}h{2 * r}v{2 * r}h{-2 * r}Z',
            f'M{a} {b - r - 1}l{r + 1} {2 * r}h{-2 * r - 2}Z',
            f'M{a} {b - r - 2}l{r + 2} {r + 2}l{-r - 2} {r + 2}l{-r - 2} {-r - 2}Z',
        )
        self._over.append(f'<path class="{kind}" d="{shapes[shape % len(shapes)]}"/>')

    def rule(self, x: float, label: str, row: int = 0) -> None:
        """Draw a vertical line with a label beside its top."""
        bottom, top = self.y.pixels
        self._over.append(f'<path class="rule" d="M{float(self.x(x)):.1f} {top}V{bottom}"/>')
        self.text(x, None, label, row=row)

    def text(
        self, x: float, y: float | None, words: str, anchor: str = 'start', kind: str = '',
        row: int = 0, shift: float = 0.0,
    ) -> None:  # fmt: skip
        """Write at a place (`shift` pixels lower), or under the top of the plot without `y`."""
        px = float(self.x(x)) + {'start': 5, 'end': -5}.get(anchor, 0)
        py = TOP + 11 + LINE * row if y is None else float(self.y(y)) + 4 + shift
        if anchor == 'start' and px + LETTER * len(words) > self.size[0]:
            px, anchor = px - 10, 'end'
        self._over.append(_text(px, py, words, f'note {kind}', anchor))

    def __html__(self) -> str:
        return self.element('class="plot"')

    def element(self, attributes: str) -> str:
        """The drawing as an svg element with attributes of its own."""
        (left, right), (bottom, top) = self.x.pixels, self.y.pixels
        width, height = right - left, bottom - top
        inner = f'x="{left}" y="{top}" width="{width}" height="{height}"'
        return (
            f'<svg {attributes} viewBox="0 0 {self.size[0]} {self.size[1]}" role="img" '
            f'aria-label="{escape(self.description)}">{"".join(self._axes())}'
            f'<svg {inner} viewBox="{left} {top} {width} {height}">{"".join(self._marks)}</svg>'
            f'{"".join(self._over)}</svg>'
        )

    def _ticks(self, scale: Scale, spacing: float, fewest: int) -> Iterable[tuple[float, str]]:
        count = max(fewest, int(abs(scale.pixels[1] - scale.pixels[0]) / spacing))
        ticks = log_ticks(*scale.values) if scale.log else nice_ticks(*scale.values, count)
        kept = [tick for tick in ticks if not self.integer_ticks or tick == round(tick)]
        return ((float(scale(tick)), f'{tick:.6g}'.replace('-', '−')) for tick in kept)

    def _axes(self) -> Iterable[str]:
        (left, right), (bottom, top) = self.x.pixels, self.y.pixels
        for py, label in self._ticks(self.y, 45, 3):
            yield f'<path class="grid" d="M{left} {py:.1f}H{right}"/>'
            yield _text(left - 7, py + 4, label, '', 'end')
        for px, label in self._ticks(self.x, 65, 2):
            yield f'<path class="tick" d="M{px:.1f} {bottom}v4"/>'
            yield _text(px, bottom + 17, label, '', 'middle')
        yield f'<path class="axis" d="M{left} {bottom}H{right}"/>'
        yield _text(right, bottom + 34, self.labels[0], 'name', 'end')
        yield _text(2, top - 13, self.labels[1], 'name')


def _text(x: float, y: float, words: str, kind: str, anchor: str = 'start') -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text class="{kind}" {place}>{escape(words)}</text>'


class Figure(NamedTuple):
    """Drawings under a headline, what they show, and a key of (class, words).

    `narrow` takes the place of the plots on narrow screens; empty: the same plots.
    """

    title: str
    caption: str
    plots: tuple[Plot, ...]
    key: tuple[tuple[str, str], ...] = ()
    narrow: tuple[Plot, ...] = ()


def standalone(*plots: Plot, title: str = '', key: Sequence[tuple[str, str]] = ()) -> str:
    """Plots, one under the other, as a file (SVG) of its own with the look of reports."""
    margin = 16.0 if title else 0.0
    width = max(plot.size[0] for plot in plots)
    parts, x, y = [], margin, margin
    for line in textwrap.wrap(title, width // 9):
        parts.append(_text(margin, y + 15, line, 'headline'))
        y += 22
    for kind, words in key:
        if x > margin and x + 18 + LETTER * len(words) > width + margin:
            x, y = margin, y + 18
        place = f'x="{x}" y="{y + 3}" width="12" height="12" rx="3"'
        parts += [f'<rect class="fill {kind}" {place}/>', _text(x + 18, y + 13, words, '')]
        x += 38 + LETTER * len(words)
    y += (26 if key else 0) + (8 if title else 0)
    for plot in plots:
        size = f'width="{plot.size[0]}" height="{plot.size[1]}"'
        parts.append(plot.element(f'x="{margin}" y="{y}" {size} overflow="visible"'))
        y += plot.size[1]
    across, down = f'{width + 2 * margin:g}', f'{y + margin:g}'
    description = escape('; '.join(plot.description for plot in plots))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{across}" height="{down}" '
        f'class="plot" viewBox="0 0 {across} {down}" role="img" aria-label="{description}">'
        f'<style>{STYLE}</style><rect width="100%" height="100%" fill="var(--card)"/>'
        f'{"".join(parts)}</svg>\n'
    )


@dataclass(frozen=True)
class Drawing:
    """Figures as one picture, which a notebook shows by itself."""

    figures: tuple[Figure, ...]

    def __repr__(self) -> str:
        """Headlines of the figures."""
        titles = '; '.join(figure.title for figure in self.figures) or 'nothing to draw'
        return f'Drawing({titles}); save(path) writes it as .svg or .png'

    @property
    def svg(self) -> str:
        """All figures, side by side as far as the page is wide."""
        parts, x, y, wide, high = [], 0.0, 0.0, 1.0, 0.0
        for figure in self.figures:
            drawn = standalone(*figure.plots, title=figure.title, key=figure.key)
            width, height = map(float, re.findall(r' (?:width|height)="([\d.]+)"', drawn)[:2])
            if x + width > PAGE:
                x, y, high = 0.0, y + high, 0.0
            parts.append(drawn.replace('<svg ', f'<svg x="{x:g}" y="{y:g}" ', 1))
            x, high = x + width, max(high, height)
            wide = max(wide, x)
        across, down = f'{wide:g}', f'{y + high or 1:g}'
        size = f'width="{across}" height="{down}" viewBox="0 0 {across} {down}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>\n'

    def _repr_html_(self) -> str:
        """Picture for a notebook, whose own styles it does not touch."""
        data = base64.b64encode(self.svg.encode()).decode()
        return f'<img alt="{escape(repr(self))}" src="data:image/svg+xml;base64,{data}">'

    def save(self, path: str | Path) -> Path:
        """Write the picture as .svg or .png; return the path."""
        file = Path(path)
        if file.suffix not in ('.svg', '.png'):
            msg = f'path of a drawing must end in .svg or .png; received {str(file)!r}'
            raise ValueError(msg)
        if file.suffix == '.png':
            return write_png(file, self.svg)
        return write_atomically(file, self.svg.encode())


def check_png() -> None:
    """Raise MissingPackageError where no PNG with text could be written."""
    drawing = load_package('resvg_py', 'pictures need resvg', 'resvg-py')
    blank = '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20"><style>' + STYLE
    shown = (f'{blank}</style>{text}</svg>' for text in ('', '<text y="15">M</text>'))
    if len({drawing.svg_to_bytes(svg_string=_light(svg)) for svg in shown}) == 1:
        msg = 'pictures need a font: DejaVu Sans (fonts-dejavu-core), Noto Sans or Roboto'
        raise MissingPackageError(msg)


def _light(svg: str) -> str:
    """A drawing in light colours without variables, which resvg does not know."""
    colours = dict(re.findall(r'--(\w+): (#\w+)', STYLE.partition('@media')[0]))
    light = re.sub(r'@media[^\n]*dark\) \{.*?\n\}', '', svg, flags=re.DOTALL)
    return re.sub(r'var\(--(\w+)\)', lambda found: colours.get(found[1], '#000'), light)


def write_png(path: Path, svg: str) -> Path:
    """Write a drawing as PNG, two pixels for each of its own; return the path."""
    check_png()
    import resvg_py

    if '<image' in svg:
        msg = f'{path} is not written: its drawing holds images of other files'
        raise TactileError(msg)
    try:
        return write_atomically(path, resvg_py.svg_to_bytes(svg_string=_light(svg), zoom=2))
    except ValueError as error:
        msg = f'{path} cannot be drawn: {error}'
        raise TactileError(msg) from error


def write_figures(folder: Path, figures: Iterable[Figure], prefix: str = '') -> Iterable[Path]:
    """Write every figure as PNG under its headline; yield each path when it is there."""
    for figure in figures:
        svg = standalone(*figure.plots, title=figure.title, key=figure.key)
        yield write_png(folder / f'{file_name(f"{prefix} {figure.title}")}.png', svg)


def file_name(title: str) -> str:
    """A headline as the name of a file: letters, digits and underscores."""
    return re.sub(r'[^a-z0-9]+', '_', title.lower()).strip('_')


def title_of(target: metrics.TargetErrors) -> str:
    """Name of a target in words."""
    return NAMES.get(target.name, target.name.replace('_', ' '))


def shown(target: metrics.TargetErrors) -> float:
    """Figure that stands for a target: mean place error (m), or RMSE."""
    return target.spread.mean if target.name == 'position' else target.spread.rms


def _verdict(coverage: metrics.Coverage) -> str:
    """Judgement of a share of errors inside one sigma, which agrees with the drawn band."""
    size = 'large' if coverage.share > metrics.ONE_SIGMA else 'small'
    return 'as it should' if coverage.honest else f'sigmas look too {size}'


def span_of(values: Array) -> Span:
    """Range of values with some air."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    air = 0.04 * (high - low) or 1.0
    return low - air, high + air


def _error_plot(
    x: Span,
    errors: npt.ArrayLike,
    labels: tuple[str, str],
    size: tuple[int, int],
    description: str,
    percentile: float = 100,
) -> Plot:
    top = 1.15 * float(np.nanpercentile(np.abs(errors), percentile)) or 1.0
    plot = Plot(x, (-top, top), *labels, size, description=description)
    plot.line(np.array(x), np.zeros(2), 'rule')
    return plot


def _subsample(rows: Integers, most: int) -> Integers:
    return rows[np.linspace(0, len(rows) - 1, most).astype(int)] if len(rows) > most else rows


def _bin_means(x: Array, values: Array, edges: Array, fewest: int = 5) -> Array:
    kept = np.isfinite(values) & (x >= edges[0]) & (x <= edges[-1])
    place = np.minimum(np.searchsorted(edges, x[kept], side='right'), len(edges) - 1) - 1
    count = np.bincount(place, minlength=len(edges) - 1)
    total = np.bincount(place, values[kept], minlength=len(edges) - 1)
    return np.where(count >= fewest, total / np.maximum(count, 1), np.nan)


def shade_key(limits: Iterable[float], unit: str) -> tuple[tuple[str, str], ...]:
    """Key of the shades between limits, the last one above all of them."""
    bounds = ['0', *(f'{limit:g}' for limit in limits)]
    words = [*(f'{a}–{b}' for a, b in pairwise(bounds)), f'> {bounds[-1]} {unit}']
    return tuple((f's{i}', word) for i, word in enumerate(words))


def place_map(target: metrics.TargetErrors, chips: Array) -> Figure:
    """Mean error at every touched place in plan view; chips (t, 3) (m) as crosses."""
    kept = _subsample(np.flatnonzero(np.isfinite(target.size)), MOST_PLACED)
    place, of_place = np.unique(np.round(target.truth[kept], 5), axis=0, return_inverse=True)
    of_place = of_place.reshape(-1)
    mean = MM * np.bincount(of_place, target.size[kept]) / np.bincount(of_place)
    x, y = MM * place.T
    some = _subsample(np.arange(len(x)), 400)
    apart = np.hypot(x[some, None] - x, y[some, None] - y)
    apart = np.where(apart > 0, apart, np.inf).min(axis=1)
    pitch = float(np.median(apart)) if np.isfinite(apart).all() else 1.0
    top = max(float(np.percentile(mean, 95)), 1e-3) / 5
    power = 10.0 ** math.floor(math.log10(top))
    step = next(f * power for f in (1, 2, 2.5, 5, 10) if f * power >= top * 0.999)
    limits = np.round(step * np.arange(1, 6), 9)
    x_span, y_span = ((float(v.min()) - pitch, float(v.max()) + pitch) for v in (x, y))
    plot = Plot.plan(x_span, y_span, '(mm)', 'Mean error at every touched place of the pad')
    kinds = [f's{level}' for level in np.searchsorted(limits, mean)]
    titles = [f'x {a:.1f}, y {b:.1f} mm: {m:.2g} mm' for a, b, m in zip(x, y, mean, strict=True)]
    plot.boxes(x, y, pitch * 0.94, kinds, titles)
    for a, b in (chips[:, :2] * MM).tolist():
        if x_span[0] <= a <= x_span[1] and y_span[0] <= b <= y_span[1]:
            plot.text(a, b, '+', 'middle', 'chip')
    caption = f'{len(x)} places'
    depth = np.minimum.reduce([x - x.min(), x.max() - x, y - y.min(), y.max() - y])
    rim = depth < 0.1 * max(float(np.ptp(x)), float(np.ptp(y)))
    if rim.any() and not rim.all():
        sizes = (mean[~rim].mean(), mean[rim].mean(), mean.max())
        inner, outer, worst = (quantity(size / MM, 'm') for size in sizes)
        caption += f': {inner} on average inside, {outer} in the outer tenth; at worst {worst}'
    caption += '. Crosses: chips.'
    return Figure('Where on the pad it errs', caption, (plot,), shade_key(limits, 'mm'))


def _histogram(
    sizes: Mapping[str, Array], top: float, label: str, spread: metrics.Spread, unit: str
) -> Plot:
    """Distribution up to `top` by class of colour: the first as bars, others as outlines."""
    edges = np.linspace(0, top, 41)
    shares = {c: 100 * np.histogram(size, edges)[0] / len(size) for c, size in sizes.items()}
    room = 1.15 * max(float(share.max()) for share in shares.values())
    plot = Plot((0, top), (0, room or 1.0), label, 'share of frames (%)',
                description=f'Distribution of the {label}')  # fmt: skip
    for i, (colour, share) in enumerate(shares.items()):
        if i == 0:
            plot.bars(edges, share, f'fill {colour}')
        else:
            plot.line(np.repeat(edges, 2)[1:-1], np.repeat(share, 2), f'line {colour}')
    for row, (words, value) in enumerate((('half', spread.p50), ('95 %', spread.p95))):
        plot.rule(MM * value, f'{words} below {quantity(value, unit)}', row=row)
    return plot


def place_histogram(
    targets: Mapping[str, metrics.TargetErrors], colours: Mapping[str, str]
) -> Figure:
    """Distribution of the place error by estimator; all but the first as outlines."""
    names = list(targets)[:4]
    sizes = {colours[n]: targets[n].size[np.isfinite(targets[n].size)] * MM for n in names}
    top = max(float(np.percentile(size, 98)) for size in sizes.values())
    spread = targets[names[0]].spread
    plot = _histogram(sizes, top, 'error in the plane (mm)', spread, 'm')
    caption = f'{names[0]}: {quantity(spread.mean, "m")} on average, '
    caption += f'worst {quantity(spread.largest, "m")}.'
    if len(targets) > 1:
        best = min(list(targets)[1:], key=lambda name: targets[name].spread.mean)
        caption += f' {best}: {quantity(targets[best].spread.mean, "m")}.'
    key = tuple((colours[name], name) for name in names)
    return Figure('How far off the place is', caption, (plot,), key)


def latency_histogram(latency_s: Array, spread: metrics.Spread, lost: str) -> Figure:
    """Distribution of the time from acquisition to contact (n,) (s)."""
    label = 'from acquisition to contact (ms)'
    plot = _histogram({'c2': MM * latency_s}, 1.3 * spread.p99 * MM, label, spread, 's')
    p99, worst = quantity(spread.p99, 's'), quantity(spread.largest, 's')
    worst = f'99 % below {p99}, at worst {worst}'
    return Figure('How late a contact is', f'{spread.count} contacts, {worst}; {lost}.', (plot,))


def force_scatter(target: metrics.TargetErrors, colour: str) -> Figure:
    """Estimate, and its error, against truth with the stated one-sigma band."""
    truth, guess, error = target.truth[:, 0], target.estimate[:, 0], target.error[:, 0]
    kept, words = np.isfinite(guess), title_of(target)
    some = _subsample(np.flatnonzero(kept), 2500)
    span = span_of(np.concatenate([truth[kept], guess[kept]]))
    above = Plot(span, span, '', 'estimated (N)', (360, 250),
                 description=f'Estimated against measured {words}')  # fmt: skip
    above.line(np.array(span), np.array(span), 'rule')
    above.dots(truth[some], guess[some], colour)
    below = _error_plot(span, error[kept], (f'measured {words} (N)', 'error (N)'), (360, 170),
                        f'Error of {words} against its size', 99.5)  # fmt: skip
    stated = kept & np.isfinite(target.variance[:, 0])
    edges = np.unique(np.percentile(truth[stated], np.linspace(0, 100, 25)) if stated.any() else 0)
    if len(edges) > 1:
        centre, variance = (
            _bin_means(truth[stated], values[stated], edges, 1)
            for values in (truth, target.variance[:, 0])
        )
        below.band(centre, -np.sqrt(variance), np.sqrt(variance), f'band {colour}')
    below.dots(truth[some], error[some], colour)
    share = target.coverage
    caption = f'RMSE {quantity(target.spread.rms, "N")} over {target.spread.count} frames.'
    if share.count:
        caption += (
            f' The band is the stated sigma: {100 * share.share:.0f} % of errors lie inside '
            f'({_verdict(share)}; {share.groups} groups).'
        )
    return Figure(f'{words.capitalize()} against the scale', caption, (above, below))


def force_trace(target: metrics.TargetErrors, name: str, colour: str) -> Figure | None:
    """Estimate of an estimator by name and truth over time, and the error under them."""
    if not np.isfinite(target.time_s).any():
        return None
    caption = (
        f'At worst {quantity(target.spread.largest, "N")} off. The band is the stated sigma about '
        'zero: honest errors leave it a third of the time.'
    )
    key = ((colour, f'estimated ({name})'), ('ink', 'measured'))
    wide = _trace(target, (1080, 220), 1.0, colour)
    narrow = _trace(target, (360, 200), 0.3, colour)
    return Figure(f'{title_of(target).capitalize()} over time', caption, wide, key, narrow)


def _trace(
    target: metrics.TargetErrors, size: tuple[int, int], part: float, colour: str
) -> tuple[Plot, Plot]:
    time = target.time_s - float(np.nanmin(target.time_s))
    end = part * float(np.nanmax(time)) or 1.0
    rows = _subsample(np.flatnonzero(time <= end), 1200)
    step = np.diff(time[rows], prepend=time[rows][:1])
    usual = np.median(step[step > 0]) if (step > 0).any() else 1.0
    broken = np.where(step > 20 * usual, np.nan, time[rows])  # no line bridges long pauses
    truth, guess = target.truth[rows, 0], target.estimate[rows, 0]
    error, sigma = target.error[rows, 0], np.sqrt(target.variance[rows, 0])
    upper = Plot((0.0, end), span_of(np.concatenate([truth, guess])), '', 'force (N)', size,
                 description='Estimated and measured force over time')  # fmt: skip
    upper.band(broken, guess - sigma, guess + sigma, f'band {colour}')
    upper.line(broken, truth, 'line ink')
    upper.line(broken, guess, f'line {colour}')
    lower = _error_plot((0.0, end), error, ('time (s)', 'error (N)'), (size[0], 150),
                        'Error of the force over time', 99.5)  # fmt: skip
    lower.band(broken, -sigma, sigma, f'band {colour}')
    lower.line(broken, error, f'line {colour}')
    return upper, lower


def sigma_calibration(targets: Sequence[metrics.TargetErrors]) -> Figure:
    """Share of errors within k sigma against what a normal distribution has there."""
    expected = np.linspace(0, 1, 41)
    limits = ndtri(0.5 + expected[:-1] / 2)
    plot = Plot((0, 100), (0, 100), 'stated (%)', 'found (%)',
                description='Found against stated share of errors within k sigma')  # fmt: skip
    for groups in {target.coverage.groups for target in targets}:
        low, high = np.transpose([metrics.coverage_range(share, groups) for share in expected])
        plot.band(100 * expected, 100 * low, 100 * high, 'band ink')
    for i, target in enumerate(targets[:4]):
        stated = target.variance > 0
        ratio = np.abs(target.judged[stated] / np.sqrt(target.variance[stated]))
        ratio = np.sort(ratio[np.isfinite(ratio)])
        if len(ratio):
            share = np.searchsorted(ratio, limits, side='right') / len(ratio)
            plot.line(100 * expected, 100 * np.append(share, 1.0), f'line c{i}')
    plot.rule(100 * metrics.ONE_SIGMA, '1 sigma')
    measured = '; '.join(
        f'{title_of(t)} {100 * t.coverage.share:.0f} % ({_verdict(t.coverage)}: accepted '
        f'{100 * t.coverage.low:.0f}–{100 * t.coverage.high:.0f} %, {t.coverage.groups} groups)'
        for t in targets
    )
    caption = (
        f'Inside one sigma: {measured}. On the diagonal the stated errors are the real ones; '
        'what is accepted is grey.'
    )
    key = tuple((f'c{i}', title_of(t)) for i, t in enumerate(targets[:4]))
    return Figure('Are the covariances honest?', caption, (plot,), key)


def speed(points: Mapping[str, Span], unit: str, colours: Mapping[str, str]) -> Figure:
    """Error of every estimator against its time per frame (us)."""
    times, errors = np.array(list(points.values())).T
    plot = Plot((times.min() / 2.5, times.max() * 4), (0, 1.25 * errors.max() or 1.0),
                'time per frame (µs)', unit, log_x=True,
                description='Error against time per frame')  # fmt: skip
    placed: list[tuple[float, float]] = []  # labels, in pixels
    for name in sorted(points, key=lambda name: points[name][1]):
        us, error = points[name]
        x, y = float(plot.x(us)), float(plot.y(error)) - 17
        while any(abs(x - a) < 84 and abs(y - b) < LINE for a, b in placed):
            y -= 1.0
        placed.append((x, y))
        plot.mark(us, error, int(colours[name][1:]), f'fill {colours[name]}')
        plot.text(us, error, name, 'middle', shift=y - float(plot.y(error)))
    fastest, best = (min(points, key=lambda name: points[name][k]) for k in (0, 1))
    least, short = (tuple(map(rounded, points[name])) for name in (best, fastest))
    caption = f'{best} errs least ({least[1]}) at {least[0]} µs a frame'
    if fastest != best:
        caption += f'; {fastest} is fastest ({short[0]} µs) and errs {short[1]}'
    return Figure('Speed against error', f'{caption}. Down and left is better.', (plot,))


def confusion_plot(table: Array, name: str, description: str) -> Plot:
    """Share (n, n) (%) of each true class (row) that is named as each, in four shades."""
    ends = (-0.5, len(table) - 0.5)
    plot = Plot(ends, ends, f'named {name}', f'true {name}', (380, 380), integer_ticks=True,
                description=description)  # fmt: skip
    true, named = np.nonzero(np.nan_to_num(table) >= 0.5)
    shades = np.searchsorted(SHADES[1:], table[true, named]) + 1
    each = zip(true.tolist(), named.tolist(), table[true, named].tolist(), strict=True)
    titles = [f'{name} {a} named {b}: {share:.1f} %' for a, b, share in each]
    kinds = [f's{shade}' for shade in shades]
    plot.boxes(named.astype(float), true.astype(float), 0.94, kinds, titles)
    for row, column in np.argwhere(table >= 0.5).tolist() if len(table) <= 16 else ():
        plot.text(column, row, f'{table[row, column]:.3g}', 'middle')
    return plot


def confusion_figure(errors: metrics.ClassErrors) -> Figure:
    """Share of each true class that is named as each, and what is confused most."""
    table, name = np.nan_to_num(errors.table), errors.name
    plot = confusion_plot(table, name, f'{name} named against true {name}')
    text = f'{rounded(errors.right)} % of {len(errors.true)} rows are named rightly'
    if abstained := errors.hits['abstained']:
        text += f', {rounded(100 * abstained / len(errors.true))} % are not named'
    wrong = table - np.diag(np.diag(table))
    worst = [divmod(int(k), len(table)) for k in np.argsort(wrong, axis=None)[:-4:-1]]
    if pairs := [f'{a} for {b} ({wrong[a, b]:.0f} %)' for a, b in worst if wrong[a, b] >= 0.5]:
        text += f'; taken most often: {", ".join(pairs)}'
    caption = f'{text}. A row adds up to 100 % with those not named.'
    return Figure(f'Which {name} is taken for which', caption, (plot,), shade_key(SHADES, '%')[1:])


def contact_sentence(errors: metrics.ContactErrors) -> str:
    """Contacts that are found, false ones at rest, and the time until a release is reported."""
    rest, firm, said = int((~errors.touched).sum()), int(errors.firm.sum()), []
    if firm:
        frames = f'{firm:,} frames of {metrics.LEAST_TOUCH:g} N or more'
        said.append(f'{rounded(errors.found)} % of {frames} are found')
    if rest:
        said.append(f'{rounded(errors.contact_at_rest)} % of {rest:,} at rest are called contacts')
    if len(errors.release_s):
        half, most = (quantity(one, 's') for one in np.percentile(errors.release_s, [50, 95]))
        said.append(f'a release is reported after {half}, 95 % within {most}')
    return '; '.join(said)


def contact(errors: metrics.ContactErrors) -> Figure:
    """Reported contact against truth, and what a threshold of the estimated force would do."""
    plots = [confusion_plot(errors.table, 'contact (0 none, 1)', 'Reported contact, truth')]
    text, shades = contact_sentence(errors), shade_key(SHADES, '%')[1:]
    rest, touched = (
        np.sort(one[np.isfinite(one)])
        for one in (errors.estimate[~errors.touched], errors.estimate[errors.firm])
    )
    if not (len(rest) and len(touched)):
        return Figure('Is something touching?', f'{text}.', tuple(plots), shades)
    limits = np.linspace(0.0, 10 * metrics.LEAST_TOUCH, 101)
    alarms = 100 - 100 * np.searchsorted(rest, limits, side='right') / len(rest)
    missed = 100 * np.searchsorted(touched, limits) / len(touched)
    top = 1.15 * float(max(alarms.max(), missed.max())) or 1.0
    plots.append(Plot((0.0, 10 * metrics.LEAST_TOUCH), (0, top), 'threshold of the force (N)',
                      'share of frames (%)', (360, 190),
                      description='False alarms and missed contacts by threshold'))  # fmt: skip
    for share, kind in ((alarms, 'line c1'), (missed, 'line c0')):
        plots[1].line(limits, share, kind)
    key = (*shades, ('c1', 'at rest, force above'), ('c0', 'touched, force below'))
    return Figure('Is something touching?', f'{text}.', tuple(plots), key)


def hysteresis(target: metrics.TargetErrors) -> Figure | None:
    """Mean error along the force, while it rises and while it falls."""
    truth, error = target.truth[:, 0], target.error[:, 0]
    low, high = (float(edge) for edge in np.nanpercentile(truth, [1, 99]))
    if not np.isfinite(target.time_s).any() or not high > low or len(truth) < 30:
        return None
    edges = np.linspace(low, high, 21)
    up, down = (_bin_means(truth[r], error[r], edges) for r in _directions(target))
    apart = np.abs(down - up)[np.isfinite(up) & np.isfinite(down)]
    if len(apart) < 6:
        return None
    words, centre = title_of(target), (edges[1:] + edges[:-1]) / 2
    plot = _error_plot((low, high), [up, down], (f'measured {words} (N)', 'mean error (N)'),
                       (360, 250), f'Error of rising and falling {words}')  # fmt: skip
    plot.line(centre, up, 'line c0')
    plot.line(centre, down, 'line c1')
    mean, worst = quantity(apart.mean(), 'N'), quantity(apart.max(), 'N')
    caption = (
        f'At the same load, estimates of rising and falling force differ by {mean} on '
        f'average, at worst {worst}: {rounded(100 * apart.max() / (high - low))} % of the range.'
    )
    key = (('c0', 'rising'), ('c1', 'falling'))
    return Figure(f'Hysteresis of {words}', caption, (plot,), key)


def _directions(target: metrics.TargetErrors) -> tuple[Bools, Bools]:
    """Rows (n,) on the way up and down in true force, without turns, holds there and pauses."""
    force, step = target.truth[:, 0], np.diff(target.time_s)
    usual = float(np.nanmedian(step[step > 0])) if (step > 0).any() else 0.0
    restart = np.append(True, ~((step > 0) & (step < 5.0 * usual)))
    band = dead_band(force)
    way = loading_signs(force, restart, band)
    begins = restart | (np.diff(way, prepend=0.0) != 0)
    run, first = np.cumsum(begins) - 1, np.flatnonzero(begins)
    high, low = (end.reduceat(force, first)[run] for end in (np.fmax, np.fmin))
    return (way > 0) & (force < high - band), (way < 0) & (force > low + band)


def drift(target: metrics.TargetErrors, colour: str, *, since_tare: bool = False) -> Figure | None:
    """Mean error over time, or since the latest tare, with its deviation and a line through it."""
    time = target.since_s if since_tare else target.time_s
    kept = np.isfinite(time) & np.isfinite(target.error[:, 0])
    time, error = time[kept], target.error[kept, 0]
    if len(time) < 120 or not np.ptp(time) > 0:
        return None
    time = time - time.min()
    edges = np.linspace(0, time.max(), 25)
    centre, words = (edges[1:] + edges[:-1]) / 2, title_of(target)
    mean, square = (_bin_means(time, values, edges) for values in (error, error**2))
    sigma = np.sqrt(np.maximum(square - mean**2, 0))
    slope, start = np.polyfit(time, error, 1)
    when = 'time since the tare (s)' if since_tare else 'time (s)'
    plot = _error_plot((0, float(time.max())), np.abs(mean) + sigma, (when, 'mean error (N)'),
                       (360, 250), f'Mean error of {words} over {when}')  # fmt: skip
    plot.band(centre, mean - sigma, mean + sigma, f'band {colour}')
    plot.line(centre, mean, f'line {colour}')
    plot.line(time[[0, -1]], start + slope * time[[0, -1]], 'line ink')
    moved = float(slope * time.max())
    caption = (
        f'Over {time.max():,.0f} s {"after a tare " * since_tare}the mean error moves by '
        f'{"+" if moved > 0 else ""}{quantity(moved, "N")} (straight line); '
        'the band is one standard deviation of the errors of each span.'
    )
    title = f'Error of {words} since the tare' if since_tare else f'Drift of {words}'
    return Figure(title, caption, (plot,))
