"""Conditioned frames, and the contract by which a sensor brings its features and estimators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools, Integers

Columns = dict[str, npt.NDArray[np.generic]]
Report = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Signals:
    """Conditioned frames, as features are made from them.

    Attributes
    ----------
    values, delta : ndarray, shape (s, t, c)
        Readings, and readings less their baseline (unit of values); NaN where unusable.
    baseline : ndarray, shape (s, t, c)
        Of each row (unit of values); 0 where none is used, NaN where there is none yet.
    temperature_c : ndarray, shape (s, t), or None
        What the chips report.
    stamp_ns : ndarray, shape (s,), or None
        None: independent frames, no step with memory is run.
    restart : ndarray, shape (s,)
        Rows before which memory is forgotten (new stream, new baseline).
    in_contact : ndarray, shape (s,)
        1, 0, -1 unknown.
    good : ndarray, shape (s,)
        Rows that may be estimated from.
    begins : ndarray, shape (s,), or None
        Rows of `restart` at which a stream begins, and the ids of its patches; None: none does.
    tare : ndarray, shape (s,), or None
        Rows that a recording calls resting; None: it does not tell.
    doubt : ndarray, shape (s,), or None
        Variance of the baseline over that of a frame at rest: one over the frames of its tare; 0
        where the fit's own is used. None: 0.
    rest_temperature_c : ndarray, shape (s, t), or None
        What the chips told when the baseline was read, NaN: nothing; None: the estimation does
        not heed it.
    """

    values: Array
    delta: Array
    baseline: Array
    temperature_c: Array | None
    stamp_ns: Integers | None
    restart: Bools
    in_contact: npt.NDArray[np.int8]
    good: Bools
    begins: Bools | None = None
    tare: Bools | None = None
    doubt: Array | None = None
    rest_temperature_c: Array | None = None


class SensorConfig(Protocol):
    """What every sensor's config dataclass has (public_face)."""

    @property
    def positions(self) -> Array:
        """Taxel positions in the sensor frame, shape (t, 3) (m)."""
        ...

    @property
    def noise(self) -> float | Array | None:
        """Noise of a channel at rest (unit of values); None: estimate it from rest."""
        ...

    @property
    def track_baseline(self) -> bool:
        """Follow slow drift of the baseline while at rest."""
        ...


class Estimation(Protocol):
    """Features and estimators of one sensor.

    An estimation may also have `contact(signals)`, which gives `in_contact` (s,) anew before
    `estimate`, for sensors on which contact does not show in every channel: 1, 0, and -1 in rows
    that are not good. A `fit` sees contact as the pipeline judged it. With `impossible(values)` it
    names taxels (s, t) of readings (s, t, c) that no sensor can give: they count as not read,
    also in baselines. With `warmed(baseline, then_c, now_c)` it tells how baselines (s, t, c) have
    changed (s, t, c) since the chips told the temperatures `then_c` (s, t), now that they tell
    `now_c` (s, t) or None; `delta` is less by that; its `forget_warmth()` is called before a fit.
    """

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        ...

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        ...

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn from conditioned frames; `groups` has 'group' and 'session' (s,)."""
        ...

    def start(self) -> object:
        """Fresh memory of a stream."""
        ...

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """State attributes (s, ...) for every row; those of unusable rows are ignored."""
        ...
