"""Force, torque and stray field of the gradiometer: a disc's model where it helps.

What a uniform field cannot change, six differences of four pixels, is turned into the disc's
place by the model and into force and torque by polynomials; the printed chain of [3] and plain
regressors compete on held-out groups. What is left over tells of fields that are not uniform.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.disc_inversion import DiscInversion
from tactile_ros.estimators.uniform_field import UniformField
from tactile_ros.regression.head import known_columns
from tactile_ros.sensors.gradiometer.readings import Readings, margins
from tactile_ros.sensors.gradiometer.stray import StrayField
from tactile_ros.sensors.gradiometer.target import MODELS, Target, candidates
from tactile_ros.sensors.gradiometer.thermal import ThermalMemory, chip_temperature, lagging
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.signals import Columns, Report, Signals
    from tactile_ros.types import Array, Bools, Integers

TARGETS = ('position', 'force', 'torque')
TILT = 0.03  # rad, beside the tilt that comes with a shift
FEWEST_ROWS = 20
RESPONSES = 400
DISTURBED = 2e-5  # T


class GradiometerEstimation:
    """Estimators of one gradiometer.

    Parameters
    ----------
    config : GradiometerConfig
        Geometry and materials: where a fit starts.
    estimator : str or None
        One of `ESTIMATORS`; None: the best of them on held-out groups.
    """

    def __init__(self, config: GradiometerConfig, estimator: str | None = None) -> None:
        self.config = config
        self.estimator = estimator
        self.targets_: tuple[Target, ...] = ()
        self.readings_ = Readings(config)
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        self.place_: DiscInversion | None = None
        self.tilted_: DiscInversion | None = None
        self.stray_: StrayField | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return {target.name: target.estimator_name for target in self.targets_}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and what was found of the disc."""
        found = {target.title: target.report_ for target in self.targets_}
        if self.targets_ and self.place_ is not None:
            found['disc'] = self.place_.report
        if self.targets_ and self.stray_ is not None:
            found['stray_field'] = self.stray_.report_
        return found

    def start(self) -> ThermalMemory:
        """Fresh memory of a stream."""
        return ThermalMemory(self.readings_.lags_)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        truth : dict of str to ndarray, shape (s, ...)
            As in a Recording; `stray_field` at rest gives gains and crossed axes.
        groups : dict of str to ndarray, shape (s,)
            'group' and 'session'.
        """
        resting = signals.good & (signals.in_contact == 0)
        self.readings_ = Readings(self.config).fit(signals, resting)
        change = self.readings_.change(signals)
        stray = np.asarray(truth.get('stray_field', np.full((len(change), 3), np.nan)), float)
        self._learn_uniform(change, stray, signals.good & _at_rest(signals, truth))
        touched = signals.good & ~_at_rest(signals, truth) & np.isfinite(change).all(axis=1)
        self.targets_, self.place_, self.tilted_, self.stray_ = (), None, None, None
        if self.estimator in (None, *MODELS) and touched.sum() >= FEWEST_ROWS:
            self._learn_disc(change[touched])
        x, parts = self._features(change, self._thermal(signals, self.start()))
        self._learn_targets(x, parts, signals.good, truth, groups)
        if self.place_ is not None and self.targets_:
            use = touched & np.isfinite(x).all(axis=1)
            group = np.asarray(groups['group'], np.int64)[use]
            self._learn_response(change[use], x[use][:, parts['thermal']])
            uniform = self._beside_disc(change[use], x[use][:, parts['place']])
            plane = self.config.positions[:, :2]
            span = float(np.sqrt(((plane - plane.mean(axis=0)) ** 2).sum() / 2))
            self.stray_ = StrayField(self.readings_.noise, span).fit(
                x[use][:, parts['place']], x[use][:, parts['rest']], uniform, stray[use], group
            )

    def _learn_response(self, change: Array, thermal: Array) -> None:
        """Learn how targets answer to fields that are not the disc's."""
        rows = np.linspace(0, len(change) - 1, min(len(change), RESPONSES)).astype(int)
        change, thermal = change[rows], thermal[rows]
        x, parts = self._features(change, thermal)
        moved = [self._features(change + DISTURBED * d, thermal)[0] for d in self._projection().T]
        for target in self.targets_:
            target.learn_response(x, moved, parts['place'], DISTURBED)

    def _beside_disc(self, change: Array, place: Array) -> Array:
        """Uniform field (s, 3) (T) of changes (s, n) (T) less those that places (s, 3) make."""
        if self.place_ is None:
            return self.uniform_.solve(change)
        whole = np.isfinite(place)
        return self.uniform_.solve(change - self.place_.field(np.where(whole, place, 0.0))[0])

    def _learn_uniform(self, change: Array, stray: Array, rows: Bools) -> None:
        """Learn how channels respond to a uniform field."""
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        known = rows & np.isfinite(stray).any(axis=1) & np.isfinite(change).all(axis=1)
        if known.sum() >= 3 and np.nanmax(np.abs(stray[known])) > 0:
            self.uniform_.fit(change[known], np.nan_to_num(stray[known]))

    def _learn_disc(self, change: Array) -> None:
        """Learn what the config is uncertain of."""
        differences = self._projection()
        if differences.shape[1] < 5:
            return
        config = self.config
        disc = np.array([config.gap, config.disc_diameter, config.disc_height, config.remanence])
        order = np.lexsort(change.T[::-1])
        models = [
            DiscInversion(config.positions, self.uniform_.response_, disc, tilt)
            .given(differences, self.readings_.noise, absolute=self.readings_.absolute_)
            .fit(change[order])
            for tilt in (0.0, TILT)
        ]
        self.place_, self.tilted_ = models

    def _projection(self) -> Array:
        """What a uniform field does not change; all channels, where nothing would be left."""
        differences = self.uniform_.differences
        used = (self.readings_.axes != 0).any(axis=1)
        return differences if differences.shape[1] >= 3 else np.eye(len(used))[:, used]

    def _thermal(self, signals: Signals, memory: ThermalMemory) -> Array:
        """Temperatures (s, h); no column where those of the fit were all alike."""
        rows = len(signals.good)
        if not self.readings_.warm_:
            return np.zeros((rows, 0))
        chip = chip_temperature(signals)
        chip = np.full(rows, np.nan) if chip is None else chip
        return lagging(signals, chip, self.readings_.usual_, memory)

    def _features(self, change: Array, thermal: Array) -> tuple[Array, dict[str, Integers]]:
        """Features of all candidates, side by side, and which columns are whose."""
        known = {
            'field': change + self.readings_.level_,
            'differences': change @ self._projection(),
            'thermal': thermal,
        }
        if self.place_ is not None and self.tilted_ is not None:
            known['place'], known['rest'] = self.place_.invert(change)
            # a fit that chose otherwise spares its frames the tilts
            if not self.targets_ or 'inversion_tilt' in self.estimators.values():
                known['tilted'] = self.tilted_.invert(change)[0]
            else:
                known['tilted'] = np.zeros((len(change), 5))
        ends = np.cumsum([0, *(part.shape[1] for part in known.values())])
        parts = {name: np.arange(ends[i], ends[i + 1]) for i, name in enumerate(known)}
        return np.concatenate(list(known.values()), axis=1), parts

    def _learn_targets(
        self, x: Array, parts: dict[str, Integers], good: Bools, truth: Columns, groups: Columns
    ) -> None:
        targets: list[Target] = []
        wanted = self.estimator
        if wanted in MODELS and 'place' not in parts:
            wanted = 'differences'  # too few pixels for a model
        drivers = np.concatenate([parts.get('place', parts['differences'][:3]), parts['thermal']])
        good = good & np.isfinite(x).all(axis=1)
        for name in TARGETS:
            y = np.asarray(truth.get(name, np.full((len(x), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, good):
                group = np.asarray(groups['group'], np.int64)[rows]
                target = Target(name, columns, drivers, parts['differences'])
                known = candidates(parts, wanted)
                targets.append(target.fit(x[rows], y[rows][:, columns], group, known))
        self.targets_ = tuple(targets)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets, covariances, stray field and flags of every row.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        memory : ThermalMemory
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, ...)
            NaN for components that were never told.
        """
        assert isinstance(memory, ThermalMemory)
        change = self.readings_.change(signals)
        status = np.where(margins(signals, self.config, self.readings_.noise), _SATURATED, 0)
        known: Columns = {'stray_field': self.uniform_.solve(change)}
        excess = np.zeros(len(change))
        x, parts = self._features(change, self._thermal(signals, memory))
        if self.stray_ is not None:
            place = x[:, parts['place']]
            field = self.stray_.predict(place, self._beside_disc(change, place))
            known['stray_field'] = field
            excess, odd = self.stray_.oddness(place, x[:, parts['rest']], field)
            status = status | np.where(odd, _STRAY, 0)
        for target in self.targets_:
            if target.name not in known:
                known[target.name] = np.full((len(x), 3), np.nan)
                known[f'{target.name}_cov'] = np.full((len(x), 3, 3), np.nan)
            mean, cov = target.predict(x, excess)
            index = np.array(target.columns)
            known[target.name][:, index] = mean
            known[f'{target.name}_cov'][:, index[:, None], index] = cov
        known['status'] = status
        return known


_SATURATED, _STRAY = np.int64(FrameStatus.SATURATED), np.int64(FrameStatus.STRAY_FIELD)


def _at_rest(signals: Signals, truth: Columns) -> Bools:
    """Rows (s,) that truth, or the readings, call untouched."""
    force = np.asarray(truth.get('force', np.full((len(signals.good), 3), np.nan)), float)
    free = np.nan_to_num(np.abs(force), nan=0.0).max(axis=1) == 0
    if 'in_contact' in truth:
        return np.asarray(np.asarray(truth['in_contact']) == 0)
    return np.asarray(free | (signals.in_contact == 0))
