"""Plots as inline SVG whose colours are style-sheet variables: one drawing, light and dark.

Written out by hand: the drawings are small, their text is text, and nothing has to be installed.
"""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

LEFT, RIGHT, TOP, BOTTOM = 46.0, 14.0, 30.0, 42.0


def number(value: float) -> str:
    """A number as a label: few digits, a true minus."""
    return f'{value:.6g}'.replace('-', '−')


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round values that divide a range into about `count` steps."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((f * power for f in (1, 2, 2.5, 5, 10)), key=lambda s: abs(math.log(s / rough)))
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Decades of a range, with 2 and 5 where there are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    factors = (1,) if last - first > 3 else (1, 2, 5)
    ticks = [f * 10.0**n for n in range(first, last + 1) for f in factors]
    return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]


class Scale:
    """Values of a range to pixels."""

    def __init__(
        self, values: tuple[float, float], pixels: tuple[float, float], log: bool
    ) -> None:
        self.values, self.pixels, self.log = values, pixels, log

    def __call__(self, value: Array | float) -> Array:
        """Pixels of values."""
        low, high = self.values
        part = np.asarray(value, np.float64)
        if self.log:
            part, low, high = np.log(part), math.log(low), math.log(high)
        start, end = self.pixels
        return np.asarray(start + (part - low) / (high - low) * (end - start))

    def value(self, pixel: float) -> float:
        """The value at a pixel."""
        (low, high), (start, end) = self.values, self.pixels
        part = (pixel - start) / (end - start)
        return low * (high / low) ** part if self.log else low + part * (high - low)

    def ticks(self, count: int) -> list[float]:
        """Where to put labels."""
        return log_ticks(*self.values) if self.log else nice_ticks(*self.values, count)


