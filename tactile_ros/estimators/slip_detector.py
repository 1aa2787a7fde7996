# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Slip as a matched subspace detector: how much of a change lies where pulls have moved the skin.

A pull on an object between the pads is a wrench, and a skin in its linear range answers a wrench
in six ways at most. The patterns of known pulls span that subspace; what lies outside of it (a
stray field, a hand that lets go) counts against slip. Truth says of a whole sequence whether it
slips, not when: a sequence is judged by its strongest frame, and patterns are taken from frames at
least half as strong as that.

Source: L. L. Scharf and B. Friedlander, Matched subspace detectors, IEEE Trans. Signal Processing
42 (1994) 2146.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from tactile_ros.estimators.regression import fitted
from tactile_ros.types import Array, Bools, Integers, as_shape

WRENCH = 6
FOLDS = 10
FEWEST = 5
STRONG = 0.5  # of a sequence's largest change: frames whose pattern is a pull's
MISSED = 0.02  # share of pulls whose pattern may be too strange
BEYOND = 1.5  # times the largest change of any pull: not known
SMALLEST, SHARPNESS = 1e-3, 4.0  # of the threshold's search: range, and errors per ln of size
FARTHEST = 5.0  # |ln| of a score, so that no probability is exactly 0 or 1
FLATTEST, STEEPEST = 0.1, 50.0


class SlipDetector:
    """Tell sequences that slip from sequences that hold, frame by frame.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 20)[:, None]
    >>> pulls = [k * time * np.eye(8)[k % 2] for k in (4, 5, 6, 7, 8, 9)]
    >>> rests = [0.5 * time * np.eye(8)[k] for k in range(6)]
    >>> x, sequence = np.concatenate(pulls + rests), np.repeat(np.arange(12), 20)
    >>> detector = SlipDetector().fit(x, (sequence < 6).astype(int), sequence)
    >>> (detector.predict(x[[19, 139]]) > 0.5).tolist()
    [True, False]
    """

    basis_: Array  # (d, r) orthonormal patterns of pulls
    tilt_: float  # least ratio of the change inside the subspace to that outside of it
    level_: float  # least change inside the subspace (unit of the features)
    range_: float  # change beyond which nothing is known (unit of the features)
    slope_: float  # of the log odds over the logarithm of the score
    report_: dict[str, float]  # on held-out sequences

    def fit(self, x: Array, slip: Integers, sequence: Integers) -> SlipDetector:
        """Learn from finite changes (s, d) since the tare, of sequences (s,) that slip or hold.

        A sequence slips when any of its frames says 1. ValueError if fewer than five sequences
        slip, or fewer than five hold.
        """
        x = as_shape('x of SlipDetector', x, (-1, -1))
        parts = [np.flatnonzero(sequence == name) for name in np.unique(sequence)]
        pulls = [x[rows] for rows in parts if (slip[rows] == 1).any()]
        rests = [x[rows] for rows in parts if not (slip[rows] == 1).any()]
        if min(len(pulls), len(rests)) < FEWEST:
            msg = (
                f'slip must be known of at least {FEWEST} sequences that slip and {FEWEST} that '
                f'hold; received {len(pulls)} and {len(rests)}'
            )
            raise ValueError(msg)
        patterns = np.array([_pattern(pull) for pull in pulls])
        self.basis_ = _basis(patterns)
        self.range_ = BEYOND * max(float(np.linalg.norm(pull, axis=1).max()) for pull in pulls)
        unseen = _held_out(patterns)
        inside_pull = [self._split(pull, basis) for pull, basis in zip(pulls, unseen, strict=True)]
        inside_rest = [self._split(rest, self.basis_) for rest in rests]
        self.tilt_ = float(np.quantile([_steadiness(*parts) for parts in inside_pull], MISSED))
        pulled = np.array([self._strongest(*parts) for parts in inside_pull])
        rested = np.array([self._strongest(*parts) for parts in inside_rest])
        self.level_ = _level(pulled, rested)
        scores = [
            max(float(self._score(*parts).max()), 0.0) for parts in inside_pull + inside_rest
        ]
        slid = np.arange(len(scores)) < len(pulls)
        self.slope_ = _slope(np.log(np.clip(scores, np.exp(-FARTHEST), np.exp(FARTHEST))), slid)
        self.report_ = {**_judged(np.array(scores) > 1, slid), 'rows': float(len(x))}
        return self

    def predict(self, x: Array) -> Array:
        """Probability of slip (s,) at changes (s, d) since the tare; above 0.5: it slips.

        NaN where a feature is NaN, or the change is larger than pulls have ever made it.
        """
        fitted(self, 'basis_')
        inside, outside = self._split(x, self.basis_)
        score = self._score(inside, outside)
        known = np.isfinite(inside) & (np.hypot(inside, outside) <= self.range_)
        far = np.exp(FARTHEST)
        odds = self.slope_ * np.log(np.clip(np.where(known, score, 1.0), 1 / far, far))
        return np.where(known, 1.0 / (1.0 + np.exp(-odds)), np.nan)

    def _split(self, x: Array, basis: Array) -> tuple[Array, Array]:
        """Size (s,) of the change inside and outside of a subspace."""
        inside = np.linalg.norm(x @ basis, axis=1)
        total = np.square(x).sum(axis=1)
        return inside, np.sqrt(np.maximum(total - inside**2, 0.0))

    def _strongest(self, inside: Array, outside: Array) -> float:
        """Largest change inside the subspace among frames that may be a pull's; 0: none may."""
        fits = (inside >= self.tilt_ * outside) & (np.hypot(inside, outside) <= self.range_)
        return float(np.where(fits, inside, 0.0).max())

    def _score(self, inside: Array, outside: Array) -> Array:
        """Distance of a change beyond both thresholds, shape (s,); 1 at the nearer one."""
        least = np.maximum(self.level_, self.tilt_ * outside)
        return np.where(np.hypot(inside, outside) <= self.range_, inside / least, 0.0)


