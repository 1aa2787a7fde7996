# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Temperatures of chip and magnet along a stream, and what they are wrong by.

The magnet follows the chip with a first-order lag, on the line between temperatures that were
measured; where none is, the last one holds and its error grows at the usual rate of change.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled, inlined
from tactile_ros.physics.temperature import REMANENCE_SLOPE, hall_ratio
from tactile_ros.types import Array, Bools, Integers, Signals

SECONDS_PER_NS = 1e-9
LEAST_RANGE = 3.0  # degrees that are one temperature
SAME = 1.0  # degrees between two frames of one stream that a tare parts
THIRD = 20.0  # variance of third differences of noise of 1
KINKED = 7.0  # medians of third differences: of an oven that begins to heat
FEWEST = 50  # frames that show the thermometer's noise
LAGS = (4.0, 12.0, 36.0, 108.0)  # s: tried, where the config leaves it open
BOW = 0.25  # of the change
LONG = 2.0  # lags that a stream lasts
STAMP, CHIP, MAGNET, NOISE, DRIFT, MEASURED, SKIPPED = 0, 1, 2, 3, 4, 5, 6  # of the memory


@inlined
def mean_row(chips: Array) -> float:
    """Mean of the temperatures of chips (t,) that are finite, NaN where none is."""
    total = count = 0.0
    for one in chips:
        if math.isfinite(one):
            total, count = total + one, count + 1.0
    return total / count if count > 0 else np.nan


@compiled
def follow_chip(
    chips: Array, usual: float, stamp_ns: Integers, restart: Bools, lag: float, rate: float,
    noise: float, spread: float, memory: Array, out: Array,
) -> None:  # fmt: skip
    """Write chip and magnet with their sigmas (s, 4) (K); the memory (7,) of the stream moves on.

    Temperatures are the mean of those of `chips` (s, t) that were measured, less the `usual` one;
    `rate` is how far they go in a second (K), `spread` (K) in any time.
    """
    for s in range(len(chips)):
        chip, second = mean_row(chips[s]) - usual, SECONDS_PER_NS * stamp_ns[s]
        known, since = math.isfinite(chip), second - memory[STAMP]
        if restart[s] and memory[MEASURED] > 0:
            apart = abs(chip - memory[CHIP]) if known else 0.0
            if since <= 0 or since > max(lag, 1e-3) or apart > SAME:
                memory[MEASURED] = 0.0
        if memory[MEASURED] == 0:
            memory[:], since = 0.0, 0.0
            memory[STAMP], memory[DRIFT] = second, 0.0 if known else spread
            if known:
                memory[MEASURED], memory[CHIP], memory[MAGNET] = 1.0, chip, chip
                memory[NOISE] = noise
        since = max(since, 0.0)
        fade = math.exp(-since / lag) if lag > 0 else 0.0
        gone = min(rate * since, spread) if memory[MEASURED] > 0 else spread
        if known:
            if since > 0:
                share = (1.0 - fade) * lag / since
                mean = fade * memory[MAGNET] + (share - fade) * memory[CHIP]
                memory[MAGNET] = mean + (1.0 - share) * chip
                memory[NOISE] = math.hypot(fade * memory[NOISE], (1.0 - fade) * noise)
                # how far temperatures leave the line between those that were measured
                bow = BOW * gone * (1.0 - fade) * memory[SKIPPED]
                memory[DRIFT] = math.hypot(fade * memory[DRIFT], bow)
            memory[CHIP], memory[STAMP], memory[SKIPPED] = chip, second, 0.0
            out[s, 0], out[s, 1], out[s, 2] = chip, noise, memory[MAGNET]
            out[s, 3] = math.hypot(memory[NOISE], memory[DRIFT])
        else:
            memory[SKIPPED] = 1.0
            out[s, 0], out[s, 1] = memory[CHIP], math.hypot(noise, gone)
            out[s, 2] = memory[CHIP] + fade * (memory[MAGNET] - memory[CHIP])
            out[s, 3] = fade * math.hypot(memory[NOISE], memory[DRIFT]) + (1.0 - fade) * gone