class Plot:
    """One pair of axes; later marks lie over earlier ones.

    Parameters
    ----------
    x, y : tuple of float
        Ranges.
    x_label, y_label : str
        With units.
    size : tuple of int
        Width and height (pixels at full size).
    log_x, log_y : bool
        Logarithmic axes.
    told : str
        What the drawing shows, for those who cannot see it.
    whole : bool
        Labels stand at whole numbers alone.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        size: tuple[int, int] = (360, 270),
        log_x: bool = False,
        told: str = '',
        log_y: bool = False,
        whole: bool = False,
    ) -> None:
        self.size, self.told, self.whole = size, told, whole
        self.labels = x_label, y_label
        self.x = Scale(x, (LEFT, size[0] - RIGHT), log_x)
        self.y = Scale(y, (size[1] - BOTTOM, TOP), log_y)
        self._marks: list[str] = []
        self._over: list[str] = []

    @classmethod
    def plan(cls, x: tuple[float, float], y: tuple[float, float], label: str, told: str) -> Plot:
        """A plan view: one scale for both axes, `label` with the unit of both."""
        width = 360
        inner = width - LEFT - RIGHT
        height = inner * (y[1] - y[0]) / (x[1] - x[0]) + TOP + BOTTOM
        return cls(x, y, f'x {label}', f'y {label}', (width, round(height)), told=told)

    def line(self, x: Array, y: Array, kind: str) -> None:
        """A line of class `kind`; NaN breaks it."""
        self._marks.append(f'<path class="{kind}" d="{self._path(x, y)}"/>')

    def _path(self, x: Array, y: Array) -> str:
        """Path data of a polyline."""
        parts, command = [], 'M'
        for px, py in zip(self.x(x).tolist(), self.y(y).tolist(), strict=True):
            if math.isfinite(px) and math.isfinite(py):
                parts.append(f'{command}{px:.1f} {py:.1f}')
                command = 'L'
            else:
                command = 'M'
        return ''.join(parts)

    def band(self, x: Array, low: Array, high: Array, kind: str) -> None:
        """The area between two lines."""
        known = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        if known.sum() > 1:
            there, back = x[known], x[known][::-1]
            path = self._path(
                np.concatenate([there, back]), np.concatenate([low[known], high[known][::-1]])
            )
            self._marks.append(f'<path class="{kind}" d="{path}Z"/>')

    def dots(self, x: Array, y: Array, kind: str) -> None:
        """Round dots, as one path of lines without length."""
        pairs = zip(self.x(x).tolist(), self.y(y).tolist(), strict=True)
        path = ''.join(f'M{a:.1f} {b:.1f}h0' for a, b in pairs if math.isfinite(a + b))
        self._marks.append(f'<path class="dots {kind}" d="{path}"/>')

    def boxes(self, x: Array, y: Array, side: float, kinds: Sequence[str]) -> None:
        """Squares around places (side in units of x), each of its own class."""
        half = abs(float(self.x(side) - self.x(0.0))) / 2
        for px, py, kind in zip(self.x(x).tolist(), self.y(y).tolist(), kinds, strict=True):
            place = f'x="{px - half:.1f}" y="{py - half:.1f}"'
            size = f'width="{2 * half:.1f}" height="{2 * half:.1f}"'
            self._marks.append(f'<rect class="{kind}" {place} {size}/>')

    def bars(self, edges: Array, heights: Array, kind: str) -> None:
        """Bars of a histogram."""
        floor = float(self.y(0.0))
        for a, b, top in zip(edges[:-1], edges[1:], self.y(heights).tolist(), strict=True):
            left, right = float(self.x(a)), float(self.x(b))
            if floor - top > 0.05:
                place = f'x="{left + 0.5:.1f}" y="{top:.1f}"'
                size = f'width="{max(right - left - 1, 0.5):.1f}" height="{floor - top:.1f}"'
                self._marks.append(f'<rect class="{kind}" {place} {size}/>')

    def steps(self, edges: Array, heights: Array, kind: str) -> None:
        """Outline of a histogram."""
        self.line(np.repeat(edges, 2)[1:-1], np.repeat(heights, 2), kind)

    def mark(self, x: float, y: float, shape: int, kind: str) -> None:
        """One symbol; shapes differ for those who do not see colours."""
        a, b, r = float(self.x(x)), float(self.y(y)), 6.0
        shapes = (
            f'M{a - r} {b}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0Z',
            f'M{a - r} {b - r}h{2 * r}v{2 * r}h{-2 * r}Z',
            f'M{a} {b - r - 1}l{r + 1} {2 * r}h{-2 * r - 2}Z',
            f'M{a} {b - r - 2}l{r + 2} {r + 2}l{-r - 2} {r + 2}l{-r - 2} {-r - 2}Z',
        )
        self._over.append(f'<path class="{kind}" d="{shapes[shape % len(shapes)]}"/>')

    def rule(self, x: float, label: str, kind: str = 'rule', row: int = 0) -> None:
        """A vertical line with a label beside its top."""
        px = float(self.x(x))
        top, bottom = self.y.pixels[1], self.y.pixels[0]
        self._over.append(f'<path class="{kind}" d="M{px:.1f} {top}V{bottom}"/>')
        self.text(x, None, label, 'start', row=row)

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
        """Words at a place (`shift` pixels lower), or under the top of the plot without `y`."""
        px = float(self.x(x)) + {'start': 5, 'end': -5}.get(anchor, 0)
        py = TOP + 11 + 15 * row if y is None else float(self.y(y)) + 4 + shift
        if anchor == 'start' and px + 6.4 * len(words) > self.size[0]:
            px, anchor = px - 10, 'end'
        self._over.append(
            f'<text class="note {kind}" x="{px:.1f}" y="{py:.1f}" '
            f'text-anchor="{anchor}">{escape(words)}</text>'
        )

    def __str__(self) -> str:
        """The drawing."""
        width, height = self.size
        left, right = self.x.pixels
        bottom, top = self.y.pixels
        box = f'{left} {top} {right - left} {bottom - top}'
        inner = f'x="{left}" y="{top}" width="{right - left}" height="{bottom - top}"'
        return (
            f'<svg class="plot" viewBox="0 0 {width} {height}" role="img" '
            f'aria-label="{escape(self.told)}">{"".join(self._axes())}'
            f'<svg {inner} viewBox="{box}">{"".join(self._marks)}</svg>'
            f'{"".join(self._over)}</svg>'
        )

    def _ticks(self, scale: Scale, count: int) -> list[float]:
        """Where labels of an axis stand."""
        return [t for t in scale.ticks(count) if not self.whole or t == round(t)]

    def _axes(self) -> Iterable[str]:
        """Grid, labels of the ticks and names of the axes."""
        left, right = self.x.pixels
        bottom, top = self.y.pixels
        for tick in self._ticks(self.y, max(3, int((bottom - top) / 45))):
            py = float(self.y(tick))
            yield f'<path class="grid" d="M{left} {py:.1f}H{right}"/>'
            yield f'<text x="{left - 7}" y="{py + 4:.1f}" text-anchor="end">{number(tick)}</text>'
        for tick in self._ticks(self.x, max(2, int((right - left) / 65))):
            px = float(self.x(tick))
            yield f'<path class="tick" d="M{px:.1f} {bottom}v4"/>'
            at = f'x="{px:.1f}" y="{bottom + 17}"'
            yield f'<text {at} text-anchor="middle">{number(tick)}</text>'
        yield f'<path class="axis" d="M{left} {bottom}H{right}"/>'
        x_label, y_label = (escape(label) for label in self.labels)
        at = f'x="{right}" y="{bottom + 34}"'
        yield f'<text class="name" {at} text-anchor="end">{x_label}</text>'
        yield f'<text class="name" x="2" y="{top - 13}">{y_label}</text>'
