# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Status bits of readings that cannot be trusted: saturated, wrapped, stuck, stale."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_ros.physics.compiled import compiled, inlined
from tactile_ros.physics.temperature import blank_implausible
from tactile_ros.types import Array, Bools, Bytes, TaxelStatus

LEAST_VOTES = 100  # readings
RUN, RUNS, REPEATS, CHANGED = range(4)  # counts of a taxel: repeats in this run, earlier runs
STALE, STUCK, DEAD = (int(TaxelStatus[name]) for name in ('STALE', 'STUCK', 'DEAD'))
ALL = np.empty(0, bool)
STUCK_AFTER = 10  # identical readings in a row
UNCHANGED = 1000  # readings since the start: the noise of no chip hides for so long
FALSE_ALARM = 1e-6  # probability with which noise alone makes such a run, of all taxels together
MARGIN = 0.02  # share of the range at its ends that counts as saturated
JUMP = 0.5  # of the range: the largest change from one reading to the next that is trusted


def measured_temperature(chips: Array) -> tuple[Array, int]:
    """Plausible temperatures (..., t), and how many frames have none, though chips sent some."""
    found = np.array(chips, np.float64, order='C')
    return found, int(blank_implausible(found.reshape(-1, found.shape[-1])))


class StuckDetector:
    """Runs of identical readings of t taxels, judged by how often each repeated itself before.

    The reading of a taxel is stale where its own repeats before make its run of identical ones
    less probable than `FALSE_ALARM`, and the taxel stuck where these are `STUCK_AFTER` or more. A
    repeat counts only where at least the share `others` of all taxels changed; a taxel that has
    not changed `least_changes` times yet may rest since the start, and where that is 0, it is
    stuck after `UNCHANGED`. Runs of stuck taxels are not learnt. With `whole` the board is judged
    so too, in which what was not read repeats itself, and is DEAD where all readings are 0.

    Notes
    -----
    The probability of a run is the larger of two: with the share of repeats among all readings, by
    a beta-binomial law, which counts how few were seen; and with that among readings that follow a
    repeat, since a taxel that rests between touches has few long runs.
    """

    def __init__(
        self, taxels: int, others: float = 0.0, least_changes: int = 0, whole: bool = False
    ) -> None:
        self._limits = np.array([np.log(FALSE_ALARM / taxels), others * taxels, least_changes])
        self._counts, self._board = np.zeros((taxels, 4)), np.zeros((int(whole), 4))
        self._counts[:, CHANGED] = self._board[:, CHANGED] = -1.0  # the first is no change
        self._last = np.empty((0, 0))  # readings as float64, which all counts fit
        self._follow(np.empty((0, taxels, 1)), ALL, ALL)  # no frame waits for a compiler

    def forget(self, taxels: Bools | slice = slice(None)) -> None:
        """Begin the runs of these taxels, and of the board, anew."""
        self._counts[taxels, RUN] = self._board[:, RUN] = 0

    def follow(
        self, readings: npt.NDArray[Any], measured: Bools = ALL, informative: bool = True
    ) -> Bools:
        """Take the next readings (t, c), as sent; the taxels (t,) that repeat their last one.

        Only taxels `measured` (t,) were read; empty: all. At the ends of the range a repeat is not
        `informative` and does not count.
        """
        same: Bools = self._follow(readings[None], measured, np.array([informative]))[0][0]
        return same

    def follow_frames(self, readings: Array, informative: Bools = ALL) -> Bytes:
        """Bits of `TaxelStatus`, shape (s, t), of readings (s, t, c); `informative` (s,)."""
        return self._follow(readings, ALL, informative)[1]

    def _follow(self, readings: Array, measured: Bools, informative: Bools) -> tuple[Bools, Bytes]:
        """Repeats and bits (s, t) of the next readings (s, t, c)."""
        now = np.array(readings, np.float64, order='C')
        same, status = np.zeros(now.shape[:2], bool), np.zeros(now.shape[:2], np.uint8)
        if self._last.shape != now.shape[1:]:
            self._last = np.full(now.shape[1:], np.nan)
        _follow_rows(
            now, measured, informative, self._limits, self._last, self._counts, self._board, same,
            status,
        )  # fmt: skip
        return same, status

    def status(self) -> Bytes:
        """Bits of `TaxelStatus`, shape (t,): STALE and STUCK."""
        return np.array([_bits(one, self._limits) for one in self._counts], np.uint8)


@inlined
def _bits(counts: Array, limits: Array) -> int:
    """STALE where a run of repeats is less probable than a false alarm, STUCK if it is long."""
    run, changed = counts[RUN], counts[CHANGED]
    if run == 0.0 or changed < limits[2]:
        return 0
    repeats, changes = counts[REPEATS] + 0.5, changed + 0.5
    again = counts[REPEATS] - counts[RUNS] + repeats / (repeats + changes)
    # beta-binomial: B(repeats + run, changes) / B(repeats, changes)
    log = math.lgamma(repeats + run) - math.lgamma(repeats + run + changes)
    log += math.lgamma(repeats + changes) - math.lgamma(repeats)
    log = max(log, run * math.log(again / (counts[REPEATS] + 1)))
    if log >= limits[0] and (changed > 0 or run < UNCHANGED):
        return 0
    return STALE | STUCK if run + 1 >= STUCK_AFTER else STALE


