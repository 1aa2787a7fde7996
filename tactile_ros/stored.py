"""The parts of a pipeline as they lie in a calibration file, with every door checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration
from tactile_ros.conditioning.rest import Rest
from tactile_ros.errors import CalibrationError
from tactile_ros.types import ContactStates, Layout, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

PARTS = ('config', 'layout', 'rest_', 'estimation', 'left_out_')
OWN_CLASSES = {'Layout': Layout, 'Rest': Rest}
TARED = ('rest_/baseline.', 'rest_/temperature_c.')  # what a tare changes
# As no other dimension is likely to be: an array of a wrong shape must not fit by chance.
REHEARSED = 13
WARM_C, HOT_C = 30.0, 200.0  # the second beyond those of any fit


def parts_to_arrays(sensor: str, parts: Mapping[str, object]) -> calibration.Arrays:
    """Flatten the parts of a pipeline of `sensor`."""
    arrays = calibration.flatten(sensor, 'sensor')
    for name in PARTS:
        arrays.update(calibration.flatten(parts[name], name))
    return arrays


def identity(arrays: calibration.Arrays) -> str:
    """SHA-256 of a calibration, its baseline left out: a tare does not change it (hex)."""
    return calibration.digest({k: v for k, v in arrays.items() if not k.startswith(TARED)})


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
    except (ValueError, TypeError, OverflowError, AttributeError, LookupError) as error:
        msg = f'calibration {path} is damaged ({error}); calibrate again'
        raise CalibrationError(msg) from error
    return parts


def rehearse(layout: Layout, rest: Rest, use: Callable[[Recording], ContactStates]) -> None:
    """Use a pipeline at rest and at a touch, with and without a tare, stamps and temperatures.

    Parameters
    ----------
    layout, rest : Layout, Rest
        Parts of the pipeline.
    use : callable
        Uses everything that the pipeline has, on a recording.

    Raises
    ------
    Exception
        Of any kind: whatever arrays of a wrong shape or kind run into.
    """
    touched = np.arange(REHEARSED) > 0
    touch = np.where(touched[:, None, None], 10 * rest.scale, 0.0)
    values = np.nan_to_num(rest.baseline + touch)
    stamps, warm = np.arange(REHEARSED), np.full(values.shape[:2], WARM_C)
    hot = np.full(values.shape[:2], HOT_C)
    for tare, stamp_ns, temperature_c in (
        (None, None, None), (None, stamps, warm),
        (~touched, None, warm), (~touched, stamps, None), (~touched, stamps, hot),
    ):  # fmt: skip
        told = Recording.from_arrays(
            layout, values, stamp_ns, temperature_c=temperature_c, tare=tare
        )
        use(told).refuse_misfit(layout.shape[0])


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
    counts = parts['left_out_']
    if not (isinstance(counts, dict) and all(isinstance(n, float) for n in counts.values())):
        msg = f'what the fit left out is no table of counts in calibration {path}; calibrate again'
        raise CalibrationError(msg)
    shapes = dict.fromkeys(('baseline', 'noise', 'scale'), layout.shape)  # type: ignore[attr-defined]
    if rest.temperature_c is not None:  # type: ignore[attr-defined]
        shapes['temperature_c'] = layout.shape[:1]  # type: ignore[attr-defined]
    for name, wanted in shapes.items():
        found = np.shape(getattr(rest, name))
        if found != wanted:
            msg = f'{name} of calibration {path} must have shape {wanted}; received {found}'
            raise CalibrationError(msg)
