# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Contracts of devices, twins and estimators, and records that pass between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import plain
from tactile_ros.types.contact import ContactState
from tactile_ros.types.frame import Array, Bools, Bytes, Columns, Frame, Integers, Layout, as_shape

Report = dict[str, dict[str, float]]


@dataclass  # frozen it costs a frame 2 us
class Signals:
    """Conditioned frames, as features are made from them.

    Attributes
    ----------
    values, delta, baseline : ndarray, shape (s, t, c)
        Readings, readings less their baseline, and that (unit of values); NaN where unusable. The
        baseline is 0 where none is used, NaN where there is none yet.
    temperature_c, rest_temperature_c : ndarray, shape (s, t), or None
        Of the chips: of each row, and of its baseline (NaN: unknown); None: not used.
    stamp_ns : ndarray, shape (s,), or None
        None: independent frames, no step with memory is run.
    restart, begins : ndarray, shape (s,)
        Rows before which memory is forgotten (new stream or baseline); those at which a stream
        begins, and the ids of its patches, None: none.
    in_contact, good : ndarray, shape (s,)
        1, 0, -1 unknown; rows that may be estimated from.
    tare : ndarray, shape (s,), or None
        Rows that a recording calls resting; None: unknown.
    baseline_variance : ndarray, shape (s,), or None
        Over that of a frame at rest: one over the frames of its tare; 0 or None: of the fit's own.
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
    baseline_variance: Array | None = None
    rest_temperature_c: Array | None = None

    def select(self, rows: slice, after_failure: bool = False) -> Signals:
        """Rows that follow one another; memory begins anew where the frame before failed."""
        columns = {name: None if x is None else x[rows] for name, x in vars(self).items()}
        part = Signals(**columns)  # type: ignore[arg-type]
        if not after_failure:
            return part
        return replace(part, restart=part.restart | (np.arange(len(part.restart)) == 0))


class Estimation:
    """Features and estimators of one sensor; a sensor overrides the hooks that it needs.

    `uses_temperature`: baselines hold the temperatures of their chips, and `thermal_drift` is
    asked. `learns_classes`: `enrol` and `forget` work. `has_surface`: `surface` works.
    """

    uses_temperature: ClassVar[bool] = False
    learns_classes: ClassVar[bool] = False
    has_surface: ClassVar[bool] = False

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return {}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        return {}

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the classes that it can recognise."""
        return ()

    def begin_fit(self) -> None:
        """Forget what conditioning used of an earlier fit, before the baseline is learned."""

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn from conditioned frames; `groups` has 'group' and 'session' (s,)."""
        raise NotImplementedError

    def start(self) -> object:
        """Fresh memory of a stream."""
        return None

    def refuse_damage(self) -> None:
        """Raise ValueError where a part does not answer what its fit stored with it."""

    def implausible_taxels(self, values: Array) -> Bools | None:
        """Taxels (s, t) whose readings (s, t, c) no sensor can give: they count as not read."""

    def estimable_rows(self, bits: Bytes) -> Bools | None:
        """Rows (s,) that can be estimated from in spite of taxel faults; None: those without."""

    def thermal_drift(
        self, baseline: Array, reference_c: Array, temperature_c: Array | None
    ) -> Array:
        """Change of baselines (s, t, c) that were read at `reference_c` (s, t), NaN: unknown."""
        raise NotImplementedError

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Contact (s,), 1, 0, -1: for sensors on which it does not show in every channel."""
        return signals.in_contact

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """State attributes (s, ...) for every row; those of unusable rows are not used."""
        raise NotImplementedError

    def enrol(self, signals: Signals, label: str) -> None:
        """Learn a class from presses; ValueError if they are too weak, clipped or none."""
        raise NotImplementedError

    def forget(self, label: str) -> None:
        """Undo an enrolment by name."""
        raise NotImplementedError

    def surface(self, state: ContactState) -> Array:
        """Points of the touched surface (t, 3) (m), NaN where nothing touches."""
        raise NotImplementedError


@dataclass(frozen=True)
class GripCommand:
    """Targets (j,) for every joint of a hand, in the order of the hand's own topic.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the newest force that it answers (ns); when it was decided, where there is none.
    position, effort : ndarray, shape (j,)
        Positions (rad; 0 open to 1 closed for a synergy), which hold where nothing follows; torque
        that each may take at most (N m), NaN: the hand's own limit.
    """

    stamp_ns: int
    position: Array
    effort: Array