def _pattern(pull: Array) -> Array:
    """Mean outer product (d, d) of the directions of a pull's strong frames."""
    size = np.linalg.norm(pull, axis=1)
    strong = (size >= STRONG * size.max()) & (size > 0)
    unit = pull[strong] / size[strong, None]
    return np.asarray(unit.T @ unit / max(len(unit), 1))


def _basis(patterns: Array) -> Array:
    """Leading patterns (d, r) of pulls (n, d, d)."""
    _, vectors = np.linalg.eigh(patterns.mean(axis=0))
    return np.ascontiguousarray(vectors[:, ::-1][:, :WRENCH])


def _held_out(patterns: Array) -> list[Array]:
    """For each pull the basis of those that are not in its contiguous fold."""
    count = len(patterns)
    fold = np.arange(count) * min(FOLDS, count) // count
    bases = {int(name): _basis(patterns[fold != name]) for name in np.unique(fold)}
    return [bases[int(name)] for name in fold]


def _steadiness(inside: Array, outside: Array) -> float:
    """Best ratio of inside to outside among the strong frames of a pull."""
    strong = inside >= STRONG * inside.max()
    floor = np.finfo(np.float64).eps * inside.max() + np.finfo(np.float64).tiny
    return float((inside[strong] / np.maximum(outside[strong], floor)).max())


def _level(pulled: Array, rested: Array) -> float:
    """Threshold between two sets of sizes: fewest errors of both kinds, each counted softly.

    A count of errors alone would let one strange sequence move the threshold across the gap.
    """
    top = max(float(pulled.max()), np.finfo(np.float64).tiny)
    grid = np.geomspace(SMALLEST * top, top, 400)
    excess = [
        np.log(np.maximum(sizes, grid[0]))[:, None] - np.log(grid) for sizes in (pulled, rested)
    ]
    missed, alarms = (
        (1.0 / (1.0 + np.exp(sign * SHARPNESS * part))).mean(axis=0)
        for sign, part in zip((1, -1), excess, strict=True)
    )
    return float(grid[(missed + alarms).argmin()])


def _slope(scores: Array, slid: Bools) -> float:
    """Slope of balanced log odds over scores (n,), by maximum likelihood.

    Targets are drawn in by one sequence of either kind (J. Platt, 1999), so that it is finite.
    """
    count = np.array([(~slid).sum(), slid.sum()], np.float64)
    target = np.where(slid, (count[1] + 1) / (count[1] + 2), 1 / (count[0] + 2))
    weight = np.where(slid, 1 / count[1], 1 / count[0])

    def rise(slope: float) -> float:
        said = 1.0 / (1.0 + np.exp(-slope * scores))
        return float((weight * scores * (target - said)).sum())

    if rise(FLATTEST) * rise(STEEPEST) >= 0:
        return STEEPEST if rise(FLATTEST) > 0 else FLATTEST
    return float(brentq(rise, FLATTEST, STEEPEST, xtol=1e-12))


def _judged(said: Bools, slid: Bools) -> dict[str, float]:
    """Errors on sequences whose patterns the basis had not seen."""
    missed, alarms = int((slid & ~said).sum()), int((said & ~slid).sum())
    wrong = 0.5 * float(missed / slid.sum() + alarms / (~slid).sum())
    return {
        'held_out_balanced_accuracy': 1 - wrong,
        'groups': float(len(slid)),
        'sequences_that_slip': float(slid.sum()),
        'sequences_that_hold': float((~slid).sum()),
        'missed': float(missed),
        'false_alarms': float(alarms),
    }
