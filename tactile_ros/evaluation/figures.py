"""Figures of an evaluation as SVG, light and dark as the reader prefers, and as PNG.

The writer is our own: text stays text, colours are variables of `drawing.css`, and a drawing of
thousands of dots is one path. PNG files are rendered by resvg.
"""

from __future__ import annotations

import math
import re
import textwrap
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from tactile_ros.conditioning.loading_direction import dead_band, loading_signs
from tactile_ros.errors import MissingPackageError, TactileError
from tactile_ros.files import write_beside
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tactile_ros.evaluation.metrics import ClassErrors, Coverage, Spread, TargetErrors

STYLE = Path(__file__).with_name('drawing.css').read_text('utf-8')
LEFT, RIGHT, TOP, BOTTOM = 46.0, 14.0, 30.0, 42.0  # pixels around the axes
LETTER, LINE = 6.4, 15.0  # pixels of a letter and of a line of labels
MM = 1e3
Span = tuple[float, float]
NAMES = {
    'position': 'place',
    'force_z': 'normal force',
    'force_x': 'shear force x',
    'force_y': 'shear force y',
}


def rounded(value: float, digits: int = 3) -> str:
    """So many digits, of large numbers all before the point; a true minus.

    Examples
    --------
    >>> rounded(99.877), rounded(-73611.2)
    ('99.9', '−73,611')
    """
    whole = abs(value) >= min(10**digits, 1000)
    return (f'{value:,.0f}' if whole else f'{value:.{digits}g}').replace('-', '−')


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

    def _path(self, x: Array, y: Array) -> str:
        """Path data of a polyline, which NaN breaks."""
        parts, command = [], 'M'
        for px, py in self._pixels(x, y):
            shown = math.isfinite(px) and math.isfinite(py)
            parts.append(f'{command}{px:.1f} {py:.1f}' if shown else '')
            command = 'L' if shown else 'M'
        return ''.join(parts)

    def line(self, x: Array, y: Array, kind: str) -> None:
        """Draw a line of class `kind`; NaN breaks it."""
        self._marks.append(f'<path class="{kind}" d="{self._path(x, y)}"/>')

    def band(self, x: Array, low: Array, high: Array, kind: str) -> None:
        """Fill the area between two lines."""
        kept = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        if kept.sum() > 1:
            there, ends = np.append(x[kept], x[kept][::-1]), np.append(low[kept], high[kept][::-1])
            self._marks.append(f'<path class="{kind}" d="{self._path(there, ends)}Z"/>')

    def dots(self, x: Array, y: Array, kind: str) -> None:
        """Draw round dots, as one path of lines without length."""
        pixels = self._pixels(x, y)
        path = ''.join(f'M{a:.1f} {b:.1f}h0' for a, b in pixels if math.isfinite(a + b))
        self._marks.append(f'<path class="dots {kind}" d="{path}"/>')

    def _box(self, left: float, top: float, width: float, height: float, kind: str) -> None:
        place, size = f'x="{left:.1f}" y="{top:.1f}"', f'width="{width:.1f}" height="{height:.1f}"'
        self._marks.append(f'<rect class="{kind}" {place} {size}/>')

    def boxes(self, x: Array, y: Array, side: float, kinds: Sequence[str]) -> None:
        """Draw squares around places (side in units of x), each of its own class."""
        wide = abs(float(self.x(side) - self.x(0.0)))
        for (px, py), kind in zip(self._pixels(x, y), kinds, strict=True):
            self._box(px - wide / 2, py - wide / 2, wide, wide, kind)

    def bars(self, edges: Array, heights: Array, kind: str) -> None:
        """Draw the bars of a histogram."""
        floor, ends = float(self.y(0.0)), self.x(edges).tolist()
        for (left, right), top in zip(pairwise(ends), self.y(heights).tolist(), strict=True):
            if floor - top > 0.05:
                self._box(left + 0.5, top, max(right - left - 1, 0.5), floor - top, kind)

    def steps(self, edges: Array, heights: Array, kind: str) -> None:
        """Draw the outline of a histogram."""
        self.line(np.repeat(edges, 2)[1:-1], np.repeat(heights, 2), kind)

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
        self,
        x: float,
        y: float | None,
        words: str,
        anchor: str = 'start',
        kind: str = '',
        row: int = 0,
        shift: float = 0.0,
    ) -> None:
        """Write at a place (`shift` pixels lower), or under the top of the plot without `y`."""
        px = float(self.x(x)) + {'start': 5, 'end': -5}.get(anchor, 0)
        py = TOP + 11 + LINE * row if y is None else float(self.y(y)) + 4 + shift
        if anchor == 'start' and px + LETTER * len(words) > self.size[0]:
            px, anchor = px - 10, 'end'
        self._over.append(_text(px, py, words, f'note {kind}', anchor))

    def __html__(self) -> str:
        """The drawing as an element of a page."""
        (left, right), (bottom, top) = self.x.pixels, self.y.pixels
        box = f'{left} {top} {right - left} {bottom - top}'
        inner = f'x="{left}" y="{top}" width="{right - left}" height="{bottom - top}"'
        return (
            f'<svg class="plot" viewBox="0 0 {self.size[0]} {self.size[1]}" role="img" '
            f'aria-label="{escape(self.description)}">{"".join(self._axes())}'
            f'<svg {inner} viewBox="{box}">{"".join(self._marks)}</svg>'
            f'{"".join(self._over)}</svg>'
        )

    def _ticks(self, scale: Scale, spacing: float, fewest: int) -> Iterable[tuple[float, str]]:
        """Values and labels of an axis, about `spacing` pixels apart."""
        count = max(fewest, int(abs(scale.pixels[1] - scale.pixels[0]) / spacing))
        ticks = log_ticks(*scale.values) if scale.log else nice_ticks(*scale.values, count)
        kept = [tick for tick in ticks if not self.integer_ticks or tick == round(tick)]
        return ((tick, f'{tick:.6g}'.replace('-', '−')) for tick in kept)

    def _axes(self) -> Iterable[str]:
        """Grid, labels of the ticks and names of the axes."""
        (left, right), (bottom, top) = self.x.pixels, self.y.pixels
        for tick, label in self._ticks(self.y, 45, 3):
            py = float(self.y(tick))
            yield f'<path class="grid" d="M{left} {py:.1f}H{right}"/>'
            yield _text(left - 7, py + 4, label, '', 'end')
        for tick, label in self._ticks(self.x, 65, 2):
            px = float(self.x(tick))
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

    @property
    def drawing(self) -> str:
        """All plots, one under the other."""
        return ''.join(plot.__html__() for plot in self.plots)


