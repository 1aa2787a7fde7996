"""Pieces that all reports are made of: the document, key figures, lists, drawings, facts."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from tactile_ros.evaluation.stylesheet import STYLE

MOST_DIGITS = 12

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tactile_ros.evaluation.figure import Figure


def document(title: str, body: Iterable[str]) -> str:
    """The whole file; `title` is plain text, `body` is HTML."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="color-scheme" content="light dark"><title>{escape(title)}</title>'
        f'<style>{STYLE}</style></head><body><main>{"".join(body)}</main></body></html>\n'
    )


def tiles(figures: Iterable[tuple[str, str, str]]) -> str:
    """Key figures as (value, unit, words)."""
    found = ''.join(
        f'<div><dd>{escape(value)} <small>{escape(unit)}</small></dd>'
        f'<dt>{escape(words)}</dt></div>'
        for value, unit, words in figures
    )
    return f'<dl class="figures">{found}</dl>'


def listed(sentences: Sequence[str], kind: str) -> str:
    """Sentences one under the other."""
    if not sentences:
        return ''
    items = ''.join(f'<li>{escape(sentence)}</li>' for sentence in sentences)
    return f'<ul class="{kind}">{items}</ul>'


def drawn(figure: Figure) -> str:
    """One drawing with its headline, key and finding."""
    drawing = figure.drawing
    if figure.narrow:
        drawing = (
            f'<div class="only-wide">{drawing}</div><div class="only-narrow">{figure.narrow}</div>'
        )
    wide = ' class="wide"' if figure.narrow else ''
    return (
        f'<figure{wide}><h3>{escape(figure.title)}</h3>{key_of(figure)}{drawing}'
        f'<figcaption>{escape(figure.caption)}</figcaption></figure>'
    )


def key_of(figure: Figure) -> str:
    """What the colours of a drawing mean."""
    key = ''.join(f'<li><i class="{kind}"></i>{escape(words)}</li>' for kind, words in figure.key)
    return f'<ul class="key">{key}</ul>' if key else ''


def facts(told: Mapping[str, str]) -> str:
    """Names and values, such as versions."""
    found = ''.join(f'<dt>{escape(k)}</dt><dd>{escape(v)}</dd>' for k, v in told.items())
    return f'<dl class="facts">{found}</dl>'


def number(value: float | None, beside: float | None = None) -> str:
    """A figure with the digits that it deserves: three, or as many as tell it from another.

    Examples
    --------
    >>> number(99.877), number(99.877, beside=99.9), number(73611.2)
    ('99.9', '99.88', '73,611')
    """
    if value is None:
        return '–'
    text = _rounded(value, 3)
    for digits in range(4, MOST_DIGITS):
        if beside is None or value == beside or text != _rounded(beside, digits - 1):
            break
        text = _rounded(value, digits)
    return text


def unit_of(unit: str) -> str:
    """A unit as a page writes it; empty: a plain number."""
    return {'1': '', 'us': 'µs', 'uT': 'µT'}.get(unit, unit)


def deviation(value: float | None) -> str:
    """A standard deviation behind its figure, with one digit; empty: none, or 0.

    Examples
    --------
    >>> deviation(0.0123), deviation(11.8), deviation(None)
    (' ± 0.01', ' ± 12', '')
    """
    return f' ± {_rounded(value, 1)}' if value else ''


def _rounded(value: float, digits: int) -> str:
    """So many digits, of large numbers all before the point; a true minus."""
    whole = abs(value) >= 10**digits
    text = f'{value:,.0f}' if whole or abs(value) >= 1000 else f'{value:.{digits}g}'
    return text.replace('-', '−')
