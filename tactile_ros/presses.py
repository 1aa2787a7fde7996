"""A programme of presses: rest first, then touches of growing load at changing places.

Twins of sensors without a scene play it. It says for every time where the skin is touched and
with what force, so that a simple model of a sensor gives both the readings and the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Integers, Layout, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Signal = Callable[[float], Array]
    Truth = Mapping[str, npt.NDArray[np.generic]]

REST_S = 1.0
TARE_S = 0.5
BLOCK = 1024  # rows of a model at once: thousands of taxels fill the memory otherwise
TOUCHED = 0.02  # share of a press's load below which it counts as not begun


@dataclass(frozen=True)
class Touches:
    """What touches the skin at some instants.

    Attributes
    ----------
    press : ndarray, shape (s,)
        Number of the press; -1: nothing touches.
    position : ndarray, shape (s, 3)
        Of the contact (m); NaN where nothing touches.
    force : ndarray, shape (s, 3)
        What the skin exerts on the object (N); 0 where nothing touches.
    share : ndarray, shape (s,)
        Load over that of the press, 0 to 1.
    """

    press: Integers
    position: Array
    force: Array
    share: Array

    def rows(self, part: slice) -> Touches:
        """Some of the instants."""
        return Touches(self.press[part], self.position[part], self.force[part], self.share[part])


@dataclass(frozen=True)
class Programme:
    """Presses one after the other, with a rest before each.

    Attributes
    ----------
    positions, forces : ndarray, shape (n, 3)
        Of the presses (m), and their largest forces (N).
    rise_s, hold_s, fall_s, pause_s : float
        Durations (s) of the load's rise, hold and fall, and of the rest that follows.
    """

    positions: Array
    forces: Array
    rise_s: float = 0.3
    hold_s: float = 0.4
    fall_s: float = 0.15
    pause_s: float = 0.35

    @property
    def period_s(self) -> float:
        """Time of one press with its rest (s)."""
        return self.rise_s + self.hold_s + self.fall_s + self.pause_s

    @property
    def duration_s(self) -> float:
        """Time of the whole programme (s); it begins anew then."""
        return REST_S + len(self.positions) * self.period_s

    def at(self, times: npt.ArrayLike) -> Touches:
        """Touches at times (s,) in seconds since the start."""
        t = np.mod(np.asarray(times, np.float64), self.duration_s) - REST_S
        press = np.floor(t / self.period_s).astype(np.int64)
        phase = t - press * self.period_s
        corners = np.cumsum([0.0, self.rise_s, self.hold_s, self.fall_s])
        share = np.interp(phase, corners, [0.0, 1.0, 1.0, 0.0])
        touched = (share > TOUCHED) & (press >= 0) & (press < len(self.positions))
        row = np.clip(press, 0, len(self.positions) - 1)
        share = np.where(touched, share, 0.0)
        return Touches(
            np.where(touched, press, -1),
            np.where(touched[:, None], self.positions[row], np.nan),
            self.forces[row] * share[:, None],
            share,
        )


def growing_loads(count: int, low: float, high: float, rng: np.random.Generator) -> Array:
    """Loads (n,) that grow from `low` to `high` within every six presses, a little scattered."""
    step = (np.arange(count) % 6) / 5
    loads: Array = (low + (high - low) * step) * rng.uniform(0.9, 1.0, count)
    return np.maximum(loads, low)


def recorded(
    layout: Layout,
    programme: Programme,
    reading: Callable[[Touches], Array],
    truth: Callable[[Touches], Truth],
    noise: float | Array,
    seed: int,
    limits: tuple[float, float] = (-np.inf, np.inf),
) -> Recording:
    """Readings and truth of a whole programme.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its rate is that of the frames.
    programme : Programme
        What touches.
    reading : callable
        Model of the sensor: touches -> readings (s, t, c) without noise.
    truth : callable
        Touches -> columns of truth beside `in_contact`, `repetition` and `session`.
    noise : float or ndarray, shape (c,)
        Standard deviation of a reading (unit of values); 0: none.
    seed : int
        Of the noise; also the number of the session.
    limits : tuple of float
        Readings are clipped to them.

    Returns
    -------
    Recording
        One stream; the first half second of its rest is a tare.
    """
    count = round(programme.duration_s * layout.rate_hz)
    times = np.arange(count) / layout.rate_hz
    touches = programme.at(times)
    blocks = [touches.rows(slice(i, i + BLOCK)) for i in range(0, count, BLOCK)]
    values = np.concatenate([reading(block) for block in blocks])
    values = values + noise * np.random.default_rng(seed).normal(size=values.shape)
    known = {
        **truth(touches),
        'in_contact': (touches.press >= 0).astype(np.int8),
        'repetition': np.maximum(touches.press, 0),
        'session': np.full(count, seed),
    }
    return Recording.from_arrays(
        layout,
        np.clip(values, *limits),
        stamp_ns=np.round(1e9 * times).astype(np.int64),
        sequence=np.arange(count),
        tare=times < TARE_S,
        truth=known,
    )


def playing(recording: Recording) -> Signal:
    """Signal that plays the rows of a recording by their stamps, again and again.

    Parameters
    ----------
    recording : Recording
        With evenly spaced stamps.

    Returns
    -------
    callable
        Time (s) -> readings, shape (t, c).
    """
    values, rate_hz = recording.values, recording.layout.rate_hz
    return lambda t: values[round(t * rate_hz) % len(values)]


def thinned(recording: Recording, rate_hz: float = 20.0) -> Recording:
    """Recording with fewer frames a second, which teach as much of presses that last.

    Parameters
    ----------
    recording : Recording
        With the rate of its layout.
    rate_hz : float
        About how many frames a second stay; all, if the layout's rate is lower.

    Returns
    -------
    Recording
        Every n-th row, tare rows included.
    """
    step = max(1, round(recording.layout.rate_hz / rate_hz))
    return recording.select(slice(None, None, step))
