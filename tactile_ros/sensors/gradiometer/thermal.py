"""Temperature of pixels and magnet: sensitivity, the baseline's own, and what lags behind.

[3]: the Hall sensitivity follows p0 + p1 dT + p2 dT^2 of the chip's temperature. The baseline was
read at another temperature, which nothing reports: it is told by how much stronger the disc at
rest was then than in the fit. Gap, stiffness and remanence follow the magnet, whose temperature
follows the chip's with a delay: what the chip's has risen by over fading means stands for that.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.signals import Signals
from tactile_ros.types import Array

CALIBRATED_AT = 35.0  # degrees Celsius [3]
LAGS = (8.0, 60.0)  # s
LONG = 5.0  # lags that a stream lasts
WEAKEST, STRONGEST = 0.7, 1.4
LEAST_RANGE = 3.0  # degrees
SPAN = 60.0  # degrees beyond 35 at which the polynomial of the sensitivity stands still
UNIT = 25.0  # degrees


class ThermalMemory:
    """Temperatures of one stream: the first, and fading means of what it rose by."""

    def __init__(self, lags: Array) -> None:
        self.history = History(lags) if len(lags) else None
        self.first: Array | None = None


def chip_temperature(signals: Signals) -> Array | None:
    """Mean temperature of the chips, shape (s,) (degrees Celsius); NaN unknown; None: no row."""
    if signals.temperature_c is None:
        return None
    known = np.isfinite(signals.temperature_c)
    count = known.sum(axis=1)
    total = np.where(known, signals.temperature_c, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def sensitivity(temperature_c: Array, coefficients: Array) -> Array:
    """Hall sensitivity at temperatures, of any shape; 1 where it is unknown."""
    rise = np.clip(temperature_c - CALIBRATED_AT, -SPAN, SPAN)
    found = coefficients[0] + coefficients[1] * rise + coefficients[2] * rise**2
    return np.where(np.isfinite(found) & (found > 0.1), found, 1.0)


def lagging(signals: Signals, chip: Array, usual: float, memory: ThermalMemory) -> Array:
    """Temperature and its lags over means, shape (s, 1 + m), from the usual one, over 25."""
    chip = np.where(np.isfinite(chip), chip, usual)
    lags = 0 if memory.history is None else len(memory.history.time_constants)
    columns = np.zeros((len(chip), 1 + lags))
    columns[:, 0] = (chip - usual) / UNIT
    if signals.stamp_ns is None or memory.history is None or not len(chip):
        return columns
    begins = signals.restart.copy()
    begins[0] |= memory.first is None
    start = np.maximum.accumulate(np.where(begins, np.arange(len(chip)), -1))
    earlier = chip[:1] if memory.first is None else memory.first
    first = np.where(start >= 0, chip[np.maximum(start, 0)], earlier[0])
    rise = (chip - first)[:, None]
    if len(chip) == 1:
        if begins[0]:
            memory.history.reset()
        means = memory.history.step(rise[0], int(signals.stamp_ns[0]))[None]
    else:
        means = memory.history(rise, signals.stamp_ns, begins)
    memory.first = first[-1:]
    columns[:, 1:] = (rise - means[:, :, 0]) / UNIT
    return columns


def lags_told(signals: Signals) -> Array:
    """Time constants (m,) (s) of which streams are long enough to tell them from an offset."""
    if signals.stamp_ns is None or not len(signals.stamp_ns):
        return np.zeros(0)
    stream = np.cumsum(signals.restart)
    stamps = 1e-9 * (signals.stamp_ns - signals.stamp_ns[0])
    longest = max(float(np.ptp(stamps[stream == name])) for name in np.unique(stream))
    return np.array([lag for lag in LAGS if LONG * lag <= longest])
