# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Objects <-> arrays named by their path: equal after the way there and back, or refused."""

import io
import pickle
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_ros import calibration
from tactile_ros.calibration import (
    MOST_BYTES,
    SCHEMA,
    digest,
    flatten,
    plain_arrays,
    read,
    restore,
    write,
)
from tactile_ros.errors import CalibrationError

ARRAYS = {
    'a/values.array': np.arange(24.0).reshape(2, 3, 4),
    'a/turned.array': np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    'a/none.none': np.zeros((0, 3)), 'count.scalar': np.array(7), 'flags': np.array([True, False]),
    'name.scalar': np.array('skin Ω'), 'empty.scalar': np.array(''),
    'swapped': np.arange(3, dtype='>i4'),
}  # fmt: skip
SLOW = settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])


def npy(array: np.ndarray, allow_pickle: bool = False) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, allow_pickle=allow_pickle)
    return buffer.getvalue()


def header(descr: str, shape: str, data: bytes = b'') -> bytes:
    """A member with a header of one's own."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b'\x93NUMPY\x01\x00' + struct.pack('<H', len(text)) + text + data


def pack(path: Path, members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    """A zip file of any members, with a good schema."""
    with zipfile.ZipFile(path, 'w', method) as file:
        file.writestr('schema.npy', npy(np.array(SCHEMA)))
        for name, content in members.items():
            file.writestr(name, content)
    return path


@pytest.fixture
def good(tmp_path: Path) -> bytes:
    write(tmp_path / 'good.npz', ARRAYS)
    return (tmp_path / 'good.npz').read_bytes()


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    write(tmp_path / 'new folder' / 'c.npz', ARRAYS)
    again = read(tmp_path / 'new folder' / 'c.npz')
    assert set(again) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert again[name].dtype == array.dtype, name
        assert again[name].flags.f_contiguous == array.flags.f_contiguous, name
        assert again[name].flags.writeable
        np.testing.assert_array_equal(again[name], array)
    # nothing else is left in the folder
    assert [p.name for p in (tmp_path / 'new folder').iterdir()] == ['c.npz']


def test_what_numpy_writes_is_read_too(tmp_path: Path) -> None:
    about = {'schema': np.array(SCHEMA), 'sha256': np.array(digest({'x': np.eye(3)}))}
    np.savez(tmp_path / 'c.npz', x=np.eye(3), **about)
    np.testing.assert_array_equal(read(tmp_path / 'c.npz')['x'], np.eye(3))


def test_a_number_that_nothing_measures_is_refused_however_it_is_signed(tmp_path: Path) -> None:
    write(tmp_path / 'c.npz', {'rest/scale': np.array([1.0, np.inf, np.nan])})
    read(tmp_path / 'c.npz')
    write(tmp_path / 'c.npz', {'rest/scale': np.array([1.0, -1e31])})
    with pytest.raises(CalibrationError, match=r'rest/scale of calibration .* is beyond 1e\+30'):
        read(tmp_path / 'c.npz')


@pytest.mark.parametrize('value', [np.nan, np.inf, 0.0, 1e308])
def test_a_changed_array_is_refused(tmp_path: Path, value: float) -> None:
    write(tmp_path / 'c.npz', {'x': np.eye(3), 'y': np.ones(2)})
    members = dict(np.load(tmp_path / 'c.npz'))
    np.savez(tmp_path / 'c.npz', **{**members, 'y': np.full(2, value)})
    with pytest.raises(CalibrationError, match='was changed since it was written'):
        read(tmp_path / 'c.npz')


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match='does not exist; make one with `tactile'):
        read(tmp_path / 'none.npz')
    with pytest.raises(CalibrationError, match='no file'):
        read(tmp_path)


@pytest.mark.parametrize('schema', [
    None, np.array(SCHEMA + 1), np.array([SCHEMA]), np.array('1'), np.array(1.0), np.array(''),
])  # fmt: skip
def test_another_schema_is_refused_with_both_named(tmp_path: Path, schema: object) -> None:
    members = {} if schema is None else {'schema': np.asarray(schema)}
    np.savez(tmp_path / 'c.npz', x=np.eye(2), **members)
    with pytest.raises(CalibrationError, match=f'must have schema {SCHEMA}; received'):
        read(tmp_path / 'c.npz')


class Bomb:
    """What a pickle would run."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path('/nonexistent/pickled'),)  # type: ignore[return-value]


