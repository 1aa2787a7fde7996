# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tasks, sensors and recordings of the independent world by the public face; refusal of NaN."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Bools, Layout, Recording

ARRAYS = ('positions', 'magnet_positions', 'areas')


@dataclass(frozen=True)
class Task:
    """A figure that a sensor is asked for; a name that ends in _min is better high."""

    name: str
    what: str
    unit: str
    limit: float | None
    bound: float | None
    judge: Callable[[], float]
    slow: bool = False  # above a minute: no quick bench asks it

    @property
    def high(self) -> bool:
        """Whether more is better."""
        return self.name.endswith('_min')


class UnansweredError(Exception):
    """A task most of whose frames were not answered."""


@cache
def world(name: str) -> dict[str, Array]:
    """Arrays of one sensor's world."""
    with np.load(Path(__file__).parent / 'data' / f'{name}.npz') as stored:
        return dict(stored)


def pipeline_with(name: str, **fields: object) -> Pipeline:
    """Pipeline of a sensor, some fields of whose config are replaced; not fitted."""
    sensor = load_sensor(name)
    typed = {k: np.asarray(v, float) if k in ARRAYS else v for k, v in fields.items()}
    return sensor.pipeline(replace(sensor.config(), **typed))


def recording(
    layout: Layout, values: Array, *, temperature: Array | None = None,
    truth: dict[str, Array] | None = None, **columns: Array | None,
) -> Recording:  # fmt: skip
    """Recording of values (s, t, c); a temperature (s,) is given to every taxel."""
    values = np.asarray(values, float)
    each = None
    if temperature is not None:
        each = np.repeat(np.asarray(temperature, float)[:, None], values.shape[1], 1)
    truth = {k: np.asarray(v) for k, v in (truth or {}).items()}
    return Recording.from_arrays(layout, values, temperature_c=each, truth=truth, **columns)


def answered(array: Array) -> Array:
    """The array, if at least 99 % of its rows are finite."""
    array = np.asarray(array, float)
    share = 100 * np.isfinite(array.reshape(len(array), -1)).all(1).mean()
    if share < 99:
        msg = f'only {share:.1f} % of the answers are finite; 99 % are wanted'
        raise UnansweredError(msg)
    return array


def rms(error: Array) -> Array:
    """Root mean square over the frames; NaN are left out."""
    return np.sqrt(np.nanmean(np.square(error), axis=0))


def coverage(error: Array, sigma: Array) -> float:
    """Share of errors inside the stated sigma (%)."""
    return float(100 * np.mean(np.abs(error) <= sigma))


def turn(a: Array, b: Array, period: float = 2 * np.pi) -> Array:
    """Distance of two angles on the circle of a period (degrees)."""
    return np.degrees(np.abs((a - b + period / 2) % period - period / 2))


def marked(count: int, first: int) -> Bools:
    """First rows among some."""
    return np.arange(count) < first
