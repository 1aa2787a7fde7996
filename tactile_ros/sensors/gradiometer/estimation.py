"""Force, torque and stray field of the gradiometer: a disc's model where it helps.

What a uniform field cannot change, six differences of four pixels, is turned into the disc's
place by the model and into force and torque by polynomials; the printed chain of [3] and plain
regressors compete on held-out groups. What is left over tells of fields that are not uniform.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.regression.head import known_columns
from tactile_ros.sensors.gradiometer.features import Features
from tactile_ros.sensors.gradiometer.memory import StreamMemory
from tactile_ros.sensors.gradiometer.readings import margins
from tactile_ros.sensors.gradiometer.stray import StrayField, gradient_patterns
from tactile_ros.sensors.gradiometer.target import MODELS, Target, candidates
from tactile_ros.sensors.gradiometer.thermal import beyond
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.signals import Columns, Report, Signals
    from tactile_ros.types import Array, Bools, Integers

TARGETS = ('position', 'force', 'torque')
RESPONSES = 400
STEEP, DISTURBED = 0.02, 2e-5  # T / m, T: a small gradient, a small field in one difference
OUTSIDE = 0.01  # of a component's spread, for a degree beyond the temperatures of the fit


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
        self.features_ = Features(config)
        self.stray_: StrayField | None = None
        self.response_: PolynomialRidge | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return {target.name: target.estimator_name for target in self.targets_}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and what was found of the disc."""
        found = {target.title: target.report_ for target in self.targets_}
        if self.targets_ and self.features_.place_ is not None:
            found['disc'] = self.features_.place_.report
            found['disc']['thermal_lag'] = self.features_.lag_
        if self.targets_ and self.stray_ is not None:
            found['stray_field'] = self.stray_.report_
        untold = {'force', 'torque'} - {target.name for target in self.targets_}
        if self.features_.readings_.fitted_ and untold:
            names = ' and '.join(sorted(untold))
            found['untold'] = {f'{names}: no truth told it, and the config has no stiffness': 0.0}
        return {**found, **self.features_.report}

    def start(self) -> StreamMemory:
        """Fresh memory of a stream."""
        return self.features_.start()

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
        rest = _at_rest(signals, truth)
        stray = np.asarray(truth.get('stray_field', np.full((len(rest), 3), np.nan)), float)
        remembers = self.estimator == 'history'
        features = self.features_ = Features(self.config, remembers)
        modelled = self.estimator in (None, 'history', *MODELS)
        change = features.fit(signals, stray, rest, ~rest & modelled)
        self.targets_, self.stray_, self.response_ = (), None, None
        if 'force' in truth and signals.stamp_ns is not None:
            force = np.asarray(truth['force'], float)[:, 2:]
            features.refine_lag(signals, change, force, signals.good & ~rest)
        thermal = features.thermal(signals, self.start())
        x, parts = features.table(change, thermal, signals, self.start())
        # untouched rows are 0 in use whatever is learned; they would make light of the errors
        self._learn_targets(x, parts, signals.good & ~rest, truth, groups)
        features.use({*self.estimators.values()})
        if features.place_ is not None and self.targets_:
            use = signals.good & ~rest & np.isfinite(x[:, parts['place']]).all(axis=1)
            self._learn_response(change[use], thermal[use])
            where = x[use][:, parts['where']]
            group = np.asarray(groups['group'], np.int64)[use]
            self.stray_ = StrayField(thermal.shape[1]).fit(
                where,
                x[use][:, parts['rest']],
                x[use][:, parts['uniform']],
                stray[use][:, features.uniform_.seen],
                group,
            )

    def _learn_response(self, change: Array, thermal: Array) -> None:
        """Learn how targets answer to fields that are not the disc's, from the disc's place."""
        rows = np.linspace(0, len(change) - 1, min(len(change), RESPONSES)).astype(int)
        change, thermal = change[rows], thermal[rows]
        table, memory = self.features_.table, self.start()
        x, parts = table(change, thermal, None, memory)
        kinds = gradient_patterns(self.config.positions, self.features_.uniform_.response_)
        moved, leaked = (
            [table(change + step, thermal, None, memory)[0] for step in steps]
            for steps in (STEEP * kinds, DISTURBED * self.features_.projection.T)
        )
        sizes = [target.response(x, moved, STEEP) for target in self.targets_]
        shown = sum(((other - x)[:, parts['rest']] ** 2).sum(axis=1) for other in moved)
        sizes.append(0.5 * np.log(np.asarray(shown)[:, None] / STEEP**2))
        sizes += [target.response(x, leaked, DISTURBED) for target in self.targets_]
        place = x[:, parts['place']]
        self.response_ = PolynomialRidge((1, 2)).fit(place, np.concatenate(sizes, axis=1))

    def _learn_targets(
        self, x: Array, parts: dict[str, Integers], good: Bools, truth: Columns, groups: Columns
    ) -> None:
        targets: list[Target] = []
        wanted = self.estimator
        if (wanted in MODELS and 'place' not in parts) or (
            wanted == 'history' and wanted not in parts
        ):
            wanted = 'differences'  # too few pixels for a model, or no time
        drivers = parts['where']
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
        assert isinstance(memory, StreamMemory)
        features, config = self.features_, self.config
        change = features.readings_.change(signals)
        x, parts = features.table(change, features.thermal(signals, memory), signals, memory)
        status = margins(signals, config, features.readings_.noise) * _SATURATED
        known: Columns = {}
        wider = np.zeros((len(x), sum(len(target.columns) for target in self.targets_)))
        if self.stray_ is None:
            known['stray_field'] = features.uniform_.solve(change)
        else:
            odd, wider = self._add_stray(known, x, parts, wider)
            status |= odd * _STRAY
        outside = beyond(signals, features.readings_.span_)
        if np.count_nonzero(outside):
            status |= (outside > 0) * _OUTSIDE
            wider = np.hypot(wider, OUTSIDE * outside[:, None])
        if self.targets_:
            self._add_targets(known, x, wider)
        known['status'] = status
        return known

    def _add_stray(
        self, known: Columns, x: Array, parts: dict[str, Integers], wider: Array
    ) -> tuple[Bools, Array]:
        """The stray field (s, 3); where it is certainly a magnet's, and what it spoils (s, k)."""
        assert self.stray_ is not None
        rest, uniform, axes = x[:, parts['rest']], x[:, parts['uniform']], self.features_.uniform_
        field, shown, size, odd = self.stray_.predict(x[:, parts['where']], uniform, rest)
        known['stray_field'] = np.full((len(x), 3), np.nan)
        known['stray_field'][:, axes.seen] = field
        if self.response_ is not None and np.count_nonzero(shown):
            count = wider.shape[1]
            answer = np.exp(self.response_.predict(x[:, parts['place']]))
            wider = answer[:, :count] * (shown / answer[:, count])[:, None]
            leak = (axes.uncertainty * size)[:, None]
            wider = np.hypot(wider, answer[:, count + 1 :] * leak)
        return odd, wider

    def _add_targets(self, known: Columns, x: Array, wider: Array) -> None:
        """Components of all targets (s, 3) and their covariances, NaN where never told."""
        first, drivers = 0, self.targets_[0].drive(x)
        for target in self.targets_:
            if target.name not in known:
                known[target.name] = np.full((len(x), 3), np.nan)
                known[f'{target.name}_cov'] = np.full((len(x), 3, 3), np.nan)
            end = first + len(target.columns)
            mean, cov = target.predict(x, drivers, wider[:, first:end])
            index, first = np.array(target.columns), end
            known[target.name][:, index] = mean
            known[f'{target.name}_cov'][:, index[:, None], index] = cov


_SATURATED, _STRAY = np.int64(FrameStatus.SATURATED), np.int64(FrameStatus.STRAY_FIELD)
_OUTSIDE = np.int64(FrameStatus.OUT_OF_RANGE)


def _at_rest(signals: Signals, truth: Columns) -> Bools:
    """Rows (s,) that truth, or the readings, call untouched."""
    force = np.asarray(truth.get('force', np.full((len(signals.good), 3), np.nan)), float)
    free = np.nan_to_num(np.abs(force), nan=0.0).max(axis=1) == 0
    if 'in_contact' in truth:
        return np.asarray(np.asarray(truth['in_contact']) == 0)
    return np.asarray(free | (signals.in_contact == 0))