HOSTILE = {
    'pickle': npy(np.array([Bomb()]), allow_pickle=True), 'bare pickle': pickle.dumps(Bomb()),
    'nothing': b'', 'no header': b'\x93NUMPY', 'text': b'hello',
    'huge shape': header("'<f8'", '(1000000000000, 8)', bytes(64)),
    'overflowing shape': header("'<f8'", '(999999999999999999, 999999999999999999)'),
    'huge empty shape': header("'<f8'", '(0, 999999999999999999, 999999999999999999)'),
    'too many axes': header("'<f8'", '(' + ', '.join(['1'] * 70) + ')', bytes(8)),
    'negative shape': header("'<f8'", '(-1,)', bytes(8)),
    'no shape': header("'<f8'", '3', bytes(24)),
    'records': header("[('x', '<f8')]", '(1,)', bytes(8)),
    'objects': header("'|O'", '(1,)', bytes(8)), 'nested': header("'<f8'", '(' * 9000, bytes(8)),
    'code': header('__import__("os").getpid()', '()', bytes(8)),
    'no such float': header("'<f3'", '(1,)', bytes(3)),
    'text of no length': header("'<U0'", '(1000000000000,)'),
    'too long': header("'<f8'", '(1,)', bytes(9)), 'too short': header("'<f8'", '(2,)', bytes(8)),
    'dates': npy(np.array(['2020-01-01'], 'datetime64[D]')), 'complex': npy(np.array([1j])),
    'bytes': npy(np.array([b'x'])),
}  # fmt: skip


@pytest.mark.parametrize('kind', HOSTILE)
def test_members_that_are_no_plain_arrays(tmp_path: Path, kind: str) -> None:
    path = pack(tmp_path / 'c.npz', {'x.npy': HOSTILE[kind]})
    with pytest.raises(CalibrationError, match='cannot be read as plain arrays'):
        read(path)


def doubled(path: Path) -> None:
    pack(path, {'x.npy': npy(np.eye(2)), 'y.npy': npy(np.eye(3))})
    path.write_bytes(path.read_bytes().replace(b'y.npy', b'x.npy'))


def locked(path: Path) -> None:
    content = bytearray(pack(path, {'x.npy': npy(np.eye(2))}).read_bytes())
    for sign, place in ((b'PK\x03\x04', 6), (b'PK\x01\x02', 8)):
        content[content.rindex(sign) + place] |= 1
    path.write_bytes(bytes(content))


def stating(path: Path) -> None:
    content = pack(path, {'x.npy': npy(np.eye(2))}).read_bytes()
    place = content.rindex(b'PK\x01\x02') + 24
    path.write_bytes(content[:place] + struct.pack('<I', MOST_BYTES + 1) + content[place + 4 :])


NAMES = (
    '../x.npy', '/etc/x.npy', 'a/../../x.npy', 'x', 'x.npy.txt', '.npy', 'x\n.npy', 'ä.npy',
    'C:\\x.npy', 'x;y.npy', 'y' * 201 + '.npy',
)  # fmt: skip
REFUSED: list[tuple[Callable[[Path], object], str]] = [
    *((lambda path, name=name: pack(path, {name: npy(np.eye(2))}), 'holds a member named')
      for name in NAMES),
    *((lambda path, how=how: pack(path, {'x.npy': npy(np.eye(2))}, how), 'refused')
      for how in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)),
    (doubled, r"holds a member named 'x\.npy'"),
    (locked, 'cannot be read'),
    (stating, f'{MOST_BYTES} bytes; received'),
]  # fmt: skip


@pytest.mark.parametrize(('make', 'sentence'), REFUSED)
def test_hostile_archives_are_refused(
    tmp_path: Path, make: Callable[[Path], object], sentence: str
) -> None:
    make(tmp_path / 'c.npz')
    with pytest.raises(CalibrationError, match=sentence):
        read(tmp_path / 'c.npz')


def test_too_many_members_are_refused(tmp_path: Path) -> None:
    path = pack(tmp_path / 'c.npz', {f'{i}.npy': b'' for i in range(10)})
    with pytest.raises(ValueError, match=r'at most 10 members .* received 11'):
        plain_arrays(path, 10, MOST_BYTES)