def standalone(*plots: Plot, title: str = '', key: Sequence[tuple[str, str]] = ()) -> str:
    """Plots, one under the other, as a file (SVG) of its own with the look of reports."""
    margin = 16.0 if title else 0.0
    width = max(plot.size[0] for plot in plots)
    parts, y = [], margin
    for line in textwrap.wrap(title, width // 9):
        parts.append(_text(margin, y + 15, line, 'headline'))
        y += 22
    x = margin
    for kind, words in key:
        if x > margin and x + 18 + LETTER * len(words) > width + margin:
            x, y = margin, y + 18
        place = f'x="{x}" y="{y + 3}" width="12" height="12" rx="3"'
        parts.append(f'<rect class="fill {kind}" {place}/>')
        parts.append(_text(x + 18, y + 13, words, ''))
        x += 32 + LETTER * len(words)
    y += (26 if key else 0) + (8 if title else 0)
    for plot in plots:
        place = f'y="{y}" width="{plot.size[0]}" height="{plot.size[1]}" overflow="visible"'
        parts.append(plot.__html__().replace('class="plot"', f'x="{margin}" {place}', 1))
        y += plot.size[1]
    size = f'{width + 2 * margin:g}', f'{y + margin:g}'
    description = escape('; '.join(plot.description for plot in plots))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" '
        f'class="plot" viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="{description}">'
        f'<style>{STYLE}</style><rect width="100%" height="100%" fill="var(--card)"/>'
        f'{"".join(parts)}</svg>\n'
    )