@dataclass(frozen=True)
class JointLimits:
    """Limits (j,) of the joints of a hand.

    Positions (rad, or 1 for a synergy), fastest motion (position per s) and largest torque (N m;
    inf: not known).
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    def __post_init__(self) -> None:
        count = np.size(self.lower)
        for entry in fields(self):
            column = as_shape(f'{entry.name} of JointLimits', getattr(self, entry.name), (count,))
            object.__setattr__(self, entry.name, column)
        low, high, speed, effort = self.lower, self.upper, self.velocity, self.effort
        crossed = [f'{low[i]} and {high[i]} for joint {i}' for i in np.flatnonzero(~(low < high))]
        for good, name, wanted, found in (
            (np.isfinite(low) & np.isfinite(high), 'lower and upper', 'finite', f'{low}, {high}'),
            (low < high, 'lower', 'below upper', ', '.join(crossed)),
            (np.isfinite(speed) & (speed > 0), 'velocity', 'above 0 and finite', f'{speed}'),
            (effort > 0, 'effort', 'above 0', f'{effort}'),
        ):  # fmt: skip
            if not good.all():
                msg = f'{name} of JointLimits must be {wanted}; received {found}'
                raise ValueError(msg)


Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """Figures to print or to write as json."""

    title: str
    columns: tuple[str, ...]  # names with units, such as 'gap (mm)'
    rows: tuple[tuple[Cell, ...], ...]  # None or NaN where nothing is known
    notes: tuple[str, ...] = ()  # sentences that stand below

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                msg = f'rows of {self.title!r} must have {len(self.columns)} cells; received {row}'
                raise ValueError(msg)

    def __str__(self) -> str:
        """Title, columns, numbers to the right, and notes, in lines."""
        texts = [[figure(cell) for cell in row] for row in self.rows]
        count = range(len(self.columns))
        widths = [max(len(row[i]) for row in (self.columns, *texts)) for i in count]
        numeric = [all(not isinstance(row[i], str) for row in self.rows) for i in count]
        lines = [self.title] * bool(self.title)
        for line in (self.columns, ['-' * width for width in widths], *texts):
            cells = zip(line, widths, numeric, strict=True)
            lines.append('  '.join(c.rjust(w) if n else c.ljust(w) for c, w, n in cells).rstrip())
        return '\n'.join([*lines, *(f'  {note}' for note in self.notes)])


def figure(value: Cell) -> str:
    """A cell as text: `-` where nothing is measured, three digits otherwise."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return '-'
    if isinstance(value, float):
        return f'{value:.3g}' if abs(value) < 1000 else f'{value:.0f}'
    return plain(str(value))


Held = TypeVar('Held', bound='Closing')


class Closing:
    """A context manager that opens and closes."""

    def open(self) -> None:
        """Begin, where there is something to begin."""

    def close(self) -> None:
        """Let go of everything."""
        raise NotImplementedError

    def __enter__(self: Held) -> Held:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Device(AbstractContextManager['Device'], Protocol):
    """A sensor that can be read, real or simulated; a context manager.

    Drivers inherit it for the steps that have a default.
    """

    layout: Layout  # places and channels of the taxels

    def read(self, timeout: float) -> Frame:
        """Wait at most `timeout` (s) for the next frame; DeviceTimeout when none came."""

    def waiting(self) -> list[Frame]:
        """Take the frames that came together with the last and were not read yet."""
        return []

    def counters(self) -> dict[str, int]:
        """Frames, losses and damage since the device was made, by name."""
        return {}


class Twin(AbstractContextManager['Twin'], Protocol):
    """A simulated sensor: what answers the bytes of a real one; a context manager."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults that it can suffer."""

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that a format without a checksum cannot always show to its driver."""

    @property
    def injected(self) -> Mapping[str, int]:
        """Count of each fault that has happened."""

    def inject(self, fault: str, count: int = 1) -> None:
        """Let the next `count` frames or transfers suffer a fault; ValueError if unknown."""

    def relieve(self) -> None:
        """Withdraw the faults that wait."""

    def device(self, clock_ns: Callable[[], int]) -> Device:
        """The real driver on this twin's bytes, stamped by `clock_ns`; not yet entered."""


class Estimator(Protocol):
    """A published method: fitted arrays in attributes that end in `_`."""

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Estimator:
        """Learn targets y (s, k) of features x (s, d) and return itself.

        Rows that are not finite are left out; order does not matter. Splits keep equal `groups`
        (s,) together. ValueError if shapes differ or no finite row is left.
        """

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features (s, d); NaN in rows that are not finite.

        NotCalibratedError before a fit, ValueError if the number of features differs.
        """
