# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fields of configs and connections: written once with unit and range, checked once at the door.

Each function makes one dataclass field whose metadata say help, unit, range, shape and choices;
`admit` holds every value to it, and nodes declare their ROS parameters by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import Field, field, fields
from typing import cast

import numpy as np
import numpy.typing as npt

from tactile_ros.types.frame import Array, Outline, as_shape

Outlines = tuple[Outline, ...]
Length = int | str  # of an axis: -1 any, 't' as many as there are taxels
ANY = (-np.inf, np.inf)
TURN_ERROR = 1e-3


def number(
    default: float, text: str, unit: str = '1', low: float = 0, high: float = 1e12
) -> float:
    """Field of one number between two bounds."""
    return field(default=default, metadata={'help': text, 'unit': unit, 'range': (low, high)})


def whole(default: int, text: str, low: int = 1, high: int = 1_000_000) -> int:
    """Field of one whole number between two bounds."""
    return field(default=default, metadata={'help': text, 'range': (low, high)})


def switch(default: bool, text: str) -> bool:
    """Field that is true or false."""
    return field(default=default, metadata={'help': text})


def text_of(default: str, text: str, choices: tuple[str, ...] = ()) -> str:
    """Field of a text, free or one of several."""
    chosen = {'choices': choices} if choices else {}
    return field(default=default, metadata={'help': text, **chosen})


def array(
    default: npt.ArrayLike, text: str, unit: str, shape: tuple[Length, ...],
    low: float = -np.inf, high: float = np.inf,
) -> Array:  # fmt: skip
    """Field of numbers in a shape, all finite and between two bounds."""
    given = np.array(default, np.float64)
    about = {'help': text, 'unit': unit, 'shape': shape, 'range': (low, high)}
    return field(default_factory=given.copy, metadata=about)


def maybe_array(
    text: str, unit: str, shape: tuple[Length, ...], low: float = -np.inf, high: float = np.inf
) -> Array | None:
    """Field of numbers in a shape that may be left out."""
    about = {'help': text, 'unit': unit, 'shape': shape, 'range': (low, high)}
    return field(default=None, metadata=about)


def each_channel(default: npt.ArrayLike | None, text: str, unit: str) -> float | Array | None:
    """Field of one number, or one for each channel; None: unknown."""
    about = {'help': text, 'unit': unit, 'per_channel': True, 'range': (0, np.inf)}
    if default is None:
        return field(default=None, metadata=about)
    return field(default_factory=np.array(default, np.float64).copy, metadata=about)


def whole_numbers(
    default: tuple[int, ...], text: str, low: int, high: int, shape: tuple[Length, ...] = (-1,)
) -> tuple[int, ...]:
    """Field of whole numbers between two bounds."""
    about = {'help': text, 'whole': True, 'shape': shape, 'range': (low, high)}
    return field(default=default, metadata=about)


def texts(default: tuple[str, ...], text: str) -> tuple[str, ...]:
    """Field of texts: one or more, or none where that is the default."""
    return field(default=default, metadata={'help': text})


def outlines(default: Outlines, text: str) -> Outlines:
    """Field of flat objects; no ROS parameter holds such."""
    return field(default=default, metadata={'help': text, 'unit': 'm'})


def maybe_outlines(text: str) -> Outlines | None:
    """Field of flat objects that may be left out."""
    return field(default=None, metadata={'help': text, 'unit': 'm'})


def _refusal(name: str, wanted: str, received: object) -> ValueError:
    return ValueError(f'{name} must be {wanted}; received {received}'[:300])


def admit(thing: object, channels: int = 0) -> None:
    """Hold every field of a frozen dataclass, built just now, to its metadata and shapes.

    `channels` of a taxel (c) is for fields of one number each. ValueError names the first value
    that cannot be.
    """
    owner = type(thing).__name__
    taxels = -1
    for entry in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, entry.name)
        if value is None and 'None' in str(entry.type):
            continue
        admitted = _admitted(entry, value, f'{entry.name} of {owner}', taxels, channels)
        object.__setattr__(thing, entry.name, admitted)
        if entry.name == 'positions':
            taxels = len(cast('Array', admitted))


