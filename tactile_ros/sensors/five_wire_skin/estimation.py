"""Place and force of the five-wire skin from its three readings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.physics.resistive import spreading_resistance
from tactile_ros.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.regression import ESTIMATORS as REGRESSORS
from tactile_ros.regression import Regression
from tactile_ros.regression.head import FEWEST_ROWS, Head
from tactile_ros.sensors.five_wire_skin.force import CLASSES as FORCE_CLASSES
from tactile_ros.sensors.five_wire_skin.force import ForceHead, creep_shares
from tactile_ros.sensors.five_wire_skin.place import CLASSES as PLACE_CLASSES
from tactile_ros.sensors.five_wire_skin.place import PlaceHead
from tactile_ros.sensors.five_wire_skin.touch import Touch

if TYPE_CHECKING:
    from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig
    from tactile_ros.signals import Columns, Report, Signals
    from tactile_ros.types import Array, Bools, Integers

ESTIMATORS = (*REGRESSORS, 'printed')
TIME_CONSTANTS = (0.3, 1.0, 4.0, 16.0, 64.0)
SAME_PLACE = 1e-5
MOST_SINGLE = 0.9  # places per touch above which touches, not places, are what repeats
LEAST_DIVIDER = 1e-4
USEFUL = 0.9  # of the spread of shear; a regressor that leaves more knows nothing of it


class FiveWireEstimation:
    """Estimators of the five-wire skin.

    Parameters
    ----------
    config : FiveWireSkinConfig
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`: a regressor of the three readings, or 'printed', the formula and the
        network of [5]; None: the best of all on held-out places.
    """

    def __init__(self, config: FiveWireSkinConfig, estimator: str | None = None) -> None:
        self.size = np.asarray(config.size, np.float64)
        self.touch_size = config.touch_size
        self.sheet = config.sheet_resistance / config.reference_resistance
        noise = np.nan if config.noise is None else config.noise
        self.touch_ = Touch(float(np.broadcast_to(np.asarray(noise, np.float64), (3,))[2]))
        self.wanted = estimator
        self.others_: Regression | None = None
        if estimator in REGRESSORS:
            self.others_ = Regression(config, estimator, 3)
        self.place_: PlaceHead | None = PlaceHead(self.size) if estimator is None else None
        self.height_ = np.zeros(2)
        self.force_: ForceHead | None = None
        self.crept_: ForceHead | None = None
        self.shares_ = np.zeros(len(TIME_CONSTANTS) + 1)
        self.shear_: Head | None = None
        self.left_ = 0.0  # of a force, by creep that the fading means do not tell

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        if self.others_ is not None:
            return self.others_.estimators
        heads = {'position': self.place_, 'force': self.force_}
        return {target: head.name for target, head in heads.items() if head is not None}

    @property
    def report(self) -> Report:
        """Errors on held-out places for each target, and what contact was judged by."""
        if self.others_ is not None:
            return self.others_.report
        heads = {'position_xy': self.place_, 'force_z': self.force_, 'force_xy': self.shear_}
        heads['force_z_without_creep'] = self.crept_
        known = {title: head.report_ for title, head in heads.items() if head is not None}
        known = {title: table for title, table in known.items() if table}
        return {**known, **({'contact': self.touch_.report_} if self.touch_.report_ else {})}

    def start(self) -> History:
        """Fresh memory of a stream."""
        if self.others_ is not None:
            return self.others_.start()
        return History(np.array(TIME_CONSTANTS))

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn contact, place and force from what truth tells.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        truth : dict of str to ndarray, shape (s, ...)
            As in a Recording.
        groups : dict of str to ndarray, shape (s,)
            'group' and 'session': what a split keeps together.
        """
        x = self.touch_.fit(signals, truth).readings(signals)
        self.touch_.judge(signals, x)
        blank = np.full((len(x), 3), np.nan)
        position = np.asarray(truth.get('position', blank), np.float64)
        force = np.asarray(truth.get('force', blank), np.float64)
        signals = replace(signals, good=signals.good & (signals.in_contact != 0))
        if self.others_ is not None:
            self.others_.fit(_own(signals, x), truth, groups)
            return
        group = np.asarray(groups['group'], np.int64)
        there = np.isfinite(position[:, :2]).all(axis=1)
        kept = _places(position, np.asarray(there), group)
        rows = signals.good & there
        if rows.sum() >= FEWEST_ROWS:
            head = PlaceHead(self.size)
            wanted = 'printed' if self.wanted == 'printed' else None
            self.place_ = head.fit(x[rows], position[rows, :2], kept[rows], wanted)
            height = position[rows, 2]
            height = height[np.isfinite(height)]
            known = len(height) > 0
            self.height_ = np.array(
                [np.median(height), height.var() + 1e-12] if known else [np.nan, np.nan]
            )
        self._learn_force(signals, x, force, kept)
        self._learn_shear(signals, x, force, group, groups)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Place and force of every row.

        Parameters
        ----------
        signals : Signals
            Conditioned frames; `in_contact` is set by what the divider says.
        memory : History
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, 3) or (s, 3, 3)
            One entry and its covariance for each target.
        """
        assert isinstance(memory, History)
        x = self.touch_.readings(signals)
        self.touch_.judge(signals, x)
        if self.others_ is not None:
            return self.others_.estimate(_own(signals, x), memory)
        known: Columns = {}
        place = x[:, :2]
        if self.place_ is not None:
            place, covariance = self.place_.predict(x)
            known['position'] = _beside(place, self.height_[0])
            known['position_cov'] = np.full((len(x), 3, 3), np.nan)
            known['position_cov'][:, :2, :2] = covariance
            if self.height_[1] >= 0:
                known['position_cov'][:, 2] = known['position_cov'][:, :, 2] = 0.0
                known['position_cov'][:, 2, 2] = self.height_[1]
        if self.force_ is not None:
            value, spread = self._normal(signals, self._features(x, place), memory)
            known['force'] = np.full((len(x), 3), np.nan)
            known['force_cov'] = np.full((len(x), 3, 3), np.nan)
            untouched = signals.in_contact == 0
            known['force'][:, 2] = np.where(untouched, 0.0, value)
            known['force_cov'][:, 2, 2] = np.where(untouched, self.touch_.unfelt_, spread**2)
            if self.shear_ is not None:
                mean, cov = self.shear_.predict(x.copy(), np.zeros_like(x))
                known['force'][:, :2], known['force_cov'][:, :2, :2] = mean, cov
        return known

    def _normal(self, signals: Signals, features: Array, memory: History) -> tuple[Array, Array]:
        """Normal forces (s,) and their spreads (N), without creep where stamps tell the past."""
        assert self.force_ is not None
        if self.crept_ is None or signals.stamp_ns is None:
            return self.force_.predict(features)
        static, spread = self.crept_.predict(features)
        static = np.where(signals.in_contact == 0, 0.0, static)
        static = np.where(signals.good, static, np.nan)
        means = _remember(static, signals, memory)
        value = static - np.column_stack([means, static]) @ self.shares_
        return value, np.sqrt(spread**2 + (self.left_ * value) ** 2)

    def _features(self, x: Array, place: Array) -> Array:
        """Features (s, 8) of `ForceHead`."""
        divider = np.minimum(np.maximum(x[:, 2], LEAST_DIVIDER), 1 - LEAST_DIVIDER)
        features = np.empty((len(x), 8))
        features[:, :2] = place / self.size
        features[:, 2] = 1.0 / divider - 1.0
        features[:, 3] = spreading_resistance(place, self.size, self.touch_size, self.sheet)
        features[:, 4:7] = x
        features[:, 7] = np.log(features[:, 2])
        return features

    def _learn_force(self, signals: Signals, x: Array, force: Array, kept: Integers) -> None:
        """Static curve, and where stamps tell the past one without creep."""
        rows = signals.good & np.isfinite(force[:, 2])
        self.force_ = self.crept_ = None
        if rows.sum() < FEWEST_ROWS:
            return
        place = x[:, :2] if self.place_ is None else self.place_.predict(x)[0]
        features, told = self._features(x, place), force[:, 2]
        noise = 0.0 if np.isnan(self.touch_.noise) else self.touch_.noise
        wanted = self.wanted
        self.force_ = ForceHead(noise, self.size).fit(
            features[rows], told[rows], kept[rows], wanted
        )
        if signals.stamp_ns is None or wanted is not None:
            return
        static = self._static(self.force_, features, signals)
        means = _remember(static, signals, self.start())
        shares = creep_shares(static[rows], means[rows], told[rows], kept[rows])
        if not shares.any():
            return
        # once more: a static curve of what the film would say without its past
        self.shares_ = shares
        terms = np.column_stack([means, static])
        past = np.clip(terms @ shares, -0.5 * static, 0.5 * static)
        target = (told + past)[rows]
        head = ForceHead(noise, self.size).fit(
            features[rows], target, kept[rows], self.force_.name
        )
        static = self._static(head, features, signals)
        means = _remember(static, signals, self.start())
        shares = creep_shares(static[rows], means[rows], told[rows], kept[rows])
        left = static[rows] - np.column_stack([means, static])[rows] @ shares - told[rows]
        if float(np.sqrt((left**2).mean())) < self.force_.report_['held_out_rmse']:
            self.crept_, self.shares_ = head, shares
            least = 0.1 * float(told[rows].max())
            self.left_ = float(np.sqrt(((left / np.maximum(told[rows], least)) ** 2).mean()))

    @staticmethod
    def _static(head: ForceHead, features: Array, signals: Signals) -> Array:
        """Forces (s,) of a static curve, 0 where nothing touches, NaN where unusable."""
        touching = signals.in_contact != 0
        static = np.zeros(len(features))
        static[touching] = head.predict(features[touching])[0]
        return np.where(signals.good | ~touching, static, np.nan)

    def _learn_shear(
        self, signals: Signals, x: Array, force: Array, group: Integers, groups: Columns
    ) -> None:
        """Shear, which the skin does not feel: only where truth tells it and place tells it."""
        rows = signals.good & np.isfinite(force).all(axis=1)
        self.shear_ = None
        if self.force_ is None or rows.sum() < FEWEST_ROWS:
            return
        told = force[rows, :2]
        spread = float(np.sqrt(told.var(axis=0).sum()))
        if spread == 0.0:
            return
        session = np.asarray(groups['session'], np.int64)[rows]
        head = Head('force', (0, 1), 'ridge', 3)
        head.fit(x[rows], told, group[rows], session, np.zeros((len(told), 3)))
        self.shear_ = head if head.report_['held_out_rmse'] < USEFUL * spread else None


def _own(signals: Signals, x: Array) -> Signals:
    """Frames of which only the divider has a baseline."""
    wide = np.repeat(x[:, None], signals.values.shape[1], axis=1)
    return replace(signals, delta=wide, baseline=np.zeros_like(signals.values))


def _beside(place: Array, height: float) -> Array:
    """Places in the plane with a height."""
    whole = np.empty((len(place), 3))
    whole[:, :2], whole[:, 2] = place, height
    return whole


def _remember(static: Array, signals: Signals, memory: History) -> Array:
    """Fading means (s, m) of a static force."""
    assert signals.stamp_ns is not None
    if len(static) == 1:
        if signals.restart[0]:
            memory.reset()
        return memory.step(static, int(signals.stamp_ns[0])).T.copy()
    return np.asarray(memory(static[:, None], signals.stamp_ns, signals.restart)[:, :, 0])


def _places(position: Array, there: Bools, group: Integers) -> Integers:
    """Number of the place of each row, where they repeat; else its group."""
    plane = np.round(np.nan_to_num(position[:, :2]) / SAME_PLACE)
    _, place = np.unique(plane, axis=0, return_inverse=True)
    place = np.asarray(place, np.int64).reshape(-1)
    count = len(np.unique(place[there]))
    return place if 1 < count <= MOST_SINGLE * there.sum() else group


CLASSES = tuple(
    {
        one.__name__: one
        for one in (FiveWireEstimation, Touch, *REGRESSION_CLASSES, *PLACE_CLASSES, *FORCE_CLASSES)
    }.values()
)
