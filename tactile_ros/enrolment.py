# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Presses: found in a stream to learn a class by name, and programmes of them that twins play.

A press begins with contact after rest and ends with release, or when it has been held long
enough. Its class is learned from its strongest window, beside the baseline in use there: the same
frames give the same class, live and from a bag. A programme rests first and then presses at
changing places, so that a simple model of a sensor gives both the readings and the truth.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Frame, Integers, Layout, Recording

Signal = Callable[[float], Array]
Truth = Mapping[str, npt.NDArray[np.generic]]

REST_S, TARE_S = 1.0, 0.5
BLOCK = 1024  # rows of a model at once: thousands of taxels fill the memory otherwise
TOUCHED = 0.02  # share of a press's load below which it counts as not begun
LONGEST_NAME = 64
LONGEST = 12  # windows, after which a press that is still held counts


@dataclass(frozen=True)
class Touches:
    """Touches of the skin at some instants."""

    press: Integers  # (s,) number of the press; -1: nothing touches
    position: Array  # (s, 3) of the contact (m), NaN where nothing touches
    force: Array  # (s, 3) what the skin exerts on the object (N)
    share: Array  # (s,) load over that of the press, 0 to 1

    def rows(self, part: slice) -> Touches:
        """Some of the instants."""
        return Touches(self.press[part], self.position[part], self.force[part], self.share[part])


@dataclass(frozen=True)
class Programme:
    """Presses one after the other, with a rest before each."""

    positions: Array  # (n, 3) of the presses (m)
    forces: Array  # (n, 3) at their largest (N)
    # durations of the load's rise, hold and fall, and of the rest that follows (s)
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
    """Readings and truth of a whole programme as one stream, tared in its first half second.

    `reading` makes readings (s, t, c) without noise of touches, and `truth` columns of truth
    beside `in_contact`, `repetition` and `session`, which is the seed of the noise (standard
    deviation, unit of values). Readings are clipped to the `limits`.
    """
    count = round(programme.duration_s * layout.rate_hz)
    times = np.arange(count) / layout.rate_hz
    touches = programme.at(times)
    blocks = [touches.rows(slice(i, i + BLOCK)) for i in range(0, count, BLOCK)]
    values = np.concatenate([reading(block) for block in blocks])
    values = values + noise * np.random.default_rng(seed).normal(size=values.shape)
    return Recording.from_arrays(
        layout,
        np.clip(values, *limits),
        stamp_ns=np.round(1e9 * times).astype(np.int64),
        sequence=np.arange(count),
        tare=times < TARE_S,
        truth={
            **truth(touches),
            'in_contact': (touches.press >= 0).astype(np.int8),
            'repetition': np.maximum(touches.press, 0),
            'session': np.full(count, seed),
        },
    )


def playing(recording: Recording) -> Signal:
    """Signal, time (s) -> readings (t, c), that plays evenly spaced rows again and again."""
    values, rate_hz = recording.values, recording.layout.rate_hz
    return lambda t: values[round(t * rate_hz) % len(values)]


def thinned(recording: Recording, rate_hz: float = 20.0) -> Recording:
    """Recording with about so many frames a second, which teach as much of presses that last."""
    step = max(1, round(recording.layout.rate_hz / rate_hz))
    return recording.select(slice(None, None, step))


@dataclass(frozen=True)
class Press:
    """One press: its strongest frames, at most a window, and the baseline (t, c) in use there."""

    frames: tuple[Frame, ...]
    baseline: Array


