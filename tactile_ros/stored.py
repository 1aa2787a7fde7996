"""The parts of a pipeline as they lie in a calibration file, with every door checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration
from tactile_ros.conditioning.rest import Rest
from tactile_ros.errors import CalibrationError
from tactile_ros.types import Layout

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

PARTS = ('config', 'layout', 'rest_', 'estimation')
OWN_CLASSES = {'Layout': Layout, 'Rest': Rest}
BASELINE = 'rest_/baseline.array'


def parts_to_arrays(sensor: str, parts: Mapping[str, object]) -> calibration.Arrays:
    """Flatten the parts of a pipeline of `sensor`."""
    arrays = calibration.flatten(sensor, 'sensor')
    for name in PARTS:
        arrays.update(calibration.flatten(parts[name], name))
    return arrays


def identity(arrays: calibration.Arrays) -> str:
    """SHA-256 of a calibration, its baseline left out: a tare does not change it (hex)."""
    return calibration.digest({k: v for k, v in arrays.items() if k != BASELINE})


def read_parts(path: str | Path, sensor: str, classes: Mapping[str, type]) -> dict[str, object]:
    """Parts of a pipeline from a file that is not trusted.

    Parameters
    ----------
    path : str or Path
        A calibration file.
    sensor : str
        Key of the sensor that it must be of.
    classes : mapping of str to type
        Classes of the sensor that may be built.

    Returns
    -------
    dict of str to object
        One entry for each of `PARTS`.

    Raises
    ------
    CalibrationError
        If the file is damaged, hostile, of another sensor, version or shape.
    """
    arrays = calibration.read(path)
    allowed = {**OWN_CLASSES, **classes}
    try:
        found = calibration.restore(arrays, 'sensor', {})
        if found != sensor:
            msg = f'calibration {path} must be of {sensor}; it is of {str(found)[:60]!r}'
            raise CalibrationError(msg)
        parts = {name: calibration.restore(arrays, name, allowed) for name in PARTS}
        _refuse_misfit(path, parts, classes)
    except (ValueError, TypeError, OverflowError, AttributeError) as error:
        msg = f'calibration {path} is damaged ({error}); calibrate again'
        raise CalibrationError(msg) from error
    return parts


def _refuse_misfit(
    path: str | Path, parts: Mapping[str, object], classes: Mapping[str, type]
) -> None:
    """Refuse parts of other kinds or shapes than a pipeline's."""
    layout, rest = parts['layout'], parts['rest_']
    whole = isinstance(layout, Layout) and isinstance(rest, Rest)
    known = all(type(parts[name]) in classes.values() for name in ('config', 'estimation'))
    if not (whole and known):
        msg = f'calibration {path} lacks a layout, a rest level or estimators; calibrate again'
        raise CalibrationError(msg)
    for name in ('baseline', 'noise', 'scale'):
        found, wanted = np.shape(getattr(rest, name)), layout.shape  # type: ignore[attr-defined]
        if found != wanted:
            msg = f'{name} of calibration {path} must have shape {wanted}; received {found}'
            raise CalibrationError(msg)
