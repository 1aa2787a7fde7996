# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fields of configs: what their metadata say is what the door lets in."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pytest

from tactile_ros.types import Outline
from tactile_ros.types.config_fields import (
    Outlines,
    admit,
    array,
    each_channel,
    maybe_array,
    maybe_outlines,
    number,
    outlines,
    switch,
    text_of,
    texts,
    whole,
    whole_numbers,
)

DISC = Outline('disc', (np.zeros((3, 2)),))


@dataclass(frozen=True)
class Toy:
    positions: np.ndarray = array(np.zeros((2, 3)), 'places', 'm', (-1, 3))
    rotations: np.ndarray | None = maybe_array('turns', '1', ('t', 3, 3))
    noise: float | np.ndarray | None = each_channel(None, 'noise', 'T')
    limit: float | np.ndarray | None = each_channel((1.0, 2.0), 'limit', 'T')
    rate: float = number(10.0, 'rate', 'Hz', 1, 100)
    count: int = whole(3, 'count', 1, 9)
    on: bool = switch(True, 'on')
    mode: str = text_of('a', 'mode', ('a', 'b'))
    buses: tuple[str, ...] = texts(('x',), 'buses')
    codes: tuple[int, ...] = whole_numbers((1, 2), 'codes', 0, 7)
    parts: Outlines = outlines((DISC,), 'parts')
    shapes: Outlines | None = maybe_outlines('shapes')

    def __post_init__(self) -> None:
        admit(self, 2)


def test_defaults_pass_and_are_nobody_elses() -> None:
    one = Toy()
    one.positions[:] = 5
    assert not Toy().positions.any()
    assert one.parts == (DISC,)
    assert one.noise is None
    assert all(field.metadata['help'] for field in fields(Toy))


def test_values_take_their_types() -> None:
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    one = Toy(
        positions=[[1, 2, 3]], rotations=[quarter], noise=[0.5], limit=[1, 2], rate=5,
        count=4.0, on=np.bool_(False), buses='y', codes=np.array([3.0, 0.0]), parts=[DISC],
    )  # fmt: skip
    assert one.positions.dtype == np.float64
    assert one.noise == 0.5
    assert isinstance(one.rate, float)
    assert (one.count, type(one.count)) == (4, int)
    assert one.on is False
    assert one.buses == ('y',)
    assert one.codes == (3, 0)
    assert one.parts == (DISC,)


@pytest.mark.parametrize(
    ('name', 'value', 'words'),
    [
        ('positions', np.zeros((0, 3)), 'must be finite, one row or more; received'),
        ('positions', np.full((1, 3), np.inf), 'must be finite'),
        ('positions', 'hello', 'must be numbers; received hello'),
        ('positions', np.zeros(3), 'must have shape'),
        ('rotations', np.zeros((3, 3, 3)), r'must have shape \(2, 3, 3\)'),
        ('rotations', np.zeros((2, 3, 3)), 'must be rotation matrices'),
        ('rotations', np.stack([np.diag([1, 1, -1.0])] * 2), 'must be rotation matrices'),
        ('noise', -1.0, 'a number from 0 to inf, or one for each channel; received -1.0'),
        ('noise', [1, 2, 3], 'or one for each channel'),
        ('limit', 'high', 'or one for each channel'),
        ('rate', 0.5, 'must be a number from 1 to 100; received 0.5'),
        ('rate', np.nan, 'must be a number from 1 to 100'), ('rate', 'fast', 'must be a number'),
        ('rate', True, 'must be a number'),
        ('count', 2.5, 'must be a whole number from 1 to 9; received 2.5'),
        ('on', 1, 'must be true or false; received 1'),
        ('mode', 'c', "must be one of a, b; received 'c'"),
        ('buses', (), 'must be one text or more'), ('buses', (3,), 'must be one text or more'),
        ('codes', (1.5,), 'must be whole numbers'),
        ('codes', (9,), 'must be finite and from 0 to 7'), ('codes', (), 'one row or more'),
        ('parts', (1,), 'must be a tuple of Outline'),
        ('parts', DISC, 'must be a tuple of Outline'),
        ('shapes', 'round', 'must be a tuple of Outline'),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_sentence(name: str, value: object, words: str) -> None:
    with pytest.raises(ValueError, match=f'^{name} of Toy .*{words}') as refused:
        Toy(**{name: value})
    assert '\n' not in str(refused.value)