@dataclass
class PressWatch:
    """Find presses in a stream, frame by frame, and keep `window` frames of each."""

    window: int
    _seen: list[tuple[Frame, Array]] = field(default_factory=list)
    _rested: bool = False
    _touched: bool = False

    def __call__(self, frame: Frame, in_contact: int, baseline: Array) -> Press | None:
        """Take the next frame with its contact and baseline (t, c); the press that ends here."""
        if in_contact == 0:
            # frames that nobody can judge are a press where they are many, and contact flickers
            least = max(self.window // 2 if self._touched else self.window, 1)
            seen, counts = self._seen, self._rested and len(self._seen) >= least
            self._seen, self._rested, self._touched = [], True, False
            return self._strongest(seen) if counts else None
        if not self._rested:  # it began before anybody watched
            return None
        self._touched = self._touched or in_contact == 1
        self._seen.append((frame, baseline))
        if len(self._seen) < LONGEST * self.window:
            return None
        seen, self._seen, self._rested = self._seen, [], False
        return self._strongest(seen)

    def _strongest(self, seen: Sequence[tuple[Frame, Array]]) -> Press:
        """The window that is farthest from the baseline, whatever is wrong with its readings."""
        change = np.array([np.nan_to_num(frame.values - base) for frame, base in seen])
        size = np.square(change).sum(axis=(1, 2))
        first = 0
        if len(seen) > self.window:
            first = int(np.convolve(size, np.ones(self.window), 'valid').argmax())
        some = seen[first : first + self.window]
        return Press(tuple(frame for frame, _ in some), some[0][1])


def recording_of(layout: Layout, presses: Sequence[Press]) -> Recording:
    """Presses as streams of their own, each after its baseline as a tare."""
    rows: list[Frame] = []
    for press in presses:
        stamp_ns = press.frames[0].stamp_ns
        rest = Frame(None if stamp_ns is None else stamp_ns - 1, 0, press.baseline)
        rows += [rest, *press.frames]
    lengths = [1 + len(press.frames) for press in presses]
    stream = np.repeat(np.arange(len(presses)), lengths)
    begins = np.isin(np.arange(len(rows)), np.cumsum([0, *lengths[:-1]]))
    return Recording.from_frames(layout, rows, stream=stream, tare=begins)


@dataclass(frozen=True)
class ClassChange:
    """A class that came or went in a live run, as `calibration` announces it.

    `digest`: SHA-256 of the calibration since; `after_ns`: stamp of the last frame before (ns),
    None: there was none; `presses`: first and last stamp of each (ns), empty: it was forgotten;
    `replace`: presses of that name were forgotten first.
    """

    label: str
    digest: str
    after_ns: int | None
    presses: tuple[tuple[int, int], ...] = ()
    replace: bool = False

    @property
    def last_ns(self) -> int:
        """Stamp of the last frame before (ns); -1: there was none."""
        return -1 if self.after_ns is None else self.after_ns

    def announcement(self) -> dict[str, object]:
        """Content of the message."""
        if not self.presses:
            return {'forgotten': self.label, 'after_ns': self.after_ns}
        presses = [list(stamps) for stamps in self.presses]
        return {
            'enrolled': self.label, 'after_ns': self.after_ns, 'presses': presses,
            'replace': self.replace,
        }  # fmt: skip

    @classmethod
    def read(cls, text: str) -> ClassChange | None:
        """Change that an announcement states; None where it makes no sense or states none."""
        try:
            stated = json.loads(text)
            label = stated.get('enrolled', stated.get('forgotten'))
            if not isinstance(label, str):
                return None
            after_ns = stated.get('after_ns')
            presses = tuple((int(a), int(b)) for a, b in stated.get('presses', ()))
            return cls(
                label, str(stated['sha256']), None if after_ns is None else int(after_ns),
                presses, bool(stated.get('replace')),
            )  # fmt: skip
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return None


@dataclass(frozen=True)
class Allowed:
    """Most that a new class may cost: shares of the presses of known classes."""

    lost: float = 0.05  # that it takes
    lost_there: float = 0.35  # 95 % bound of those that it takes whole where it was pressed


EVERYTHING = Allowed(1.0, 1.0)


def learn(
    pipeline: Pipeline,
    label: str,
    presses: Recording,
    replace: bool = False,
    allowed: Allowed = Allowed(),
) -> str:
    """Enrol a class and say, as a sentence, what was learned and what it costs.

    The presses are as of `recording_of`. With `replace`, those enrolled under that name before
    are forgotten; else they stay beside the new ones. Raises ValueError if a press is of no use,
    the name is taken, or known classes would lose too much: of no use is the pipeline then.
    """
    refuse_name(label)
    if replace and label in pipeline.label_names:
        pipeline.forget(label)
    pipeline.enrol(presses, label)
    stated = pipeline.report.get(f'enrolled {label}', {})
    cost = _cost(stated, pipeline.label_names)
    for name, most, of in (
        ('known_presses_lost', allowed.lost, 'of the known presses'),
        ('lost_there_at_most', allowed.lost_there, 'of the others where it was pressed'),
    ):
        if stated.get(name, 0.0) > most:
            msg = (
                f'{label!r} must take at most {100 * most:.3g} % {of}; {cost}: '
                'press where it looks less like the others'
            )
            raise ValueError(msg)
    count = int(stated.get('presses', 1))
    return f'{label!r} learned from {count} press{"es" if count > 1 else ""}; {cost}'


def _cost(stated: dict[str, float], names: Sequence[str]) -> str:
    """Sentence about the presses that a class takes from those known before."""
    said = 'no known press was there to judge what it costs'
    judged = stated.get('known_presses_judged', 0.0)
    if judged:
        said = (
            f'it takes {100 * stated["known_presses_lost"]:.3g} % of {judged:.0f} known presses, '
            f'{100 * stated["known_presses_lost_at_most"]:.3g} % at most (95 % bound)'
        )
    if np.isfinite(stated.get('lost_there', np.nan)):
        said += (
            f'; {100 * stated["lost_there"]:.3g} % of the others where it was pressed, '
            f'{100 * stated["lost_there_at_most"]:.3g} % at most'
        )
    there = 'lost_there '  # and the number of a class
    taken = [names[int(key.removeprefix(there))] for key in stated if key.startswith(there)]
    return f'{said}, likely all of {" and ".join(taken)} there' if taken else said


def refuse_name(label: str) -> None:
    """Raise ValueError for what is no name of a class."""
    if not label.strip() or len(label) > LONGEST_NAME or not label.isprintable():
        msg = (
            f'label of enrol must be a name of 1 to {LONGEST_NAME} printable characters; '
            f'received {label[: 2 * LONGEST_NAME]!r}'
        )
        raise ValueError(msg)


def window_of(pipeline: Pipeline) -> int:
    """Frames of a press, as the config says; ValueError if the sensor learns no classes."""
    if not pipeline.estimation.learns_classes:
        msg = f'{pipeline.sensor} learns no classes from presses'
        raise ValueError(msg)
    return int(pipeline.config.window)  # type: ignore[attr-defined]
