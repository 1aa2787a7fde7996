"""Calibrations: trees of fitted objects <-> one .npz of plain arrays with a schema version.

Nothing is ever pickled. A file is parsed as hostile: members are counted, their unpacked size is
capped before anything is read, names must fit a pattern, and objects are rebuilt only from the
classes that the reader names.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import zipfile
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

SCHEMA = 1
MOST_MEMBERS = 20_000
MOST_BYTES = 512 * 1024 * 1024
NAME = re.compile(r'[A-Za-z0-9_./ +\-]{1,200}')

Arrays = dict[str, npt.NDArray[np.generic]]


def flatten(tree: object, name: str) -> Arrays:
    """Turn an object into arrays named by their path.

    Parameters
    ----------
    tree : object
        None, a number, a string, an array, a tuple, list or dict of such, or an object whose
        attributes are such (an estimator, a frozen dataclass).
    name : str
        Path of the object.

    Returns
    -------
    dict of str to ndarray
        What `restore` needs to build an equal object.

    Raises
    ------
    TypeError
        If something else is inside.
    """
    if tree is None:
        return {f'{name}.none': np.zeros(0)}
    if isinstance(tree, (bool, int, float, str, np.generic, np.ndarray)):
        array = np.asarray(tree)
        if array.dtype.kind not in 'biufU':
            msg = f'{name} of a calibration must be numbers or text; received {array.dtype}'
            raise TypeError(msg)
        kind = 'array' if isinstance(tree, np.ndarray) else 'scalar'
        return {f'{name}.{kind}': array}
    arrays: Arrays = {}
    if isinstance(tree, (tuple, list)):
        arrays[f'{name}.{type(tree).__name__}'] = np.array(len(tree))
        children: dict[str, object] = {str(i): child for i, child in enumerate(tree)}
    elif isinstance(tree, dict):
        arrays[f'{name}.dict'] = np.array(list(tree), dtype=str)
        children = {str(i): child for i, child in enumerate(tree.values())}
    else:
        arrays[f'{name}.class'] = np.array(type(tree).__name__)
        children = attributes(tree)
        arrays[f'{name}.names'] = np.array(list(children), dtype=str)
    for key, child in children.items():
        arrays.update(flatten(child, f'{name}/{key}'))
    return arrays


def attributes(thing: object) -> dict[str, object]:
    """What an object consists of: its dataclass fields and its own attributes."""
    own = dict(getattr(thing, '__dict__', {}))
    if is_dataclass(thing):
        own = {f.name: getattr(thing, f.name) for f in fields(thing)} | own
    return {key: value for key, value in own.items() if not key.startswith('__')}


def restore(
    arrays: Mapping[str, npt.NDArray[np.generic]], name: str, classes: Mapping[str, type]
) -> object:
    """Rebuild what `flatten` took apart.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Members of a calibration.
    name : str
        Path of the object.
    classes : mapping of str to type
        The only classes that may be built.

    Returns
    -------
    object
        Equal to what was flattened.

    Raises
    ------
    CalibrationError
        If a member is missing or a class is not among `classes`.
    """
    if f'{name}.none' in arrays:
        return None
    if f'{name}.array' in arrays:
        return arrays[f'{name}.array']
    if f'{name}.scalar' in arrays:
        return arrays[f'{name}.scalar'].item()
    for kind, build in (('tuple', tuple), ('list', list)):
        if f'{name}.{kind}' in arrays:
            count = int(arrays[f'{name}.{kind}'])
            return build(restore(arrays, f'{name}/{i}', classes) for i in range(count))
    if f'{name}.dict' in arrays:
        keys = [str(key) for key in arrays[f'{name}.dict']]
        return {key: restore(arrays, f'{name}/{i}', classes) for i, key in enumerate(keys)}
    return _restore_instance(arrays, name, classes)


def _restore_instance(
    arrays: Mapping[str, npt.NDArray[np.generic]], name: str, classes: Mapping[str, type]
) -> object:
    """Rebuild one object of a class that the reader allows."""
    if f'{name}.class' not in arrays:
        msg = f'{name} is missing in the calibration; the file is damaged, calibrate again'
        raise CalibrationError(msg)
    label = str(arrays[f'{name}.class'])
    if label not in classes:
        msg = f'{name} of the calibration must be one of {", ".join(classes)}; received {label!r}'
        raise CalibrationError(msg)
    thing: object = object.__new__(classes[label])
    for key in (str(key) for key in arrays[f'{name}.names']):
        if not key.isidentifier() or key.startswith('__'):
            msg = f'{name} of the calibration has an attribute named {key!r}; the file is hostile'
            raise CalibrationError(msg)
        object.__setattr__(thing, key, restore(arrays, f'{name}/{key}', classes))
    return thing


def digest(arrays: Mapping[str, npt.NDArray[np.generic]]) -> str:
    """SHA-256 over names, types, shapes and bytes, the same on every machine (hex)."""
    sha = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        little = array.astype(array.dtype.newbyteorder('<'))
        sha.update(f'{name}|{little.dtype.str}|{array.shape}|'.encode())
        sha.update(little.tobytes())
    return sha.hexdigest()


def write(path: str | Path, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
    """Write the arrays beside `path` and rename, so that no reader sees half a file.

    Parameters
    ----------
    path : str or Path
        Where the calibration goes (.npz).
    arrays : mapping of str to ndarray
        Numbers and text only.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = target.with_name(f'.{target.name}.{os.getpid()}.part')
    buffer = io.BytesIO()
    np.savez_compressed(buffer, schema=np.array(SCHEMA), **dict(arrays))  # type: ignore[arg-type]
    try:
        beside.write_bytes(buffer.getvalue())
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def read(path: str | Path) -> Arrays:
    """Read a calibration without trusting it.

    Parameters
    ----------
    path : str or Path
        A file written by `write`.

    Returns
    -------
    dict of str to ndarray
        Its members.

    Raises
    ------
    CalibrationError
        If the file is missing, damaged, too large, of another schema version, or holds anything
        but plain arrays.
    """
    target = Path(path)
    try:
        with zipfile.ZipFile(target) as archive:
            _refuse_bombs(target, archive.infolist())
        with np.load(target, allow_pickle=False) as file:
            arrays: Arrays = {name: file[name] for name in file.files}
    except FileNotFoundError as error:
        msg = f'calibration {target} does not exist; make one with `tactile calibrate`'
        raise CalibrationError(msg) from error
    except (zipfile.BadZipFile, ValueError, OSError, EOFError, KeyError, NotImplementedError) as e:
        msg = f'calibration {target} cannot be read as plain arrays ({e}); calibrate again'
        raise CalibrationError(msg) from e
    version = arrays.pop('schema', None)
    if version is None or version.shape != () or version != SCHEMA:
        msg = (
            f'calibration {target} must have schema {SCHEMA}; received {version}; calibrate again'
        )
        raise CalibrationError(msg)
    return arrays


def _refuse_bombs(target: Path, members: Iterable[zipfile.ZipInfo]) -> None:
    """Cap the count, the names and the unpacked size of members before reading any."""
    listed = list(members)
    unpacked = sum(member.file_size for member in listed)
    if len(listed) > MOST_MEMBERS or unpacked > MOST_BYTES:
        msg = (
            f'calibration {target} must hold at most {MOST_MEMBERS} members and {MOST_BYTES} bytes;'
            f' received {len(listed)} and {unpacked}'
        )
        raise CalibrationError(msg)
    for member in listed:
        if not NAME.fullmatch(member.filename) or '..' in member.filename:
            msg = f'calibration {target} holds a member named {member.filename[:40]!r}; refused'
            raise CalibrationError(msg)
