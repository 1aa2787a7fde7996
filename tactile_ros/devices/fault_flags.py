# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Status bits of readings that cannot be trusted: saturated, wrapped, stuck, stale."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import betaln

from tactile_ros.physics.temperature import plausible_temperature
from tactile_ros.types import Array, Bools, Bytes, TaxelStatus

LEAST_VOTES = 100  # readings
STUCK_AFTER = 10  # identical readings in a row
UNCHANGED = 1000  # readings since the start: the noise of no chip hides for so long
FALSE_ALARM = 1e-6  # probability with which noise alone makes such a run, of all taxels together
MARGIN = 0.02  # share of the range at its ends that counts as saturated
JUMP = 0.5  # of the range: the largest change from one reading to the next that is trusted


def measured_temperature(chips: Array) -> tuple[Array, int]:
    """Plausible temperatures (..., t), and how many frames have none, though chips sent some."""
    found = plausible_temperature(chips)
    refused = np.isnan(found).all(axis=-1) & ~np.isnan(chips).all(axis=-1)
    return found, int(np.count_nonzero(refused))


class StuckDetector:
    """Runs of identical readings of t taxels, judged by how often each repeated itself before.

    The reading of a taxel is stale where its own repeats before make its run of identical ones
    less probable than `FALSE_ALARM`, and the taxel stuck where these are `STUCK_AFTER` or more. A
    repeat counts only where at least the share `others` of all taxels changed; a taxel that has
    not changed `least_changes` times yet may rest since the start, and where that is 0, it is
    stuck after `UNCHANGED`. Runs of stuck taxels are not learnt.

    Notes
    -----
    The probability of a run is the larger of two: with the share of repeats among all readings, by
    a beta-binomial law, which counts how few were seen; and with that among readings that follow a
    repeat, since a taxel that rests between touches has few long runs.
    """

    def __init__(self, taxels: int, others: float = 0.0, least_changes: int = 0) -> None:
        self._log_chance = np.log(FALSE_ALARM / taxels)
        self._others = others * taxels
        self._least_changes = least_changes
        self._readings: npt.NDArray[Any] | None = None
        self._run = np.zeros(taxels)
        self._runs = np.zeros(taxels)
        self._repeats = np.zeros(taxels)
        self._changed = np.zeros(taxels)

    def forget(self, taxels: Bools | slice = slice(None)) -> None:
        """Begin the runs of these taxels anew."""
        self._run[taxels] = 0

    def follow(
        self, readings: npt.NDArray[Any], measured: Bools | None = None, informative: bool = True
    ) -> Bools:
        """Take the next readings (t, c), as sent; the taxels (t,) that repeat their last one.

        Only taxels `measured` (t,) were read; None: all. At the ends of the range a repeat is not
        `informative` and does not count.
        """
        if self._readings is None:
            self._readings = readings.copy()
            return np.zeros(len(readings), bool)
        same: Bools = (readings == self._readings).all(axis=1)
        if measured is None and not np.count_nonzero(same) and not np.count_nonzero(self._run):
            self._changed += 1.0  # as usual
            self._readings[:] = readings
            return same
        changed = ~same
        if measured is not None:
            same &= measured
            changed &= measured
        if self._run.any():
            honest = changed & ~self.stuck()
            self._repeats[honest] += self._run[honest]
            self._runs[honest] += self._run[honest] > 0
            self._run[changed] = 0
        self._changed += changed
        if informative and np.count_nonzero(changed) >= self._others:
            self._run += same
        self._readings[changed] = readings[changed]
        return same

    def follow_frames(self, readings: Array, informative: Bools | None = None) -> Bytes:
        """Bits of `TaxelStatus`, shape (s, t), of readings (s, t, c); `informative` (s,)."""
        status = np.zeros(readings.shape[:2], np.uint8)
        for i, frame in enumerate(readings):
            if self.follow(frame, None, informative is None or bool(informative[i])).any():
                status[i] = self.status()
        return status

    def status(self) -> Bytes:
        """Bits of `TaxelStatus`, shape (t,): STALE and STUCK."""
        stale = self._unlikely()
        stuck = (stale & (self._run + 1 >= STUCK_AFTER)) * np.uint8(TaxelStatus.STUCK)
        return np.asarray(stale * np.uint8(TaxelStatus.STALE) | stuck, np.uint8)

    def stuck(self) -> Bools:
        """Taxels, shape (t,), whose run of repeats is longer than their own noise explains."""
        return (self.status() & TaxelStatus.STUCK) > 0

    def _unlikely(self) -> Bools:
        """Taxels whose run is less probable than that."""
        repeats, changes = self._repeats + 0.5, self._changed + 0.5
        again = self._repeats - self._runs + repeats / (repeats + changes)
        log = np.maximum(
            betaln(repeats + self._run, changes) - betaln(repeats, changes),
            self._run * np.log(again / (self._repeats + 1)),
        )
        unlikely = (log < self._log_chance) | ((self._changed == 0) & (self._run >= UNCHANGED))
        return np.asarray(unlikely & (self._changed >= self._least_changes), np.bool_)


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
