"""Trees of fitted objects <-> arrays named by their path; only named classes are ever built."""

from __future__ import annotations

import hashlib
import inspect
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Mapping

Arrays = dict[str, npt.NDArray[np.generic]]


def flatten(tree: object, name: str) -> Arrays:
    """Turn an object into arrays named by their path.

    Parameters
    ----------
    tree : object
        None, a number, a string, an array, a tuple, list or dict (keys are strings) of such, or
        an object whose attributes are such (an estimator, a frozen dataclass).
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
    arrays, children = _take_apart(tree, name)
    for key, child in children.items():
        arrays.update(flatten(child, f'{name}/{key}'))
    return arrays


def _take_apart(tree: object, name: str) -> tuple[Arrays, dict[str, object]]:
    """What a container is, as arrays, and its children by the last part of their path."""
    if isinstance(tree, (tuple, list)):
        kind = 'tuple' if isinstance(tree, tuple) else 'list'
        return {f'{name}.{kind}': np.array(len(tree))}, {str(i): x for i, x in enumerate(tree)}
    if isinstance(tree, dict) and all(isinstance(key, str) for key in tree):
        keys = np.array(list(tree), dtype=str)
        return {f'{name}.dict': keys}, {str(i): x for i, x in enumerate(tree.values())}
    code = isinstance(tree, type) or inspect.isroutine(tree)
    if code or not (is_dataclass(tree) or hasattr(tree, '__dict__')):
        msg = f'{name} of a calibration must be numbers or text; received {type(tree).__name__}'
        raise TypeError(msg)
    children = _attributes(tree)
    label, names = np.array(type(tree).__name__), np.array(list(children), dtype=str)
    return {f'{name}.class': label, f'{name}.names': names}, children


def _attributes(thing: object) -> dict[str, object]:
    """What an object consists of: the fields of a frozen dataclass, else its own attributes."""
    if _is_frozen(type(thing)):
        return {f.name: getattr(thing, f.name) for f in fields(thing)}  # type: ignore[arg-type]
    kind = type(thing)
    return {name: value for name, value in vars(thing).items() if not _is_code(kind, name)}


def _is_frozen(kind: type) -> bool:
    """Whether a class is a frozen dataclass: complete when built, and never changed."""
    return is_dataclass(kind) and bool(kind.__dataclass_params__.frozen)  # type: ignore[attr-defined]


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
    if _is_frozen(kind):
        return _build_frozen(kind, members, name)
    thing: object = object.__new__(kind)
    vars(thing).update(members)
    return thing


def _is_code(kind: type, key: str) -> bool:
    """Whether a class has a method or property of that name, which no file holds."""
    found = getattr(kind, key, None)
    return callable(found) or isinstance(found, (property, cached_property))


def _build_frozen(kind: type, members: Mapping[str, object], name: str) -> object:
    """Build a frozen dataclass by its own door, which checks shapes."""
    wanted = {f.name for f in fields(kind)}
    if set(members) != wanted:
        msg = (
            f'{name} of the calibration must have {", ".join(sorted(wanted))}; received '
            f'{", ".join(sorted(members))[:200]}; calibrate again'
        )
        raise CalibrationError(msg)
    thing: object = kind(**members)
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
