# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Guided calibration: the next target, the phase of a press, the presses kept, and their errors.

`PressGuide` is fed with frames and true forces and knows neither clock nor device. A press is kept
with the rest before it as its tare, so that drift between presses does no harm.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from tactile_ros.pipeline import Pipeline
from tactile_ros.types import (
    Array,
    Bools,
    Closing,
    Columns,
    Frame,
    Integers,
    Layout,
    Recording,
    TaxelStatus,
    join,
)

TARE_FRAMES = 20
CHECK_FRAMES = 50
LEAST_S = 0.3  # of a rest, whatever the rate is
TOUCH_Z = 8.0  # largest change over noise of a touch; that of 2000 quiet taxels is below 5
QUIET_Z = 4.0  # of half a rest against the other half
IN_A_ROW = 3  # frames that say the same
STEADY = 0.2  # of the usual change while held: what a hold may differ from it
WOBBLE_Z = 4.0  # of noise that it may always
RELEASED = 0.2  # of the largest change of a press: nothing touches but creep is left
LEFT = 0.5  # of the same, after `WAIT_S`: creep, a magnet that moved, but no weight that lies on
MOST_S = 60.0  # of one press
WAIT_S = 10.0  # for a rest or a release, before a remark
LEAST_NOISE = 1e-6  # of the largest reading, where no reading changes: rounding is no touch
TOO_SHORT = 'held too short: press there again'
RESTLESS = 'the readings wander: let go, keep magnets and cables away'
NOT_BACK = 'let go: the readings do not come back (if nothing touches, begin again)'
FOLDS = 4
MOST_ROWS = 25
WORSE = 2.0  # times the median: a place to press again
RIM = 0.75  # of the farthest target from the middle
UNKNOWN = np.full(3, np.nan)


class Phase(Enum):
    """Phases of a guided calibration, with what to do in each."""

    CHECK = 'let nothing touch'
    REST = 'let go and wait'
    PRESS = 'press at the ring'
    HOLD = 'hold'
    RELEASE = 'release'
    DONE = 'done'


@dataclass(frozen=True)
class Target:
    """One press that is asked for: a place (3,) (m) and a load (N), NaN: any."""

    position: Array
    load: float = np.nan


class Truth(Closing):
    """Source of the true force of a press: none here, only the places that were prompted."""

    steady = True  # its forces count where a press is steady alone
    loads: tuple[float, ...] = ()  # (N) to be laid on, in turn
    columns: tuple[str, ...] = ()  # of the truth that it measures

    def now(self) -> tuple[Array, Array | None]:
        """Force (3,) (N) and place (3,) (m) now; None: that of the target."""
        return UNKNOWN, None

    def follow(self, phase: Phase, number: int | None) -> None:
        """Take note of the phase and the number of the target."""

    def silent(self, press: Recording) -> bool:
        """Nothing came for a press from where something should come."""
        columns = (press.truth.get(name, UNKNOWN) for name in self.columns)
        return not all(np.isfinite(column).any() for column in columns)

    def close(self) -> None:
        """End."""


def grid_of(layout: Layout, count: int) -> Array:
    """About `count` places (n, 3) (m) of a grid over the layout, or taxels, that jump about."""
    low, high = layout.positions.min(axis=0), layout.positions.max(axis=0)
    size = (high - low)[:2]
    if (size <= 0).any():
        places = layout.positions[np.linspace(0, len(layout.positions) - 1, count).astype(int)]
        return np.unique(places, axis=0)
    columns = max(2, round(float(np.sqrt(count * size[0] / size[1]))))
    rows = max(2, round(count / columns))
    x, y = np.meshgrid(np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows))
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, high[2])])
    return np.asarray(places[np.random.default_rng(0).permutation(len(places))])


def mean_of(rows: Array) -> Array:
    """Mean of rows (s, ...) where they are measured; NaN where none is."""
    known = np.isfinite(rows)
    count = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    return np.asarray(np.where(known, rows, 0.0).sum(axis=0) / count)


def spread_of(rows: Array) -> Array:
    """Standard deviation of rows (s, ...) where they are measured; NaN where none is."""
    return np.sqrt(mean_of(np.square(rows - mean_of(rows))))


