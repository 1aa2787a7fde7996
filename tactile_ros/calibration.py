# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Calibrations: trees of fitted objects <-> one .npz of plain arrays with a schema version.

Nothing is ever pickled, and a file is read without trust: before anything is unpacked its
directory is capped, members are counted, their names must fit a pattern and their stated sizes a
cap. Members are unpacked to their stated size at most and must be what that size allows: a plain
header of numbers or text, and exactly its data. Only objects of named classes are built.
"""

from __future__ import annotations

import hashlib
import inspect
import io
import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import CalibrationError
from tactile_ros.files import write_atomically

Arrays = dict[str, npt.NDArray[np.generic]]
SCHEMA = 3
MARK = b'sensor.scalar.npy'  # in every calibration
MOST_MEMBERS = 20_000
MOST_BYTES = 512 * 1024 * 1024
MOST_DIRECTORY_BYTES = 300 * MOST_MEMBERS
LARGEST = 1e30  # finite number
NAME = re.compile(r'[A-Za-z0-9_./ +\-]{1,200}\.npy')
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# numpy.lib.format version 1.0, as numpy writes it: nothing is evaluated
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '([<>|][biufU]\d{1,6})', 'fortran_order': (True|False), "
    rb"'shape': \((\d{0,18}(?:, \d{1,18})*),?\), \} *\n",
    re.DOTALL,
)
DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, ValueError, TypeError,
    LookupError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


def write(path: str | Path, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
    """Write the arrays of a calibration, with its schema and their digest, to an .npz."""
    save_arrays(path, {'schema': np.array(SCHEMA), 'sha256': np.array(digest(arrays)), **arrays})


def save_arrays(path: str | os.PathLike[str], arrays: Arrays) -> Path:
    """Write arrays of numbers and text to one .npz, whole or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return write_atomically(path, buffer.getvalue())


def read(path: str | Path) -> Arrays:
    """Read a file of `write` without trusting it.

    Raises CalibrationError if it is missing, damaged, too large, of another schema version, or
    holds anything but plain arrays.
    """
    target = Path(path)
    try:
        arrays = plain_arrays(target, MOST_MEMBERS, MOST_BYTES)
    except FileNotFoundError as error:
        msg = f'calibration {target} does not exist; make one with `tactile calibrate`'
        raise CalibrationError(msg) from error
    except DAMAGE as error:
        msg = f'calibration {target} cannot be read as plain arrays ({error}); calibrate again'
        raise CalibrationError(msg) from error
    version = arrays.pop('schema', np.zeros(0))
    if version.shape != () or version.dtype.kind not in 'iu' or version != SCHEMA:
        found = repr(version.tolist())[:40] if version.size else 'none (a recording?)'
        msg = f'calibration {target} must have schema {SCHEMA}; received {found}; calibrate again'
        raise CalibrationError(msg)
    if str(arrays.pop('sha256', '')) != digest(arrays):
        msg = f'calibration {target} was changed since it was written; calibrate again'
        raise CalibrationError(msg)
    for name, array in arrays.items():
        if array.dtype.kind == 'f' and (np.isfinite(array) & (np.abs(array) > LARGEST)).any():
            msg = f'{name} of calibration {target} is beyond {LARGEST:g}; calibrate again'
            raise CalibrationError(msg)
    return arrays


def plain_arrays(target: Path, most_members: int, most_bytes: int) -> Arrays:
    """Arrays of an .npz by name, read without trust and with caps; raises `DAMAGE`."""
    if target.exists() and not target.is_file():
        msg = 'it is no file'
        raise ValueError(msg)
    arrays: Arrays = {}
    with target.open('rb') as file:
        _check_directory(file)
        with zipfile.ZipFile(file) as archive:
            _check_members(archive.infolist(), most_members, most_bytes)
            for member in archive.infolist():
                with archive.open(member) as stream:
                    # with a count: without one, all that lies behind the stated size is unpacked
                    content = stream.read(member.file_size)
                arrays[member.filename[: -len('.npy')]] = _array(content)
    return arrays