def test_a_long_directory_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = pack(tmp_path / 'c.npz', {f'{i}.npy': b'' for i in range(100)})
    monkeypatch.setattr(calibration, 'MOST_DIRECTORY_BYTES', 3000)

    def never(*_: object) -> None:
        pytest.fail('the directory was read')

    monkeypatch.setattr(calibration.zipfile, 'ZipFile', never)
    with pytest.raises(CalibrationError, match='its directory has'):
        read(path)


@pytest.mark.parametrize('tail', [b'\0', b'PK\x05\x06' + bytes(18), b'PK\x06\x07' + bytes(16)])
def test_a_comment_or_a_second_end_is_refused(tmp_path: Path, good: bytes, tail: bytes) -> None:
    end = good[:-22] + tail + good[-22:] if tail[:4] == b'PK\x06\x07' else good + tail
    (tmp_path / 'c.npz').write_bytes(end)
    with pytest.raises(CalibrationError):
        read(tmp_path / 'c.npz')


def test_an_array_file_before_the_zip_is_refused(tmp_path: Path, good: bytes) -> None:
    # a reader that trusts the first bytes would take this for a single array
    (tmp_path / 'c.npz').write_bytes(npy(np.eye(2)))
    with pytest.raises(CalibrationError):
        read(tmp_path / 'c.npz')
    (tmp_path / 'c.npz').write_bytes(npy(np.eye(2)) + good)
    assert set(read(tmp_path / 'c.npz')) == set(ARRAYS)


def test_no_more_is_unpacked_than_stated(tmp_path: Path) -> None:
    """A member says 208 bytes and unpacks to 30 MB: reading it to its end would take them all."""
    honest = header("'<f8'", '(16,)', bytes(128))
    path = pack(tmp_path / 'c.npz', {'x.npy': honest})
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(honest) + packer.compress(bytes(30 * 10**6)) + packer.flush()
    with zipfile.ZipFile(path) as file:
        info = file.getinfo('x.npy')
    content = path.read_bytes()
    data = info.header_offset + 30 + len('x.npy')
    directory, last = content.index(b'PK\x01\x02'), content.rindex(b'PK\x01\x02')
    size = struct.pack('<I', len(packed))
    middle = content[directory : last + 20] + size + content[last + 24 : -6]
    start = struct.pack('<I', directory + len(packed) - info.compress_size)
    path.write_bytes(content[:data] + packed + middle + start + b'\0\0')
    tracemalloc.start()
    try:
        assert plain_arrays(path, 10, MOST_BYTES)['x'].tolist() == [0.0] * 16
        assert tracemalloc.get_traced_memory()[1] < 10**7
    finally:
        tracemalloc.stop()


def test_a_file_cut_anywhere_is_refused(tmp_path: Path, good: bytes) -> None:
    path = tmp_path / 'c.npz'
    for length in range(0, len(good), 7):
        path.write_bytes(good[:length])
        with pytest.raises(CalibrationError):
            read(path)


@SLOW
@given(st.data())
def test_flipped_bits_are_refused_or_harmless(
    tmp_path: Path, good: bytes, data: st.DataObject
) -> None:
    hurt = bytearray(good)
    for place in data.draw(st.lists(st.integers(0, len(good) * 8 - 1), min_size=1, max_size=4)):
        hurt[place // 8] ^= 1 << place % 8
    path = tmp_path / 'c.npz'
    path.write_bytes(bytes(hurt))
    try:
        arrays = read(path)
    except CalibrationError:
        return
    # a bit of a date, say: names and values are as they were, else the checksums had told
    for name, array in arrays.items():
        if name in ARRAYS:
            np.testing.assert_array_equal(array, ARRAYS[name])


@SLOW
@given(st.binary(max_size=400), st.integers(0, 400))
def test_garbage_is_refused(tmp_path: Path, good: bytes, garbage: bytes, place: int) -> None:
    path = tmp_path / 'c.npz'
    for content in (garbage, good[:place] + garbage + good[place + len(garbage) :]):
        if content != good:
            path.write_bytes(content)
            try:
                read(path)
            except CalibrationError:
                continue


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
    st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False),
    st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs'])),
)  # fmt: skip
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