def _admitted(
    entry: Field[object], value: object, name: str, taxels: int, channels: int
) -> object:
    """The value of one field as it is kept."""
    about, kind = entry.metadata, str(entry.type)
    if 'per_channel' in about:
        return _per_channel(name, value, channels, about['range'])
    if 'shape' in about:
        return _in_shape(name, value, about, taxels)
    if 'Outlines' in kind:
        return _all_outlines(name, value)
    if kind.startswith('tuple[str'):
        return _all_texts(name, value, entry.default)
    if kind in ('bool', 'str'):
        return _plain(name, value, bool if kind == 'bool' else str, about)
    return _number(name, value, kind == 'int', about.get('range', ANY))


def _number(name: str, value: object, integer: bool, bounds: tuple[float, float]) -> float:
    low, high = bounds
    fits = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if fits and integer:
        fits = float(cast('float', value)).is_integer()
    if not (fits and low <= cast('float', value) <= high):
        kind = 'a whole number' if integer else 'a number'
        raise _refusal(name, f'{kind} from {low} to {high}', value)
    return int(cast('float', value)) if integer else float(cast('float', value))


def _plain(name: str, value: object, kind: type, about: Mapping[str, object]) -> object:
    """A text, perhaps one of several, or true or false."""
    choices = cast('tuple[str, ...]', about.get('choices', ()))
    if choices and not (isinstance(value, str) and value in choices):
        raise _refusal(name, f'one of {", ".join(choices)}', repr(value))
    if isinstance(value, (kind, np.bool_ if kind is bool else kind)):
        return kind(value)
    raise _refusal(name, 'true or false' if kind is bool else 'a text', repr(value))


def _per_channel(name: str, value: object, channels: int, bounds: tuple[float, float]) -> object:
    """One number as it came, or one for each channel as an array."""
    low, high = bounds
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    # a ROS parameter of one number is an array of one
    numbers = numbers.reshape(()) if numbers.shape == (1,) else numbers
    fits = numbers.shape in ((), (channels,))
    if not fits or not ((numbers >= low) & (numbers <= high)).all():
        raise _refusal(name, f'a number from {low} to {high}, or one for each channel', value)
    return numbers if numbers.ndim else float(numbers)


def _in_shape(name: str, value: object, about: Mapping[str, object], taxels: int) -> object:
    """Finite numbers in the shape and between the bounds of a field."""
    wanted = cast('tuple[Length, ...]', about['shape'])
    shape = tuple(taxels if n == 't' else int(n) for n in wanted)
    numbers = as_shape(name, cast('npt.ArrayLike', value), shape)
    low, high = cast('tuple[float, float]', about.get('range', ANY))
    inside = np.isfinite(numbers) & (numbers >= low) & (numbers <= high)
    rows = ', one row or more' if wanted[0] == -1 else ''
    if not inside.all() or (rows and not len(numbers)):
        where = '' if (low, high) == ANY else f' and from {low} to {high}'
        raise _refusal(name, f'finite{where}{rows}', numbers.tolist())
    if 'whole' in about:
        if (numbers != np.round(numbers)).any():
            raise _refusal(name, 'whole numbers', numbers.tolist())
        return tuple(int(x) for x in numbers)
    if shape[1:] == (3, 3):
        off = np.abs(np.einsum('nij,nkj->nik', numbers, numbers) - np.eye(3))
        if not (off < TURN_ERROR).all() or not (np.linalg.det(numbers) > 0).all():
            raise _refusal(name, 'rotation matrices', numbers.tolist())
    return numbers


def _all_texts(name: str, value: object, default: object) -> tuple[str, ...]:
    """Texts as a tuple; one alone is a tuple of one."""
    items = (value,) if isinstance(value, str) else tuple(cast('Iterable[object]', value))
    if not all(isinstance(item, str) for item in items) or (default and not items):
        raise _refusal(name, 'one text or more', str(value)[:80])
    return cast('tuple[str, ...]', items)


def _all_outlines(name: str, value: object) -> Outlines:
    items = tuple(cast('Iterable[Outline]', value)) if isinstance(value, (tuple, list)) else None
    if items is None or not all(isinstance(item, Outline) for item in items):
        raise _refusal(name, 'a tuple of Outline', ' '.join(str(value).split())[:80])
    return items