@dataclass(frozen=True)
class Preflight:
    """Noise (t, c) of untouched frames, and what is wrong with the sensor, in sentences."""

    noise: Array
    problems: tuple[str, ...]

    @classmethod
    def of(cls, layout: Layout, frames: Sequence[Frame]) -> Preflight:
        """Judge frames at rest: dead, saturated and noisy taxels, and a uniform stray field."""
        values = np.array([frame.values for frame in frames])
        status = np.array(
            [np.zeros(layout.shape[0], np.uint8) if f.status is None else f.status for f in frames]
        )
        noise = spread_of(np.diff(values, axis=0)) / np.sqrt(2)  # a slow touch is none
        read, most = noise[noise > 0], float(np.nanmax(np.abs(values), initial=0.0))
        usual = float(np.median(read)) if len(read) else LEAST_NOISE * most
        still = (np.nan_to_num(noise) == 0).all(axis=1)
        dead = still | ((status & TaxelStatus.DEAD) > 0).all(axis=0)
        full = ((status & TaxelStatus.SATURATED) > 0).any(axis=0)
        loud = (noise > 10 * usual).any(axis=1) & ~dead
        problems = [
            f'taxels {np.flatnonzero(found).tolist()} {what}'
            for found, what in (
                (dead, 'do not change at rest: dead, or their steps are too coarse to tell'),
                (full, 'are saturated at rest'),
                (loud, 'are ten times as noisy as the others'),
            )
            if found.any()
        ]  # fmt: skip
        if layout.unit == 'T' and len(layout.channels) == 3 and np.isfinite(values).any():
            field_t = float(np.linalg.norm(np.nanmedian(values, axis=(0, 1))))
            problems.append(f'uniform field at rest: {1e6 * field_t:.0f} uT (magnets and stray)')
        return cls(np.where(noise > 0, noise, max(usual, np.finfo(float).tiny)), tuple(problems))


