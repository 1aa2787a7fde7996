"""What a recording teaches about rest: baseline, noise and the threshold of contact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tactile_ros.conditioning.baseline import tare_level, tare_means
from tactile_ros.conditioning.contact import contact_scale, excursion
from tactile_ros.conditioning.noise import (
    MOST_APART_NS,
    held_noise,
    motion_noise,
    rest_noise,
    spread_noise,
)
from tactile_ros.types import Array, Bools, Integers

FEWEST_PAIRS = 8

COLDEST, HOTTEST = -60.0, 200.0  # degrees Celsius


@dataclass(frozen=True)
class Rest:
    """The state of a sensor that nothing touches.

    Attributes
    ----------
    baseline : ndarray, shape (t, c)
        No-contact reference (unit of values); NaN: none yet.
    noise : ndarray, shape (t, c)
        Standard deviation of a channel; NaN: unknown.
    scale : ndarray, shape (t, c)
        Deviation beyond which something touches; NaN: unknown, inf: never, a dead taxel.
    tared : bool
        False: the estimators were fitted on readings without a baseline, and get such.
    drifts : bool
        True: rests were too short to tell noise from drift between them, and `noise` is at most
        this.
    temperature_c : ndarray, shape (t,), or None
        Of the chips when the baseline was read (degrees Celsius), NaN: not told; None: the
        estimators do not heed it.
    """

    baseline: Array
    noise: Array
    scale: Array
    tared: bool = True
    drifts: bool = False
    temperature_c: Array | None = None

    @classmethod
    def unknown(
        cls, shape: tuple[int, int], stated_noise: float | Array | None, warms: bool = False
    ) -> Rest:
        """Rest of a sensor that has not been recorded, with the noise its config states.

        `warms`: its estimators heed how warm the chips were then.
        """
        stated = np.nan if stated_noise is None else stated_noise
        noise = np.array(np.broadcast_to(np.asarray(stated, np.float64), shape))
        chips = np.full(shape[0], np.nan) if warms else None
        scale = contact_scale(noise, None)
        return cls(np.full(shape, np.nan), noise, scale, temperature_c=chips)

    @property
    def level(self) -> Array:
        """Baseline (t, c); with temperatures, where they are heeded, as one more channel."""
        if self.temperature_c is None:
            return self.baseline
        chips = self._of_living(self.temperature_c)
        return np.concatenate([self.baseline, chips[:, None]], axis=1)

    def beside(self, values: Array, chips: Array | None) -> Array:
        """Readings (s, t, c) as `level` has them: chips tell temperatures (s, t), or None."""
        if self.temperature_c is None:
            return values
        told = np.full(values.shape[:2], np.nan) if chips is None else chips
        return np.concatenate([values, self._of_living(told)[:, :, None]], axis=2)

    def _of_living(self, chips: Array) -> Array:
        """Temperatures (..., t), NaN of what is none and of dead taxels, whose may stand still."""
        told = sound(chips)
        return told if self.dead is None else np.where(self.dead, np.nan, told)

    def parted(self, levels: Array) -> tuple[Array, Array | None]:
        """Baselines (s, t, c) and temperatures (s, t), or None, of levels as `level` has them."""
        if self.temperature_c is None:
            return levels, None
        return levels[..., :-1], levels[..., -1]

    def tared_by(self, frames: Array) -> Rest:
        """The same with the mean of resting frames (s, t, ...), as `beside` gives them.

        Raises
        ------
        ValueError
            If no taxel was read.
        """
        values, chips = self.parted(frames)
        return replace(
            self, baseline=tare_level(values, self.dead), temperature_c=mean_warmth(chips)
        )

    def learn(
        self,
        values: Array,
        resting: Bools,
        stamp_ns: Integers | None,
        restarts: Bools,
        ordered: bool = True,
        chips: Array | None = None,
    ) -> Rest:
        """Baseline and noise from the resting rows of a recording.

        Parameters
        ----------
        values : ndarray, shape (s, t, c)
            Readings, NaN where unusable (unit of values).
        resting : ndarray, shape (s,)
            Rows that give the baseline; if there is none, readings are used without one.
        stamp_ns : ndarray, shape (s,), or None
            Acquisition times.
        restarts : ndarray, shape (s,)
            Rows at which a stream begins.
        ordered : bool
            False: independent frames, whose order says nothing; what they differ by is noise.
        chips : ndarray, shape (s, t), or None
            Temperatures that they told (degrees Celsius).

        Returns
        -------
        Rest
            With the threshold of contact still to be set by `threshold`.
        """
        if not resting.any():
            return replace(self, baseline=np.zeros(values.shape[1:]), tared=False)
        whole = np.zeros(int(resting.sum()), np.int64)
        baseline = tare_means(values[resting], whole)[0]
        told = self.parted(self.beside(values, chips)[resting])[1]
        learned = replace(self, baseline=baseline, temperature_c=mean_warmth(told))
        if not ordered:
            seen = spread_noise(values[resting])
            noise = np.where(np.isnan(self.noise), seen, self.noise)
            return replace(learned, noise=noise)
        group = _rests(resting, stamp_ns, restarts)
        drifts = int((group[1:] == group[:-1]).sum()) < FEWEST_PAIRS
        if drifts:
            stream = np.cumsum(restarts)[resting]
            group = whole if stamp_ns is None else np.asarray(stream, np.int64)
        seen = rest_noise(values[resting], group)
        begins = restarts.copy()
        begins[1:] |= resting[1:] != resting[:-1]
        if stamp_ns is not None:
            moving = motion_noise(values, stamp_ns, begins)
            # a bound of 0 is of readings below a quantum, or repeated, and none
            seen = np.fmin(seen, np.where(moving > 0, moving, np.nan))
        elif drifts:
            touch = np.asarray(np.cumsum(begins), np.int64)[~resting]
            held = held_noise(values[~resting], touch)
            seen = np.where((held > 0) & (held < seen), held, seen)
        drifts = drifts and bool(np.isnan(self.noise).any())
        noise = np.where(np.isnan(self.noise), seen, self.noise)
        return replace(learned, noise=noise, drifts=drifts)

    @cached_property
    def dead(self) -> Bools | None:
        """Taxels (t,) that were dead in the fit and are left out since; None: there are none."""
        dead: Bools = np.all(np.isinf(self.scale), axis=1)
        return dead if dead.any() else None

    def threshold(
        self, touched: Array, firm: Array | None = None, dead: Bools | None = None
    ) -> Rest:
        """Set the threshold of contact, from the noise and from known touches.

        Parameters
        ----------
        touched, firm : ndarray, shape (s, t, c)
            Deviations of known touches, the lightest among them; of firm ones, which limit the
            threshold where drift passes for noise: where none is known, all touches do.
        dead : ndarray, shape (t,), or None
            Taxels that never touch.

        Returns
        -------
        Rest
            With the threshold.
        """
        known = _whole(touched)
        felt = None if firm is None else _whole(firm)
        felt = known if felt is None else felt
        scale = contact_scale(self.noise, known, felt if self.drifts else None)
        if dead is not None:
            scale[dead] = np.inf
        return replace(self, scale=scale)

    def contact(self, delta: Array, good: Bools, tare: Bools | None) -> npt.NDArray[np.int8]:
        """Say of each frame whether anything touches.

        Parameters
        ----------
        delta : ndarray, shape (s, t, c)
            Deviations from the baseline.
        good, tare : ndarray, shape (s,)
            Rows that may be judged; rows that are known to rest, or None.

        Returns
        -------
        ndarray, shape (s,)
            1 where a channel left the threshold, 0 where none did, -1 unknown.
        """
        if not self.tared:
            return np.full(len(delta), -1, np.int8)
        size = excursion(delta, self.scale)
        if len(size) == 1 and tare is None:
            return np.array([size[0] > 1.0 if good[0] and size[0] >= 0 else -1], np.int8)
        contact = (size > 1.0).astype(np.int8)
        if tare is not None:
            contact[tare] = 0
        judged = good & (size >= 0)  # false for NaN
        if np.count_nonzero(judged) < len(judged):
            contact[~judged] = -1
        return contact


def sound(chips: Array) -> Array:
    """Temperatures, NaN of what no chip can have."""
    told = (chips >= COLDEST) & (chips <= HOTTEST)
    return chips if np.count_nonzero(told) == told.size else np.where(told, chips, np.nan)


def mean_warmth(chips: Array | None) -> Array | None:
    """Mean temperatures (t,) of frames (s, t), each chip by what it told; NaN: it told nothing."""
    if chips is None:
        return None
    return np.asarray(tare_means(chips[:, :, None], np.zeros(len(chips), np.int64))[0, :, 0])


def _whole(touched: Array) -> Array | None:
    """Frames (s, t, c) of which all was read; None if there is none."""
    usable = touched[~np.isnan(touched).any(axis=(1, 2))]
    return usable if len(usable) else None


def _rests(resting: Bools, stamp_ns: Integers | None, restarts: Bools) -> Integers:
    """Number of the rest that each resting row is of: rows that follow near in time."""
    rows = np.flatnonzero(resting)
    ends = (np.diff(rows) > 1) | restarts[rows[1:]]
    if stamp_ns is not None:
        ends |= np.diff(stamp_ns[rows]) > MOST_APART_NS
    return np.concatenate([[0], np.cumsum(ends)])