def check_png() -> None:
    """Raise MissingPackageError where no PNG with text could be written."""
    try:
        import resvg_py
    except ImportError as error:
        msg = 'pictures need resvg: pip install resvg-py'
        raise MissingPackageError(msg) from error
    blank = '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20"><style>' + STYLE
    shown = (f'{blank}</style>{text}</svg>' for text in ('', '<text y="15">M</text>'))
    if len({resvg_py.svg_to_bytes(svg_string=_light(svg)) for svg in shown}) == 1:
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
        return write_beside(path, resvg_py.svg_to_bytes(svg_string=_light(svg), zoom=2))
    except ValueError as error:
        msg = f'{path} cannot be drawn: {error}'
        raise TactileError(msg) from error


def write_figures(folder: Path, figures: Iterable[Figure], prefix: str = '') -> Iterable[Path]:
    """Write every figure as PNG under its headline; yield each path when it is there."""
    for figure in figures:
        svg = standalone(*figure.plots, title=figure.title, key=figure.key)
        yield write_png(folder / f'{file_name(f"{prefix} {figure.title}")}.png', svg)


def file_name(title: str) -> str:
    """A headline as the name of a file.

    Examples
    --------
    >>> file_name('Place, unseen points: (mm)')
    'place_unseen_points_mm'
    """
    return re.sub(r'[^a-z0-9]+', '_', title.lower()).strip('_')


def title_of(target: TargetErrors) -> str:
    """Name of a target in words."""
    return NAMES.get(target.name, target.name.replace('_', ' '))


def shown(target: TargetErrors) -> float:
    """The figure that stands for a target: mean place error in mm, or RMSE in N."""
    return MM * target.spread.mean if target.name == 'position' else target.spread.rms


def _headline(target: TargetErrors, rest: str) -> str:
    words = title_of(target)
    return f'{words[0].upper()}{words[1:]} {rest}'


def _accepted(coverage: Coverage) -> str:
    return f'{100 * coverage.low:.0f}–{100 * coverage.high:.0f} %'