@inlined
def _count(same: bool, counts: Array, limits: Array) -> int:
    """Count a change, or the end of a run, of a taxel; 1 where it changed."""
    if same:
        return 0
    if counts[RUN] > 0 and _bits(counts, limits) & STUCK == 0:
        counts[REPEATS] += counts[RUN]
        counts[RUNS] += 1.0
    counts[RUN] = 0.0
    counts[CHANGED] += 1.0
    return 1


@compiled
def _follow_rows(
    readings: Array, measured: Bools, informative: Bools, limits: Array, last: Array,
    counts: Array, board: Array, same: Bools, status: Bytes,
) -> None:  # fmt: skip
    """Write repeats and bits (s, t) of readings (s, t, c); the last (t, c) and counts move on."""
    alone = np.array([math.log(FALSE_ALARM), 0.0, 0.0])
    for s in range(len(readings)):
        moved, alike, dead = 0, True, True
        counted = len(informative) == 0 or informative[s]
        for t in range(len(last)):
            read = len(measured) == 0 or measured[t]
            same[s, t] = read
            for c in range(last.shape[1]):
                now, before = readings[s, t, c], last[t, c]
                same[s, t] &= now == before
                alike &= now == before or (np.isnan(now) and np.isnan(before))
                dead &= now == 0.0
            if read:
                moved += _count(same[s, t], counts[t], limits)
                last[t] = readings[s, t]
        for t in range(len(last)):
            counts[t, RUN] += same[s, t] and counted and moved >= limits[1]
            status[s, t] = _bits(counts[t], limits)
        for one in board:
            _count(alike, one, alone)
            one[RUN] += alike and counted
            for t in range(len(last)):
                status[s, t] |= _bits(one, alone) | (DEAD if dead else 0)


class ChipFaultDetector:
    """Flags of t three-axis chips by their own readings; codes wrap at `full_scale` (3,) (T).

    Notes
    -----
    A code wraps beyond its range instead of clipping: only the way there tells a reading far
    outside from one inside. A chip whose reading jumped stays WRAPPED until it reads near its last
    trusted value again, has read elsewhere more often in a row than it was ever trusted (and 100
    times at least), or `forget` is called: nothing else tells a wrap from a magnet that was put
    on.
    """

    def __init__(self, taxels: int, full_scale: Array) -> None:
        self._limit = full_scale * (1 - MARGIN)
        self._jump = full_scale * JUMP
        self._stuck = StuckDetector(taxels)
        self._trusted = np.full((taxels, 3), np.nan)
        self._votes_for = np.zeros(taxels, np.int64)
        self._votes_against = np.zeros(taxels, np.int64)

    def forget(self) -> None:
        """Trust the next readings, whatever they are, as after a reset or at rest."""
        self._trusted[:] = np.nan
        self._votes_for[:] = self._votes_against[:] = 0
        self._stuck.forget()

    def status(
        self, codes: npt.NDArray[np.uint16], values: Array, measured: Bools, fresh: Bools
    ) -> Bytes:
        """Bits of `TaxelStatus` (t,) of one frame; 0 for chips that were not read.

        `codes` (t, c) as the chips sent them and `values` (t, 3), the same as fields (T);
        `measured` (t,) were read, `fresh` (t,) had time for a new measurement.
        """
        saturated = (np.abs(values) >= self._limit).any(axis=1)
        wrapped = self._wrapped(values, measured & ~saturated)
        repeated = self._stuck.follow(codes, measured)
        status = saturated * np.uint8(TaxelStatus.SATURATED)
        status |= wrapped * np.uint8(TaxelStatus.WRAPPED)
        if not np.count_nonzero(values):  # noise keeps a skin that has power from that
            status |= np.uint8(TaxelStatus.DEAD)
        if repeated.any():
            status |= (repeated & ~fresh) * np.uint8(TaxelStatus.STALE)
            status |= self._stuck.status()
        return np.where(measured, status, 0).astype(np.uint8)

    def _wrapped(self, values: Array, usable: Bools) -> Bools:
        """Chips that jumped away from their last trusted reading."""
        jumped: Bools = (np.abs(values - self._trusted) > self._jump).any(axis=1) & usable
        if jumped.any():
            self._votes_against += jumped
            enough = self._votes_against > np.maximum(self._votes_for, LEAST_VOTES)
            outvoted = jumped & enough
            self._votes_for[outvoted] = self._votes_against[outvoted]
            jumped &= ~outvoted
        trusted = usable & ~jumped
        self._trusted[trusted] = values[trusted]
        self._votes_for += trusted
        self._votes_against[trusted] = 0
        return jumped