def _check_directory(file: io.BufferedReader) -> None:
    """Cap the directory by its last record, which zipfile would read in one go."""
    file.seek(max(file.seek(0, os.SEEK_END) - 42, 0))
    tail = file.read(42).rjust(42, b'\0')
    length = struct.unpack('<I', tail[32:36])[0]
    if tail[20:24] != b'PK\x05\x06' or tail[:4] == b'PK\x06\x07':
        msg = 'it does not end as an .npz does'
        raise ValueError(msg)
    if length > MOST_DIRECTORY_BYTES:
        msg = f'its directory has {length} bytes'
        raise ValueError(msg)
    file.seek(0)


def _check_members(listed: Sequence[zipfile.ZipInfo], most_members: int, most_bytes: int) -> None:
    """Cap the count, the names and the unpacked size of members before unpacking any."""
    unpacked = sum(member.file_size for member in listed)
    if len(listed) > most_members or unpacked > most_bytes:
        msg = (
            f'it must hold at most {most_members} members and {most_bytes} bytes; '
            f'received {len(listed)} and {unpacked}'
        )
        raise ValueError(msg)
    seen: set[str] = set()
    for member in listed:
        name = member.filename
        plain = NAME.fullmatch(name) and '..' not in name and not name.startswith('/')
        if not plain or name in seen or member.compress_type not in PLAIN:
            msg = f'it holds a member named {name[:40]!r}; refused'
            raise ValueError(msg)
        seen.add(name)


def _array(content: bytes) -> npt.NDArray[np.generic]:
    """Array of one .npy member whose data are exactly as long as its header says."""
    match = HEADER.match(content)
    if match is None:
        msg = 'a member is no plain array of numbers or text'
        raise ValueError(msg)
    kind, column_major, lengths = match.groups()
    dtype = np.dtype(kind.decode())
    shape = tuple(int(n) for n in lengths.split(b',') if n)
    if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != len(content) - match.end():
        msg = f'a member of shape {shape} holds {len(content) - match.end()} bytes'
        raise ValueError(msg)
    order = 'F' if column_major == b'True' else 'C'
    array: npt.NDArray[np.generic] = np.empty(shape, dtype, order)  # type: ignore[call-overload]
    if array.size:
        array.reshape(-1, order='A')[:] = np.frombuffer(content, dtype, offset=match.end())
    return array


def flatten(tree: object, name: str) -> Arrays:
    """Turn an object into arrays named by their path below `name`, which `restore` reads.

    None, numbers, strings, arrays; tuples, lists and dicts (keys are strings) of such; objects
    whose attributes are such (an estimator, a frozen dataclass). TypeError if anything else is in.
    """
    if tree is None:
        return {f'{name}.none': np.zeros(0)}
    if isinstance(tree, (bool, int, float, str, np.generic, np.ndarray)):
        array = np.asarray(tree)
        if array.dtype.kind not in 'biufU':
            msg = f'{name} of a calibration must be numbers or text; received {array.dtype}'
            raise TypeError(msg)
        return {f'{name}.{"array" if isinstance(tree, np.ndarray) else "scalar"}': array}
    arrays, children = _parts_of(tree, name)
    for key, child in children.items():
        arrays.update(flatten(child, f'{name}/{key}'))
    return arrays


def _parts_of(tree: object, name: str) -> tuple[Arrays, dict[str, object]]:
    """Kind of a container, as arrays, and its children by the last part of their path."""
    if isinstance(tree, (tuple, list)):
        label = 'tuple' if isinstance(tree, tuple) else 'list'
        return {f'{name}.{label}': np.array(len(tree))}, {str(i): x for i, x in enumerate(tree)}
    if isinstance(tree, dict) and all(isinstance(key, str) for key in tree):
        keys = np.array(list(tree), dtype=str)
        return {f'{name}.dict': keys}, {str(i): x for i, x in enumerate(tree.values())}
    code, kind = isinstance(tree, type) or inspect.isroutine(tree), type(tree)
    if code or not (is_dataclass(tree) or hasattr(tree, '__dict__')):
        msg = f'{name} of a calibration must be numbers or text; received {kind.__name__}'
        raise TypeError(msg)
    if _is_frozen(kind):
        children = {f.name: getattr(tree, f.name) for f in fields(tree)}  # type: ignore[arg-type]
    else:
        children = {key: value for key, value in vars(tree).items() if not _is_code(kind, key)}
    names = np.array(list(children), dtype=str)
    return {f'{name}.class': np.array(kind.__name__), f'{name}.names': names}, children