def _span(values: Array) -> Span:
    """Range of values with some air."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    air = 0.04 * (high - low) or 1.0
    return low - air, high + air


def _around_zero(values: npt.ArrayLike, air: float, percentile: float = 100) -> Span:
    """Range that most magnitudes fit into, on both sides of zero."""
    top = air * float(np.nanpercentile(np.abs(values), percentile)) or 1.0
    return -top, top


def _subsample(rows: Integers, most: int) -> Integers:
    """At most so many rows, evenly taken."""
    return rows[np.linspace(0, len(rows) - 1, most).astype(int)] if len(rows) > most else rows


def _bin_means(x: Array, values: Array, edges: Array) -> Array:
    """Mean in each bin of x; NaN where there are fewer than five values."""
    kept = np.isfinite(values) & (x >= edges[0]) & (x < edges[-1])
    place = np.searchsorted(edges, x[kept], side='right') - 1
    count = np.bincount(place, minlength=len(edges) - 1)
    total = np.bincount(place, values[kept], minlength=len(edges) - 1)
    return np.where(count >= 5, total / np.maximum(count, 1), np.nan)


def place_map(target: TargetErrors, chips: Array) -> Figure:
    """Mean error at every touched place in plan view; chips (t, 3) (m) as crosses."""
    x, y, mean = _place_means(target)
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
    plot.boxes(x, y, pitch * 0.94, [f's{level}' for level in np.searchsorted(limits, mean)])
    for a, b in (chips[:, :2] * MM).tolist():
        if x_span[0] <= a <= x_span[1] and y_span[0] <= b <= y_span[1]:
            plot.text(a, b, '+', 'middle', 'chip')
    bounds = ['0', *(f'{limit:g}' for limit in limits)]
    words = [*(f'{a}–{b}' for a, b in pairwise(bounds)), f'> {bounds[-1]} mm']
    caption = f'{len(x)} places{_rim_sentence(x, y, mean)} Crosses: chips.'
    key = tuple((f's{i}', word) for i, word in enumerate(words))
    return Figure('Where on the pad it errs', caption, (plot,), key)


def _place_means(target: TargetErrors) -> tuple[Array, Array, Array]:
    """Touched places (mm) and the mean error (mm) at each."""
    kept = np.isfinite(target.size)
    plane, size = target.truth[kept], target.size[kept]
    _, first, place = np.unique(np.round(plane, 5), axis=0, return_index=True, return_inverse=True)
    place = place.reshape(-1)
    mean = np.bincount(place, size) / np.bincount(place)
    return plane[first, 0] * MM, plane[first, 1] * MM, np.asarray(mean * MM)


def _rim_sentence(x: Array, y: Array, mean: Array) -> str:
    """Mean error inside and in the outer tenth of the pad."""
    depth = np.minimum.reduce([x - x.min(), x.max() - x, y - y.min(), y.max() - y])
    rim = depth < 0.1 * max(float(np.ptp(x)), float(np.ptp(y)))
    if not rim.any() or rim.all():
        return '.'
    inner, outer = float(mean[~rim].mean()), float(mean[rim].mean())
    return (
        f': {inner:.2f} mm on average inside, {outer:.2f} mm in the outer tenth; '
        f'at worst {mean.max():.2f} mm.'
    )


def place_histogram(targets: Mapping[str, TargetErrors], colours: Mapping[str, str]) -> Figure:
    """Distribution of the place error by estimator; all but the first as outlines."""
    first, *others = list(targets)[:4]
    sizes = {n: targets[n].size[np.isfinite(targets[n].size)] * MM for n in (first, *others)}
    edges = np.linspace(0, max(float(np.percentile(size, 98)) for size in sizes.values()), 36)
    shares = {name: 100 * np.histogram(v, edges)[0] / len(v) for name, v in sizes.items()}
    plot = Plot(
        (0, edges[-1]), (0, 1.12 * max(float(share.max()) for share in shares.values())),
        'error in the plane (mm)', 'share of frames (%)',
        description='Distribution of the place error',
    )  # fmt: skip
    plot.bars(edges, shares[first], f'fill {colours[first]}')
    for name in others:
        plot.steps(edges, shares[name], f'line {colours[name]}')
    spread = targets[first].spread
    plot.rule(MM * spread.p50, f'half below {MM * spread.p50:.2f}')
    plot.rule(MM * spread.p95, f'95 % below {MM * spread.p95:.2f}', row=1)
    caption = f'{first}: {MM * spread.mean:.2f} mm on average, worst {MM * spread.largest:.1f} mm.'
    if len(targets) > 1:
        best = min(list(targets)[1:], key=lambda name: targets[name].spread.mean)
        caption += f' {best}: {MM * targets[best].spread.mean:.2f} mm.'
    key = tuple((colours[name], name) for name in sizes)
    return Figure('How far off the place is', caption, (plot,), key)


def force_scatter(target: TargetErrors, colour: str) -> Figure:
    """Estimate, and its error, against truth with the stated one-sigma band."""
    truth, guess, error = target.truth[:, 0], target.estimate[:, 0], target.error[:, 0]
    kept, words = np.isfinite(guess), title_of(target)
    some = _subsample(np.flatnonzero(kept), 2500)
    span = _span(np.concatenate([truth[kept], guess[kept]]))
    diagonal = np.array(span)
    above = Plot(span, span, '', 'estimated (N)', (360, 250),
                 description=f'Estimated against measured {words}')  # fmt: skip
    above.line(diagonal, diagonal, 'rule')
    above.dots(truth[some], guess[some], colour)
    below = Plot(
        span, _around_zero(error[kept], 1.15, 99.5), f'measured {words} (N)', 'error (N)',
        (360, 170), description=f'Error of {words} against its size',
    )  # fmt: skip
    centre, sigma = binned_sigma(truth[kept], target.variance[kept, 0])
    below.band(centre, -sigma, sigma, f'band {colour}')
    below.line(diagonal, np.zeros(2), 'rule')
    below.dots(truth[some], error[some], colour)
    share = target.coverage
    caption = f'RMSE {target.spread.rms:.2f} N over {target.spread.count} frames.'
    if share.count:
        verdict = 'as it should' if share.honest else f'accepted {_accepted(share)}'
        caption += (
            f' The band is the stated sigma: {100 * share.share:.0f} % of errors lie inside '
            f'({verdict}; {share.groups} groups).'
        )
    return Figure(_headline(target, 'against the scale'), caption, (above, below))


def binned_sigma(truth: Array, variance: Array, bins: int = 24) -> tuple[Array, Array]:
    """Root mean stated variance along the truth: centres and sigmas of bins of equal counts."""
    kept = np.isfinite(truth) & np.isfinite(variance)
    truth, variance = truth[kept], variance[kept]
    if len(np.unique(truth)) < 2:
        return np.zeros(0), np.zeros(0)
    edges = np.unique(np.percentile(truth, np.linspace(0, 100, bins + 1)))
    within = np.searchsorted(edges[1:-1], truth, side='right')
    count = np.bincount(within)
    filled = count > 0
    centre, mean = (
        np.bincount(within, values)[filled] / count[filled] for values in (truth, variance)
    )
    return centre, np.sqrt(mean)


def force_trace(target: TargetErrors, name: str, colour: str) -> Figure | None:
    """Estimate of an estimator by name and truth over time, and the error under them."""
    if not np.isfinite(target.time_s).any():
        return None
    caption = (
        f'At worst {target.spread.largest:.2f} N off. The band is the stated sigma about zero: '
        'honest errors leave it a third of the time.'
    )
    key = ((colour, f'estimated ({name})'), ('ink', 'measured'))
    wide = _trace(target, (1080, 220), 1.0, colour)
    narrow = _trace(target, (360, 200), 0.3, colour)
    return Figure(_headline(target, 'over time'), caption, wide, key, narrow)


def _trace(
    target: TargetErrors, size: tuple[int, int], part: float, colour: str
) -> tuple[Plot, Plot]:
    """Trace of the first part of the time, and the error with its band under it."""
    time = target.time_s - float(np.nanmin(target.time_s))
    end = part * float(np.nanmax(time)) or 1.0
    rows = _subsample(np.flatnonzero(time <= end), 1200)
    step = np.diff(time[rows], prepend=time[rows][:1])
    usual = np.median(step[step > 0]) if (step > 0).any() else 1.0
    broken = np.where(step > 20 * usual, np.nan, time[rows])  # no line bridges long pauses
    truth, guess = target.truth[rows, 0], target.estimate[rows, 0]
    error, sigma = target.error[rows, 0], np.sqrt(target.variance[rows, 0])
    upper = Plot((0.0, end), _span(np.concatenate([truth, guess])), '', 'force (N)', size,
                 description='Estimated and measured force over time')  # fmt: skip
    upper.band(broken, guess - sigma, guess + sigma, f'band {colour}')
    upper.line(broken, truth, 'line ink')
    upper.line(broken, guess, f'line {colour}')
    lower = Plot((0.0, end), _around_zero(error, 1.15, 99.5), 'time (s)', 'error (N)',
                 (size[0], 150), description='Error of the force over time')  # fmt: skip
    lower.band(time[rows], -sigma, sigma, f'band {colour}')
    lower.line(np.array([0.0, end]), np.zeros(2), 'rule')
    lower.line(broken, error, f'line {colour}')
    return upper, lower


def sigma_calibration(targets: Sequence[TargetErrors]) -> Figure:
    """Share of errors within k sigma against what a normal distribution has there."""
    expected = np.linspace(0, 1, 41)
    limits = ndtri(0.5 + expected[:-1] / 2)
    plot = Plot((0, 100), (0, 100), 'stated (%)', 'found (%)',
                description='Found against stated share of errors within k sigma')  # fmt: skip
    ends = np.array([0.0, 100.0])
    plot.band(ends, ends - 5, ends + 5, 'band ink')
    for i, target in enumerate(targets[:4]):
        stated = target.variance > 0
        ratio = np.abs(target.error[stated] / np.sqrt(target.variance[stated]))
        ratio = np.sort(ratio[np.isfinite(ratio)])
        if len(ratio):
            share = np.searchsorted(ratio, limits, side='right') / len(ratio)
            plot.line(100 * expected, 100 * np.append(share, 1.0), f'line c{i}')
    plot.rule(100 * 0.6827, '1 sigma')
    measured = '; '.join(
        f'{title_of(t)} {100 * t.coverage.share:.0f} % (accepted {_accepted(t.coverage)}, '
        f'{t.coverage.groups} groups)'
        for t in targets
    )
    caption = (
        f'Inside one sigma: {measured}. On the diagonal the stated errors are the real ones; '
        'the grey band is 5 points wide on either side.'
    )
    key = tuple((f'c{i}', title_of(t)) for i, t in enumerate(targets[:4]))
    return Figure('Are the covariances honest?', caption, (plot,), key)


def speed(points: Mapping[str, Span], unit: str, colours: Mapping[str, str]) -> Figure:
    """Error of every estimator against its time per frame (us)."""
    times, errors = np.array(list(points.values())).T
    plot = Plot((times.min() / 2.5, times.max() * 4), (0, 1.25 * errors.max()),
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
    best = min(points, key=lambda name: points[name][1])
    fastest = min(points, key=lambda name: points[name][0])
    caption = f'{best} errs least ({points[best][1]:.2f}) at {points[best][0]:.0f} µs a frame'
    if fastest != best:
        us, error = points[fastest]
        caption += f'; {fastest} is fastest ({us:.0f} µs) and errs {error:.2f}'
    return Figure('Speed against error', f'{caption}. Down and left is better.', (plot,))


def latency_histogram(latency_s: Array, spread: Spread, lost: str) -> Figure:
    """Distribution of the time from acquisition to contact (n,) (s)."""
    top = 1.3 * spread.p99 * MM
    edges = np.linspace(0, top, 46)
    share = 100 * np.histogram(latency_s * MM, edges)[0] / len(latency_s)
    plot = Plot((0, top), (0, 1.15 * float(share.max())), 'from acquisition to contact (ms)',
                'share of frames (%)', description='Distribution of the latency')  # fmt: skip
    plot.bars(edges, share, 'fill c2')
    plot.rule(spread.p50 * MM, f'half below {spread.p50 * MM:.2f} ms')
    plot.rule(spread.p99 * MM, f'99 % below {spread.p99 * MM:.2f} ms', row=1)
    caption = f'{spread.count} contacts, at worst {spread.largest * MM:.1f} ms; {lost}.'
    return Figure('How late a contact is', caption, (plot,))


CONFUSION_KEY = (('s1', '0.5–2'), ('s2', '2–5'), ('s3', '5–15'), ('s4', '> 15 %'))


def confusion_plot(table: Array, name: str, description: str) -> Plot:
    """Share (n, n) (%) of each true class (row) that is named as each, in four shades."""
    ends = (-0.5, len(table) - 0.5)
    plot = Plot(ends, ends, f'named {name}', f'true {name}', (380, 380), integer_ticks=True,
                description=description)  # fmt: skip
    true, named = np.nonzero(np.nan_to_num(table) >= 0.5)
    shades = np.searchsorted((2.0, 5.0, 15.0), table[true, named]) + 1
    plot.boxes(named.astype(float), true.astype(float), 0.94, [f's{shade}' for shade in shades])
    return plot


def confusion_figure(errors: ClassErrors) -> Figure:
    """Share of each true class that is named as each, and what is confused most."""
    table, name = np.nan_to_num(errors.table), errors.name
    plot = confusion_plot(table, name, f'{name} named against true {name}')
    for row, column in np.argwhere(table >= 0.5).tolist() if len(table) <= 16 else ():
        plot.text(column, row, f'{table[row, column]:.0f}', 'middle')
    text = f'{errors.right:.1f} % of {errors.count} rows are named rightly'
    if errors.abstained:
        text += f', {errors.abstained:.1f} % are not named'
    wrong = table - np.diag(np.diag(table))
    worst = [divmod(int(k), len(table)) for k in np.argsort(wrong, axis=None)[:-4:-1]]
    if pairs := [f'{a} for {b} ({wrong[a, b]:.0f} %)' for a, b in worst if wrong[a, b] >= 0.5]:
        text += f'; taken most often: {", ".join(pairs)}'
    caption = f'{text}. A row adds up to 100 % with those not named.'
    return Figure(f'Which {name} is taken for which', caption, (plot,), CONFUSION_KEY)


def hysteresis(target: TargetErrors) -> Figure | None:
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
    plot = Plot(
        (low, high), _around_zero([up, down], 1.2), f'measured {words} (N)', 'mean error (N)',
        (360, 250), description=f'Error of rising and falling {words}',
    )  # fmt: skip
    plot.line(edges[[0, -1]], np.zeros(2), 'rule')
    plot.line(centre, up, 'line c0')
    plot.line(centre, down, 'line c1')
    caption = (
        f'At the same load, rising and falling force are told {apart.mean():.2f} N apart on '
        f'average, at worst {apart.max():.2f} N: {100 * apart.max() / (high - low):.1f} % of the '
        'range.'
    )
    key = (('c0', 'rising'), ('c1', 'falling'))
    return Figure(f'Hysteresis of {words}', caption, (plot,), key)


def _directions(target: TargetErrors) -> tuple[Bools, Bools]:
    """Rows (n,) on the way up and down in true force, without turns, holds there and pauses."""
    force, step = target.truth[:, :1], np.diff(target.time_s)
    usual = float(np.nanmedian(step[step > 0])) if (step > 0).any() else 0.0
    restart = np.append(True, ~((step > 0) & (step < 5.0 * usual)))
    way, band = loading_signs(force, restart)[:, 0], dead_band(force)[0]
    begins = restart | (np.diff(way, prepend=0.0) != 0)
    run, first = np.cumsum(begins) - 1, np.flatnonzero(begins)
    high = np.fmax.reduceat(force[:, 0], first)[run]
    low = np.fmin.reduceat(force[:, 0], first)[run]
    rising = (way > 0) & (force[:, 0] < high - band)
    return rising, (way < 0) & (force[:, 0] > low + band)


def drift(target: TargetErrors, colour: str) -> Figure | None:
    """Mean error over time with its deviation, and the slope of a line through it."""
    kept = np.isfinite(target.time_s) & np.isfinite(target.error[:, 0])
    time, error = target.time_s[kept], target.error[kept, 0]
    if len(time) < 120 or not np.ptp(time) > 0:
        return None
    time = time - time.min()
    edges = np.linspace(0, time.max(), 25)
    centre, ends = (edges[1:] + edges[:-1]) / 2, np.array([0.0, time.max()])
    mean, square = (_bin_means(time, values, edges) for values in (error, error**2))
    sigma = np.sqrt(np.maximum(square - mean**2, 0))
    slope, start = np.polyfit(time, error, 1)
    words = title_of(target)
    plot = Plot(
        (0, float(time.max())), _around_zero(np.abs(mean) + sigma, 1.15), 'time (s)',
        'mean error (N)', (360, 250), description=f'Mean error of {words} over time',
    )  # fmt: skip
    plot.band(centre, mean - sigma, mean + sigma, f'band {colour}')
    plot.line(ends, np.zeros(2), 'rule')
    plot.line(centre, mean, f'line {colour}')
    plot.line(time[[0, -1]], start + slope * time[[0, -1]], 'line ink')
    moved = f'{slope * time.max():+.2f}'.replace('-', '−')
    caption = (
        f'Over {time.max():,.0f} s the mean error moves by {moved} N (straight line); '
        'the band is one standard deviation of the errors of each span.'
    )
    return Figure(f'Drift of {words}', caption, (plot,))
