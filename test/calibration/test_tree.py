"""Objects <-> arrays named by their path: equal after the way there and back, or refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.calibration import digest, flatten, restore
from tactile_ros.errors import CalibrationError


@dataclass(frozen=True)
class Geometry:
    size: float
    positions: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))

    def __post_init__(self) -> None:
        if np.shape(self.positions)[1:] != (3,):
            msg = 'positions of Geometry must have shape (any, 3)'
            raise ValueError(msg)


class Regressor:
    degree = 2

    def __init__(self) -> None:
        self.weights_ = np.arange(6.0).reshape(2, 3)
        self.geometry = Geometry(3.0)

    def predict(self) -> float:
        return float(self.weights_.sum())

    @property
    def name(self) -> str:
        return 'regressor'

    @cached_property
    def total(self) -> float:
        return self.predict()


CLASSES = {'Geometry': Geometry, 'Regressor': Regressor}
LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs'])),
)
TREES = st.recursive(
    LEAVES,
    lambda child: st.one_of(
        st.lists(child, max_size=3),
        st.lists(child, max_size=3).map(tuple),
        st.dictionaries(st.text('abc/. ', max_size=4), child, max_size=3),
    ),
    max_leaves=12,
)


@given(TREES)
def test_plain_trees_come_back_equal(tree: object) -> None:
    again = restore(flatten(tree, 'x'), 'x', {})
    assert again == tree
    assert type(again) is type(tree)


def test_objects_come_back_as_they_were() -> None:
    before = Regressor()
    again = restore(flatten({'head': (before, None)}, 'x'), 'x', CLASSES)
    assert isinstance(again, dict)
    head = again['head'][0]
    assert type(head) is Regressor
    assert head.predict() == before.predict()
    assert head.geometry.size == 3.0
    np.testing.assert_array_equal(head.geometry.positions, before.geometry.positions)


@pytest.mark.parametrize('array', [
    np.zeros((0, 3)), np.array(3.5), np.array(['a', 'longer']), np.array([True, False]),
    np.arange(3, dtype=np.uint8), np.array([np.nan, np.inf]),
])  # fmt: skip
def test_arrays_keep_kind_and_shape(array: np.ndarray) -> None:
    again = restore(flatten(array, 'x'), 'x', {})
    assert isinstance(again, np.ndarray)
    assert again.dtype == array.dtype
    np.testing.assert_array_equal(again, array)


@pytest.mark.parametrize('thing', [
    {1: 'number as key'}, {1, 2}, b'bytes', 1j, np.array([object()]), 2**70, np.float64, len,
    lambda: None, np.random.default_rng(0), np.datetime64('2020-01-01'),
])  # fmt: skip
def test_what_cannot_be_kept_is_refused_by_its_path(thing: object) -> None:
    holder = Regressor()
    holder.head = (thing,)  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match='x/head/0 of a calibration must be numbers or text'):
        flatten(holder, 'x')


def test_a_missing_member_is_named() -> None:
    arrays = flatten(Regressor(), 'x')
    for gone in arrays:
        some = {name: array for name, array in arrays.items() if name != gone}
        with pytest.raises(CalibrationError, match='is missing'):
            restore(some, 'x', CLASSES)


def test_only_named_classes_are_built() -> None:
    arrays = flatten(Regressor(), 'x')
    with pytest.raises(CalibrationError, match="must be one of Geometry; received 'Regressor'"):
        restore(arrays, 'x', {'Geometry': Geometry})


def test_what_follows_from_the_rest_is_not_kept() -> None:
    before, after = Regressor(), Regressor()
    assert after.total == 15.0
    assert digest(flatten(before, 'r')) == digest(flatten(after, 'r'))


@pytest.mark.parametrize(
    'key', ['__class__', '__dict__', 'no name', 'predict', 'name', 'total', '']
)
def test_attributes_do_not_take_the_place_of_code(key: str) -> None:
    arrays = flatten(Regressor(), 'x')
    arrays['x.names'] = np.array([key])
    arrays[f'x/{key}.none'] = np.zeros(0)
    with pytest.raises(CalibrationError, match='hostile'):
        restore(arrays, 'x', CLASSES)


def test_a_frozen_dataclass_comes_in_by_its_own_door() -> None:
    arrays = flatten(Geometry(1.0), 'x')
    arrays['x/positions.array'] = np.zeros((2, 2))
    with pytest.raises(ValueError, match='positions of Geometry'):
        restore(arrays, 'x', CLASSES)
    arrays['x.names'] = np.array(['size'])
    with pytest.raises(CalibrationError, match='must have positions, size; received size'):
        restore(arrays, 'x', CLASSES)


def test_the_digest_knows_names_values_kinds_and_shapes_alone() -> None:
    arrays = flatten(Regressor(), 'x')
    same = {name: arrays[name] for name in reversed(arrays)}
    same['x/weights_.array'] = np.asfortranarray(same['x/weights_.array']).astype('>f8')
    assert digest(same) == digest(arrays)
    weights = np.array(arrays['x/weights_.array'], float)
    weights[0, 0] = np.nextafter(weights[0, 0], 1)
    for other in (weights, weights.astype(np.float32), weights.reshape(3, 2)):
        assert digest({**arrays, 'x/weights_.array': other}) != digest(arrays)
    assert digest({**arrays, 'y': np.zeros(0)}) != digest(arrays)