def _is_frozen(kind: type) -> bool:
    """True for a frozen dataclass: complete when built, and never changed."""
    return is_dataclass(kind) and bool(kind.__dataclass_params__.frozen)  # type: ignore[attr-defined]


def _is_code(kind: type, key: str) -> bool:
    """True where a class has a method or property of that name, which no file holds."""
    found = getattr(kind, key, None)
    return callable(found) or isinstance(found, (property, cached_property))


def restore(
    arrays: Mapping[str, npt.NDArray[np.generic]], name: str, classes: Mapping[str, type]
) -> object:
    """Rebuild the object that `flatten` took apart; only `classes` are ever built.

    Raises CalibrationError if a member is missing or a class is not among them.
    """
    if f'{name}.none' in arrays:
        return None
    if f'{name}.array' in arrays:
        return arrays[f'{name}.array']
    if f'{name}.scalar' in arrays:
        return arrays[f'{name}.scalar'].item()
    for kind, build in (('tuple', tuple), ('list', list)):
        if f'{name}.{kind}' in arrays:
            count = arrays[f'{name}.{kind}'].item()
            return build(restore(arrays, f'{name}/{i}', classes) for i in range(count))
    if f'{name}.dict' in arrays:
        keys = [str(key) for key in arrays[f'{name}.dict']]
        return {key: restore(arrays, f'{name}/{i}', classes) for i, key in enumerate(keys)}
    return _restore_instance(arrays, name, classes)


def _restore_instance(
    arrays: Mapping[str, npt.NDArray[np.generic]], name: str, classes: Mapping[str, type]
) -> object:
    """Rebuild one object of a class that the reader allows."""
    if f'{name}.class' not in arrays or f'{name}.names' not in arrays:
        msg = f'{name} is missing in the calibration; the file is damaged, calibrate again'
        raise CalibrationError(msg)
    label = str(arrays[f'{name}.class'])
    if label not in classes:
        msg = f'{name} of the calibration must be one of {", ".join(classes)}; received {label!r}'
        raise CalibrationError(msg)
    kind, members = classes[label], {}
    for key in (str(key) for key in arrays[f'{name}.names']):
        # a stored attribute must not take the place of a method
        if not key.isidentifier() or key.startswith('__') or _is_code(kind, key):
            msg = f'{name} of the calibration has an attribute named {key!r}; the file is hostile'
            raise CalibrationError(msg)
        members[key] = restore(arrays, f'{name}/{key}', classes)
    if not _is_frozen(kind):
        thing: object = object.__new__(kind)
        vars(thing).update(members)
        return thing
    wanted = {f.name for f in fields(kind)}
    if set(members) != wanted:
        msg = (
            f'{name} of the calibration must have {", ".join(sorted(wanted))}; received '
            f'{", ".join(sorted(members))[:200]}; calibrate again'
        )
        raise CalibrationError(msg)
    frozen: object = kind(**members)  # by its own door, which checks shapes
    return frozen


def digest(arrays: Mapping[str, npt.NDArray[np.generic]]) -> str:
    """SHA-256 over names, types, shapes and bytes, the same on every machine (hex)."""
    sha = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        little = array.astype(array.dtype.newbyteorder('<'))
        sha.update(f'{name}|{little.dtype.str}|{array.shape}|'.encode())
        sha.update(little.tobytes())
    return sha.hexdigest()
