"""What the targets of the gradiometer are estimated from: differences, temperatures, the disc."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.disc_inversion import DiscInversion
from tactile_ros.estimators.polynomial_rows import times
from tactile_ros.estimators.uniform_field import UniformField
from tactile_ros.sensors.gradiometer.fidelity import LEAST_NOISE, field_model, terms
from tactile_ros.sensors.gradiometer.memory import StreamMemory
from tactile_ros.sensors.gradiometer.readings import Readings
from tactile_ros.sensors.gradiometer.thermal import UNIT, chip_temperature, lagging
from tactile_ros.sensors.gradiometer.warm_fit import WarmFit

if TYPE_CHECKING:
    from tactile_ros.physics.fidelity import Choice
    from tactile_ros.physics.scene_terms import Worth
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Bools, Integers, Signals

TILT = 0.03  # rad, beside the tilt that comes with a shift
FEWEST_ROWS = 20
FEWEST_DIFFERENCES = 5
STATES = 30  # of the scene, over which terms are weighed


class Features:
    """Features of one gradiometer, side by side.

    Parameters
    ----------
    config : GradiometerConfig
        Geometry and materials.
    remembers : bool
        What was a while ago is a feature of frames without stamps too, where it is as now.

    Attributes
    ----------
    readings_ : Readings
        Changes of field.
    uniform_ : UniformField
        What a uniform field does to the channels.
    place_, tilted_ : DiscInversion or None
        The disc's model without and with tilts of its own.
    choice_ : Choice
        Model of the disc's field that the noise needs.
    terms_ : tuple of Worth
        What terms of the scene cost and buy; none before a fit.
    lag_ : float
        Time constant with which the disc follows the chip's temperature (s).
    tilts_, remembers_ : bool
        Whether tilts, and what was a while ago, are features.
    silent_ : int
        Rows of the fit whose chips told their temperature too long ago to learn from.
    """

    choice_: Choice
    silent_: int = 0

    def __init__(self, config: GradiometerConfig, remembers: bool = False) -> None:
        self.config = config
        self.remembers = remembers
        self.readings_ = Readings(config)
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        self.place_: DiscInversion | None = None
        self.tilted_: DiscInversion | None = None
        self.lag_ = config.thermal_lag
        self.tilts_ = self.remembers_ = False
        self.terms_: tuple[Worth, ...] = ()

    @property
    def report(self) -> dict[str, dict[str, float]]:
        """The model of the disc's field, and what terms of the scene cost and buy."""
        told = [self.choice_.report, *(term.report for term in self.terms_)] if self.terms_ else []
        return {name: figures for part in told for name, figures in part.items()}

    def start(self) -> StreamMemory:
        """Fresh memory of a stream."""
        return StreamMemory(self.lag_, self.readings_.wander_, lag_is_told=self.lag_is_told)

    @property
    def lag_is_told(self) -> bool:
        """Whether config or streams of the fit tell how the disc lags, or it matters nowhere."""
        readings = self.readings_
        return not readings.warm_ or self.config.thermal_lag > 0 or len(readings.lags_) > 0

    def fit(
        self, signals: Signals, stray: Array, rest: Bools, touched: Bools, force: Array
    ) -> Array:
        """Learn from frames of which some rest and some are touched; changes (s, n) (T).

        Force (s, 3) (N) is NaN where nothing told it.
        """
        resting = signals.good & (signals.in_contact == 0)
        self.readings_ = Readings(self.config).fit(signals, resting)
        self.readings_.warm_ &= self.config.thermal_term
        self.choice_ = field_model(self.config, self.readings_.noise)
        self.terms_ = terms(self.config, max(self.readings_.noise, LEAST_NOISE), STATES)
        if self.readings_.warm_:
            nothing = np.zeros((2, len(self.readings_.axes)))
            self.readings_.learn_warm_rest(
                signals, resting, np.zeros(len(resting)), nothing[0], nothing
            )
        change = self.readings_.change(signals)
        self._learn_uniform(signals, stray, rest & signals.good)
        self.place_ = self.tilted_ = None
        self.lag_ = self.config.thermal_lag
        rows = np.flatnonzero(touched & signals.good & np.isfinite(change).all(axis=1))
        if len(rows) >= FEWEST_ROWS and self.projection.shape[1] >= FEWEST_DIFFERENCES:
            rows = rows[np.lexsort(change[rows].T[::-1])]
            warm_fit = WarmFit(
                signals, self.readings_, lambda: self._disc(0.0),
                lambda lag: self.thermal(signals, StreamMemory(lag))[:, :1].sum(axis=1),
                resting, rows, force,
            )  # fmt: skip
            self.place_ = warm_fit.fit(self.lag_)
            self.lag_, change = warm_fit.lag, warm_fit.change
            warm = self.thermal(signals, self.start())[rows, :1].sum(axis=1)
            self.tilted_ = self._disc(TILT).fit(change[rows], warm)
        self.tilts_ = self.place_ is not None
        self.remembers_ = self.remembers or signals.stamp_ns is not None
        return change

    def _learn_uniform(self, signals: Signals, stray: Array, rows: Bools) -> None:
        """Learn how channels respond to a uniform field, beside what warmth does to them."""
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        vars(self).pop('projection', None)
        change = self.readings_.change(_since_tare(signals))
        known = rows & np.isfinite(stray).any(axis=1) & np.isfinite(change).all(axis=1)
        if known.sum() < 3 or np.nanmax(np.abs(stray[known])) == 0:
            return
        told = np.column_stack([change, np.nan_to_num(stray)])[known]
        if self.readings_.warm_:
            lags = (0.0, *self.readings_.lags_)
            warm = [self.thermal(signals, StreamMemory(lag))[known, 0] for lag in lags]
            basis, _ = np.linalg.qr(np.column_stack([np.ones(len(told)), *warm]))
            told = told - basis @ (basis.T @ told)
        self.uniform_.fit(told[:, :-3], told[:, -3:])

    def _disc(self, tilt: float) -> DiscInversion:
        config, noise = self.config, self.readings_.noise
        disc = np.array([config.gap, config.disc_diameter, config.disc_height, config.remanence])
        rows, columns = self.choice_.size
        model = DiscInversion(
            config.positions, self.uniform_.response_, disc, tilt, (rows, columns)
        )
        return model.given(self.projection, noise, absolute=self.readings_.absolute_)

    @cached_property
    def projection(self) -> Array:
        """What a uniform field does not change; all channels, where nothing would be left."""
        differences = self.uniform_.differences
        used = (self.readings_.axes != 0).any(axis=1)
        whole = np.ascontiguousarray(np.eye(len(used))[:, used])
        return differences if differences.shape[1] >= 3 and self.config.stray_term else whole

    def thermal(self, signals: Signals, memory: StreamMemory) -> Array:
        """What `lagging` tells (s, 3); no column where temperatures of the fit were all alike."""
        rows = len(signals.good)
        if not self.readings_.warm_:
            return np.zeros((rows, 0))
        chip = chip_temperature(signals)
        chip = np.full(rows, np.nan) if chip is None else chip
        unsure = self.readings_.unsure_chips(signals)
        unsure = None if unsure is None else unsure.mean(axis=1)
        told = lagging(signals, chip, self.readings_.usual_, memory.thermal, unsure)
        behind: float | Array
        if signals.stamp_ns is None and len(self.readings_.lags_):
            behind = memory.thermal.usually_behind
        elif signals.stamp_ns is not None and memory.slower is not None:
            slower = lagging(signals, chip, self.readings_.usual_, memory.slower, unsure)
            behind = UNIT * (told[:, 0] - slower[:, 0])
        else:
            return told
        told[:, 2] = np.hypot(told[:, 2], behind)
        return told

    def table(
        self, change: Array, thermal: Array, signals: Signals | None, memory: StreamMemory
    ) -> tuple[Array, dict[str, Integers]]:
        """Features (s, f) of changes and temperatures, and which columns are whose.

        Without signals there is no past: it is as now.
        """
        known = {
            'field': change + self.readings_.level_,
            'differences': times(change, self.projection),
        }
        warm = thermal[:, 0] if thermal.shape[1] else None
        if self.place_ is not None:
            known['place'], known['rest'], left = self.place_.explain(change, warm)
            known['uniform'] = self.uniform_.solve(left)[:, self.uniform_.seen]
        known['thermal'], known['doubt'] = thermal[:, :1], thermal[:, 1:2]
        if self.tilts_ and self.tilted_ is not None:
            known['tilted'] = self.tilted_.invert(change, warm)[0]
        elif self.remembers_ and self.tilted_ is not None:
            known['tilted'] = np.zeros((len(change), self.tilted_.unknowns))
        if self.remembers_:
            now = known.get('place', known['differences'])
            known['history'] = np.tile(now, 2) if signals is None else memory.past(signals, now)
        names = tuple((name, part.shape[1]) for name, part in known.items())
        return np.concatenate(list(known.values()), axis=1), _columns(names)

    def use(self, estimators: set[str]) -> None:
        """Leave out what these estimators do not see."""
        self.tilts_ = self.tilts_ and 'inversion_tilt' in estimators
        self.remembers_ = self.remembers_ and 'history' in estimators


def _since_tare(signals: Signals) -> Signals:
    """The same frames over the baselines that their streams began with.

    A baseline that follows drift at rest follows outside fields too.
    """
    start = np.maximum.accumulate(np.where(signals.restart, np.arange(len(signals.good)), 0))
    base = signals.baseline[start]
    return replace(signals, delta=signals.delta + (signals.baseline - base), baseline=base)


@lru_cache(maxsize=16)
def _columns(names: tuple[tuple[str, int], ...]) -> dict[str, Integers]:
    """Columns of parts of these names and widths, side by side; 'where': place, temperatures."""
    ends = np.cumsum([0, *(width for _, width in names)])
    parts = {name: np.arange(ends[i], ends[i + 1]) for i, (name, _) in enumerate(names)}
    spot = parts.get('place', parts['differences'][:3])
    parts['where'] = np.concatenate([spot, parts['thermal']])
    return parts