class Thermometer:
    """Behaviour of the chip temperatures of a recording."""

    usual_: float = float('nan')  # mean (degrees Celsius); NaN: none was measured
    noise_: float = 0.0  # of the thermometer (K), where a stream shows it
    # root mean square change in a second, and between any two frames (K)
    rate_: float = 0.0
    spread_: float = 0.0

    def __init__(self, lag: float = 0.0) -> None:
        self.lag_ = lag  # time constant with which the magnet follows (s)
        self.span_ = np.array([-np.inf, np.inf])  # least and highest (degrees Celsius)
        self.lags_ = np.zeros(0)  # that streams are long enough to tell from an offset (s)

    @property
    def varies(self) -> bool:
        """True where temperatures differed."""
        return bool(self.span_[0] + LEAST_RANGE < self.span_[1] < np.inf)

    def fit(self, signals: Signals) -> Thermometer:
        """Learn from the frames of a recording."""
        chip = mean_of(chips_of(signals))
        known = np.isfinite(chip) & signals.good
        if not known.any():
            return self
        self.usual_ = float(chip[known].mean())
        self.span_ = np.array([chip[known].min(), chip[known].max()])
        self.spread_ = self.rate_ = float(np.sqrt(2) * chip[known].std())
        if signals.stamp_ns is None:
            return self
        second = SECONDS_PER_NS * signals.stamp_ns
        inside = ~signals.restart[1:] & known[1:] & known[:-1] & (np.diff(second) > 0)
        third = np.abs(np.diff(chip, 3)[inside[2:] & inside[1:-1] & inside[:-2]])
        if len(third) >= FEWEST:
            usual = float(np.median(third))
            third = third[third < KINKED * usual] if usual > 0 else third
            self.noise_ = float(np.sqrt((third**2).mean() / THIRD))
        if inside.any():
            step, time = np.diff(chip)[inside], np.diff(second)[inside]
            drift = max(float((step**2).mean()) - 2 * self.noise_**2, 0.0)
            self.rate_ = float(np.sqrt(drift) / time.mean())
        stream = np.cumsum(signals.restart)
        longest = max(float(np.ptp(second[stream == name])) for name in np.unique(stream))
        self.lags_ = np.array([lag for lag in LAGS if LONG * lag <= longest])
        return self

    def follow(self, signals: Signals, memory: Array) -> Array:
        """Chip and magnet with their sigmas (s, 4) (K from the usual temperature).

        The memory (7,) of the stream moves on; frames without stamps have none.
        """
        out = np.zeros((len(signals.good), 4))
        if not math.isfinite(self.usual_):
            return out
        chips = chips_of(signals)
        if signals.stamp_ns is not None:
            follow_chip(
                chips, self.usual_, signals.stamp_ns, signals.restart, self.lag_, self.rate_,
                self.noise_, self.spread_, memory, out,
            )  # fmt: skip
            return out
        chip = mean_of(chips) - self.usual_
        known = np.isfinite(chip)
        out[:, 0] = out[:, 2] = np.where(known, chip, 0.0)
        out[:, 1] = np.where(known, self.noise_, self.spread_)
        # without times the magnet may be behind by what chips move in a time constant
        behind = min(self.rate_ * self.lag_, self.spread_)
        out[:, 3] = np.hypot(out[:, 1], behind)
        return out


def chips_of(signals: Signals) -> Array:
    """Temperatures of the chips (s, t) (degrees Celsius), NaN where none was measured."""
    chips = signals.temperature_c
    return np.full(signals.values.shape[:2], np.nan) if chips is None else chips


def mean_of(chips: Array) -> Array:
    """Mean (s,) of those of (s, t) that are finite, NaN where none is."""
    return np.array([mean_row(frame) for frame in np.ascontiguousarray(chips)], np.float64)


@compiled
def drift_rows(
    baseline: Array, then_c: Array, now_c: Array, sensitivity: Array, low: float, high: float,
    drift: Array,
) -> None:  # fmt: skip
    """Write changes (s, n) of baselines read at temperatures of chips then (s, t) until now."""
    for s in range(len(drift)):
        now, then = mean_row(now_c[s]), mean_row(then_c[s])
        ratio = hall_ratio(now, sensitivity, low, high) / hall_ratio(then, sensitivity, low, high)
        ratio *= 1.0 + REMANENCE_SLOPE * (now - then)
        share = ratio - 1.0 if math.isfinite(ratio) else 0.0
        for i in range(drift.shape[1]):
            drift[s, i] = share * baseline[s, i]