@dataclass
class PressGuide:
    """Guide from press to press, frame by frame.

    With `steady_truth` true forces count where the press is steady alone, as their mean: a kitchen
    scale. `presses` are numbers of targets and frames of what was kept, such as of an earlier run.
    """

    layout: Layout
    targets: list[Target]
    steady_truth: bool = True
    hold_s: float = 1.0  # that a press is to be held
    presses: list[tuple[int, Recording]] = field(default_factory=list)
    phase: Phase = Phase.CHECK
    preflight: Preflight | None = None
    remark: str = ''  # why a press was not kept

    def __post_init__(self) -> None:
        rate_hz = self.layout.rate_hz or 100.0
        count = max(TARE_FRAMES, round(LEAST_S * rate_hz))
        self.wanted = np.maximum(1, self.counts)  # presses of each target
        self._rest: deque[tuple[Frame, Array]] = deque(maxlen=count)
        self._checked: list[Frame] = []
        self._pressed: list[tuple[Frame, Array, Array]] = []
        self._sizes: list[float] = []
        self._wandered: deque[Array] = deque(maxlen=200)  # some readings of a long wait
        self._noise = np.zeros(self.layout.shape)
        self._held, self._peak = np.nan, 0.0  # usual size while it was held; largest size
        self._waited, self._wait = 0, round(WAIT_S * rate_hz)  # frames
        self._level, self._often = UNKNOWN, max(1, count // 10)
        self._hold, self._most = max(1, round(self.hold_s * rate_hz)), round(MOST_S * rate_hz)

    @property
    def number(self) -> int | None:
        """Number of the target that is next; None: none is left."""
        missing = np.flatnonzero(self.counts < self.wanted)
        return int(missing[0]) if len(missing) else None

    @property
    def counts(self) -> Integers:
        """Presses kept of each target."""
        done = np.array([number for number, _ in self.presses], np.int64)
        return np.bincount(done, minlength=len(self.targets))

    def step(
        self, frame: Frame, force: Array = UNKNOWN, position: Array | None = None
    ) -> Recording | None:
        """Take a frame with the force (3,) (N) and the place (3,) (m) that are true now.

        `position` None: that of the target; NaN: unknown. Returns the press that was kept now.
        """
        if self.phase is Phase.CHECK:
            self._check(frame)
        elif self.phase is Phase.REST:
            self._wait_for_quiet(frame, force)
        elif self.phase is not Phase.DONE and np.isfinite(frame.values).any():
            return self._follow(frame, force, position)
        return None

    def _check(self, frame: Frame) -> None:
        self._checked.append(frame)
        if len(self._checked) >= CHECK_FRAMES:
            self.preflight = Preflight.of(self.layout, self._checked)
            self._noise, self.phase = self.preflight.noise, Phase.REST

    def _wait_for_quiet(self, frame: Frame, force: Array) -> None:
        self._rest.append((frame, force))
        self._sizes.clear()
        self._pressed.clear()
        self._waited += 1
        if self._waited % self._often == 0:
            self._wandered.append(frame.values)
        if self.number is None:
            self.phase, self._waited = Phase.DONE, 0
        elif self._waited % self._often == 0 and self._is_quiet():
            self.phase, self._waited, self._level = Phase.PRESS, 0, mean_of(self._rested())
            self._wandered.clear()
            if self.remark == RESTLESS:
                self.remark = ''
        elif self._waited % self._wait == 0:  # slow noise, which the check cannot tell from drift
            self.remark = RESTLESS
            self._measure_noise()

    def _measure_noise(self) -> None:
        assert self.preflight is not None
        self._noise = np.fmax(self.preflight.noise, spread_of(np.array(self._wandered)))

    def _rested(self) -> Array:
        return np.array([frame.values for frame, _ in self._rest])

    def _is_quiet(self) -> bool:
        if len(self._rest) < (self._rest.maxlen or 0):
            return False
        values = self._rested()
        half = len(values) // 2
        moved = mean_of(values[:half]) - mean_of(values[half:])
        z = np.abs(moved) / (self._noise * np.sqrt(2 / half))
        known = z[np.isfinite(z)]
        return len(known) > 0 and bool(np.quantile(known, 0.9) < QUIET_Z)

    def _size(self, frame: Frame) -> float:
        z = np.abs(frame.values - self._level) / self._noise
        return float(np.max(z, initial=0.0, where=np.isfinite(z)))

    def _follow(self, frame: Frame, force: Array, position: Array | None) -> Recording | None:
        size = self._size(frame)
        if self.phase is Phase.PRESS and size <= TOUCH_Z:
            self._go_on_resting(frame, force)
            return None
        if len(self._sizes) < self._most or self.phase is Phase.HOLD:
            place = self.targets[self.number or 0].position if position is None else position
            self._pressed.append((frame, force, place))
            self._sizes.append(size)
        else:  # nobody lets go
            self._sizes[-IN_A_ROW:] = [*self._sizes[1 - IN_A_ROW :], size]
        if self.phase is Phase.PRESS:
            if len(self._sizes) >= IN_A_ROW:
                self.phase, self.remark = Phase.HOLD, ''
                self._held, self._peak, self._waited = np.nan, 0.0, 0
        elif self.phase is Phase.HOLD:
            self._look_at_hold()
        elif self._is_gone():
            return self._keep()
        return None

    def _go_on_resting(self, frame: Frame, force: Array) -> None:
        self._pressed.clear()
        self._sizes.clear()
        self._rest.append((frame, force))
        self._waited += 1
        if self._waited % self._often == 0:  # seldom, as a large layout takes time
            self._level = mean_of(self._rested())
            self._wandered.append(frame.values)
        checked = self.preflight is not None and self._noise is self.preflight.noise
        if self._waited % self._wait == 0 and not checked:
            self._measure_noise()

    def _look_at_hold(self) -> None:
        last = np.array(self._sizes[-self._hold :])
        level = float(np.median(last))
        if len(last) >= self._hold and self._even(last, level).all():
            self._held, self.phase = level, Phase.RELEASE
        elif self._is_gone() or len(self._sizes) > self._most:
            self.phase = Phase.RELEASE  # what still presses must not be the next rest

    def _even(self, sizes: Array, level: float) -> Bools:
        return np.asarray(np.abs(sizes - level) <= max(STEADY * level, WOBBLE_Z))

    def _is_gone(self) -> bool:
        recent = self._sizes[-IN_A_ROW:]
        self._peak = max(self._peak, min(recent))
        releasing, held = self.phase is Phase.RELEASE, np.isfinite(self._held)
        self._waited = self._waited + 1 if releasing else 0
        late = self._waited > self._wait
        if late:
            self.remark = NOT_BACK
        share = LEFT if late and held else RELEASED
        return max(recent) < max(share * (self._held if held else self._peak), TOUCH_Z)

    def _keep(self) -> Recording | None:
        number = self.number
        kept = number is not None and np.isfinite(self._held)
        self.remark = '' if kept else TOO_SHORT
        press = self._labelled(number) if number is not None and kept else None
        if press is not None and number is not None:
            self.presses.append((number, press))
        self.phase, self._waited = Phase.REST, 0
        self._rest.clear()
        return press

    def _labelled(self, number: int) -> Recording:
        target, rests = self.targets[number], len(self._rest)
        frames = [*(f for f, _ in self._rest), *(f for f, _, _ in self._pressed)]
        steady = self._even(np.array(self._sizes[: len(self._pressed)]), self._held)
        held = np.r_[np.zeros(rests, bool), steady]
        position = np.full((len(frames), 3), np.nan)
        position[rests:] = [place for _, _, place in self._pressed]
        position[~held] = np.nan
        force = np.array([f for _, f in self._rest] + [f for _, f, _ in self._pressed])
        force = force - mean_of(force[:rests])  # unknown at rest: unknown
        if np.isfinite(target.load):
            force = np.where(held[:, None], [np.nan, np.nan, target.load], np.nan)
        elif self.steady_truth:
            force = np.where(held[:, None], mean_of(force[held]), np.nan)
        tare = np.arange(len(frames)) < rests
        truth: Columns = {
            'position': position,
            'in_contact': np.where(held, 1, np.where(tare, 0, -1)),
            'repetition': np.full(len(frames), number),
        }
        if np.isfinite(force).any():
            truth['force'] = np.where(tare[:, None], np.nan, force)
        return replace(Recording.from_frames(self.layout, frames, tare=tare), truth=truth)

    def repeat(self, numbers: Sequence[int]) -> None:
        """Ask for one more press at each of some targets."""
        self.wanted[numbers] = self.counts[numbers] + 1
        self.phase, self._waited = Phase.REST, 0
        self._rest.clear()


def groups_of_places(
    presses: Sequence[tuple[int, Recording]], targets: Sequence[Target]
) -> Integers:
    """Number (n,) of the place of each press."""
    places = np.round([targets[number].position for number, _ in presses], 6)
    return np.unique(places, axis=0, return_inverse=True)[1].reshape(-1)


def joined(presses: Sequence[tuple[int, Recording]], targets: Sequence[Target]) -> Recording:
    """Presses as one recording: a stream each; presses at one place are one group."""
    whole = join([press for _, press in presses])
    lengths = [len(press) for _, press in presses]
    whole.truth['repetition'] = np.repeat(groups_of_places(presses, targets), lengths)
    whole.truth.pop('session', None)
    return whole


@dataclass(frozen=True)
class HeldOut:
    """Errors (n,) of each press by calibrations that did not see its place, RMS over the press."""

    position: Array  # distance (m); NaN: not estimated
    force: Array  # size of the error (N)

    def worst(self, goal_m: float | None, goal_n: float | None) -> list[int]:
        """Presses whose error is above its goal; without a goal, above twice the median."""
        bad: set[int] = set()
        for errors, goal in ((self.position, goal_m), (self.force, goal_n)):
            if np.isfinite(errors).any():
                limit = WORSE * float(np.nanmedian(errors)) if goal is None else goal
                bad |= set(np.flatnonzero(np.nan_to_num(errors) > limit).tolist())
        return sorted(bad)

    def __str__(self) -> str:
        """Root mean square of both."""
        words = [
            f'{name} {scale * np.sqrt(np.nanmean(np.square(errors))):.2g} {unit}'
            for name, errors, scale, unit in (
                ('place', self.position, 1e3, 'mm'), ('force', self.force, 1.0, 'N'),
            )
            if np.isfinite(errors).any()
        ]  # fmt: skip
        count = f' (RMS of {len(self.position)} presses)'
        return ', '.join(words) + count if words else 'nothing is estimated'


def _some_rows(press: Recording) -> Integers:
    tare = np.zeros(len(press), bool) if press.tare is None else press.tare
    rows = np.flatnonzero(~tare)
    some = np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(np.int64)
    return np.concatenate([np.flatnonzero(tare), rows[some]])


def held_out(
    make: Callable[[], Pipeline], presses: Sequence[tuple[int, Recording]],
    targets: Sequence[Target],
) -> HeldOut:  # fmt: skip
    """Errors of presses by calibrations on the others, a quarter of the places at a time.

    A press gives at most `MOST_ROWS` frames beside its rest, since a hold repeats itself.
    """
    presses = [(number, press.select(_some_rows(press))) for number, press in presses]
    groups = groups_of_places(presses, targets)
    errors = np.full((2, len(presses)), np.nan)
    for fold in range(min(FOLDS, len(set(groups.tolist())))):
        left = [i for i in range(len(presses)) if groups[i] % FOLDS == fold]
        learned = [presses[i] for i in range(len(presses)) if groups[i] % FOLDS != fold]
        if not left or not learned:
            continue
        pipeline = make().fit(joined(learned, targets))
        for i in left:
            press = presses[i][1]
            states = pipeline.process_batch(press)
            for row, (name, axes) in enumerate((('position', 2), ('force', 3))):
                if name in press.truth:
                    off = (getattr(states, name) - press.truth[name])[:, :axes]
                    known = np.isfinite(off).any(axis=1)
                    if known.any():
                        size = np.nansum(np.square(off[known]), axis=1)
                        errors[row, i] = np.sqrt(size.mean())
    return HeldOut(*errors)


def where_in_words(places: Array, every: Array) -> str:
    """Region of some places (n, 3) among all (m, 3): at the rim, in the middle, or both."""
    middle = every[:, :2].mean(axis=0)
    reach = np.linalg.norm(every[:, :2] - middle, axis=1).max()
    rim = np.linalg.norm(places[:, :2] - middle, axis=1) > RIM * reach
    return 'at the rim' if rim.all() else 'in the middle' if not rim.any() else 'all over'
