"""Place and force of the five-wire skin from its three readings."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.physics.resistive_sheet import SeriesResistance
from tactile_ros.sensors.five_wire_skin.contact_gate import (
    DIVIDER,
    ContactGate,
    implausible_taxels,
)
from tactile_ros.sensors.five_wire_skin.force import CLASSES as FORCE_CLASSES
from tactile_ros.sensors.five_wire_skin.force import (
    Creep,
    FilmCreep,
    ForceHead,
    features_of,
    tells_forces,
)
from tactile_ros.sensors.five_wire_skin.place import CLASSES as PLACE_CLASSES
from tactile_ros.sensors.five_wire_skin.place import PlaceHead, tells_places
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSORS
from tactile_ros.sensors.regression import (
    FEWEST_ROWS,
    KIND,
    Head,
    Regression,
    missing_history,
    missing_loads,
)
from tactile_ros.types import Estimation

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.conditioning.fading_memory import FadingMemory
    from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig
    from tactile_ros.types import Array, Bools, Columns, Estimator, Integers, Report, Signals

FOR_PLACE, FOR_FORCE = 25, 49  # places that a map and a film need
CELL = 0.05  # of the sheet: touches as near to each other are of one place
FAR, GAP, NODES = 0.2, 0.02, 41  # of the sheet to the next touch; share of it; places asked


def untold(size: Array, signals: Signals, truth: Columns, crept: float) -> Report:
    """What frames with their truth leave open.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    signals : Signals
        Conditioned frames (s) with the divider's contact.
    truth : dict of str to ndarray, shape (s, ...)
        As in a Recording.
    crept : float
        Share of a load that the film's past was found to hold; 0: none.

    Returns
    -------
    dict of str to dict
        Names that begin with `KIND`, each with its figures.
    """
    blank = np.full((len(signals.good), 3), np.nan)
    force = np.asarray(truth.get('force', blank), np.float64)[:, 2]
    places = np.asarray(truth.get('position', blank), np.float64)[signals.good, :2] / size
    places = places[np.isfinite(places).all(axis=1)]
    found = {**missing_loads(force[signals.good]), **missing_history(signals, crept)}
    if (signals.in_contact != 0).all():
        found[f'{KIND}contact (no untouched rows)'] = {}
    if not len(places):
        return {**found, f'{KIND}place (no truth): the formula of [5] serves': {}}
    return {**found, **_between(places)}


def _between(places: Array) -> Report:
    """What touches at places (n, 2), in parts of the sheet, leave open between them."""
    found: Report = {}
    count = len(np.unique(np.round(places / CELL), axis=0))
    for what, wanted in (('place', FOR_PLACE), ('force', FOR_FORCE)):
        if count < wanted:
            figures = {'places': float(count), 'wanted': float(wanted)}
            found[f'{KIND}{what} between so few places'] = figures
    line = np.linspace(0.0, 1.0, NODES)
    asked = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    share = float((cKDTree(places).query(asked)[0] > FAR).mean())
    if share > GAP:
        found[f'{KIND}places far from all touches'] = {'share of the sheet': share}
    return found


ESTIMATORS = (*REGRESSORS, 'printed', 'mean_curve')
SAME_PLACE = 1e-5
MOST_SINGLE = 0.3  # places per touch above which touches, not places, are what repeats
LEAST_DIVIDER = 1e-4
ONE_SIGMA = 0.6827
LEAST_SCATTER = 0.1
ROUNDS = 5  # in which a static curve and its past settle
USEFUL = 0.9  # of the spread of shear; a regressor that leaves more knows nothing of it


class FiveWireEstimation(Estimation):
    """Estimators of the five-wire skin.

    Parameters
    ----------
    config : FiveWireSkinConfig
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`: a regressor of the three readings; 'printed', the formula and the
        network of [5]; 'mean_curve', what [5] compares them with; None: the best on held-out
        places.
    """

    def __init__(self, config: FiveWireSkinConfig, estimator: str | None = None) -> None:
        self.size = np.asarray(config.size, np.float64)
        sheet = config.sheet_resistance / config.reference_resistance
        self.touch_edge = float(config.touch_size)
        self.series = SeriesResistance(self.size, config.touch_size, sheet)
        noise = np.asarray(np.nan if config.noise is None else config.noise, np.float64)
        channels = len(config.channels)
        self.touch_ = ContactGate(float(np.broadcast_to(noise, channels)[DIVIDER]), channels)
        self.wanted = estimator
        self.others_: Regression | None = None
        if estimator in REGRESSORS:
            self.others_ = Regression(config, estimator, channels)
        self.place_: PlaceHead | None = PlaceHead(self.size) if estimator is None else None
        self.height_ = np.zeros(2)
        self.force_: ForceHead | None = None
        self.crept_: ForceHead | None = None
        self.creep_: Creep | None = None
        self.shear_: Head | None = None
        self.untold_: Report = {}

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        if self.others_ is not None:
            return self.others_.estimators
        heads = {'position': self.place_, 'force': self.force_}
        return {target: head.name for target, head in heads.items() if head is not None}

    @property
    def report(self) -> Report:
        """Errors on held-out places, what contact was judged by, and what was not told."""
        if self.others_ is not None:
            return {**self.others_.report, **self.untold_}
        heads = {'position_xy': self.place_, 'force_z': self.force_, 'force_xy': self.shear_}
        heads['force_z_without_creep'] = self.crept_
        known = {title: head.report_ for title, head in heads.items() if head is not None}
        known = {title: table for title, table in known.items() if table}
        contact = {'contact': self.touch_.report_} if self.touch_.report_ else {}
        return {**known, **contact, **self.untold_}

    def start(self) -> FadingMemory | FilmCreep:
        """Fresh memory of a stream."""
        if self.others_ is not None:
            return self.others_.start()
        return (self.creep_ or Creep()).start()

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn contact, place and force from what truth tells; see `Regression.fit`."""
        x = self.touch_.fit(signals, truth).readings(signals)
        contact = self.touch_.contact(signals, x)
        signals = replace(signals, in_contact=contact, good=signals.good & (contact != 0))
        self._learn(signals, x, truth, groups)
        crept = 0.0 if self.creep_ is None else self.creep_.most
        self.untold_ = untold(self.size, signals, truth, crept)

    def _learn(self, signals: Signals, x: Array, truth: Columns, groups: Columns) -> None:
        """Place and force from settled readings (s, c) and what truth tells."""
        blank = np.full((len(x), 3), np.nan)
        position = np.asarray(truth.get('position', blank), np.float64)
        force = np.asarray(truth.get('force', blank), np.float64)
        if self.others_ is not None:
            self.others_.fit(_own(signals, x), truth, groups)
            return
        group = np.asarray(groups['group'], np.int64)
        there = np.isfinite(position[:, :2]).all(axis=1)
        kept = _places(position, np.asarray(there), group)
        rows = signals.good & there
        spots = position[rows, :2] / self.size
        if rows.sum() >= FEWEST_ROWS and tells_places(np.delete(x[rows], DIVIDER, axis=1), spots):
            head = PlaceHead(self.size)
            self.place_ = head.fit(x[rows], position[rows, :2], kept[rows], self.wanted)
            height = position[rows, 2]
            height = height[np.isfinite(height)]
            known = len(height) > 0
            self.height_ = np.array(
                [np.median(height), height.var() + 1e-12] if known else [np.nan, np.nan]
            )
        self._learn_force(signals, x, force, kept)
        self._learn_shear(signals, x, force, group, groups)

    def implausible_taxels(self, values: Array) -> Bools:
        """Taxels (s, t) of readings (s, t, c) that no wire can read: a short, a loose wire."""
        return implausible_taxels(values)

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Whether anything touches (s,): 1, 0, -1 unknown; the divider alone tells.

        Parameters
        ----------
        signals : Signals
            Conditioned frames, which stay as they are.
        """
        return self.touch_.contact(signals, self.touch_.readings(signals))

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Place and force of every row.

        Parameters
        ----------
        signals : Signals
            Conditioned frames; `in_contact` is set by what the divider says.
        memory : FadingMemory or FilmCreep
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, 3) or (s, 3, 3)
            One entry and its covariance for each target.
        """
        x = self.touch_.readings(signals)
        if self.others_ is not None:
            return self.others_.estimate(_own(signals, x), memory)
        assert isinstance(memory, FilmCreep)
        known: Columns = {}
        place = x[:, :2]
        if self.place_ is not None:
            place, covariance = self.place_.predict(x)
            position = np.empty((len(x), 3))
            position[:, :2], position[:, 2] = place, self.height_[0]
            known['position'], known['position_cov'] = position, self._beside(covariance)
        if self.force_ is not None:
            self._add_force(known, signals, x, place, memory)
        return known

    def _beside(self, covariance: Array) -> Array:
        """Covariances (s, 3, 3) of places in the plane (s, 2, 2) with that of their height."""
        height = float(self.height_[1])
        whole = np.empty((len(covariance), 3, 3))
        whole.fill(0.0 if height >= 0 else np.nan)
        whole[:, 2, 2] = height
        whole[:, :2, :2] = covariance
        return whole

    def _add_force(
        self, known: Columns, signals: Signals, x: Array, place: Array, memory: FilmCreep
    ) -> None:
        """Forces, covariances of their errors, and whether they are beyond those of the fit."""
        assert self.force_ is not None
        value, spread = self._normal(signals, x, place, memory)
        beyond = self.force_.unsure(value, spread)
        if beyond is not None:
            spread, known['status'] = beyond
        force, covariance = np.empty((len(x), 3)), np.empty((len(x), 3, 3))
        force.fill(np.nan)
        covariance.fill(np.nan)
        force[:, 2], covariance[:, 2, 2] = value, spread * spread
        untouched = signals.in_contact == 0
        if np.count_nonzero(untouched):
            force[untouched, 2], covariance[untouched, 2, 2] = 0.0, self.touch_.subthreshold_
        if self.shear_ is not None:
            mean, cov, _ = self.shear_.predict(x.copy(), np.zeros_like(x))
            force[:, :2], covariance[:, :2, :2] = mean, cov
        known['force'], known['force_cov'] = force, covariance

    def _normal(
        self, signals: Signals, x: Array, place: Array, memory: FilmCreep
    ) -> tuple[Array, Array]:
        """Normal forces (s,) and their spreads (N), without creep where stamps tell the past."""
        assert self.force_ is not None
        columns = self._columns(x, place)
        if self.crept_ is None or self.creep_ is None or signals.stamp_ns is None:
            return self.force_.at(x, *columns)
        static, spread = self.crept_.at(x, *columns)
        static = np.where(signals.in_contact == 0, 0.0, static)
        static = np.where(signals.good, static, np.nan)
        means = memory(static, place, signals.stamp_ns, signals.restart)
        past, doubt = self.creep_.past(static, means)
        return static - past, np.sqrt(spread**2 + doubt)

    def _columns(self, x: Array, place: Array) -> tuple[Array, Array]:
        """Places (s, 2) over the size of the sheet, and R over R0 (s,)."""
        return place / self.size, 1.0 / np.fmax(x[:, DIVIDER], LEAST_DIVIDER) - 1.0

    def _learn_force(self, signals: Signals, x: Array, force: Array, kept: Integers) -> None:
        """Static curve, and where stamps tell the past one without creep."""
        rows = signals.good & np.isfinite(force[:, 2])
        self.force_ = self.crept_ = self.creep_ = None
        if rows.sum() < FEWEST_ROWS or not tells_forces(x[rows, DIVIDER], force[rows, 2]):
            return
        place = x[:, :2] if self.place_ is None else self.place_.predict(x)[0]
        features, told = features_of(x, *self._columns(x, place)), force[:, 2]
        noise = 0.0 if np.isnan(self.touch_.noise) else self.touch_.noise
        wanted = self.wanted
        self.force_ = ForceHead(noise, self.size, self.series).fit(
            features[rows], told[rows], kept[rows], wanted
        )
        if signals.stamp_ns is not None and wanted is None:
            self._learn_creep(signals, features, told, kept, rows)

    def _learn_creep(
        self, signals: Signals, features: Array, told: Array, kept: Integers, rows: Bools
    ) -> None:
        """A static curve of what the film would say without its past, and what its past adds."""
        assert self.force_ is not None
        static, creep = self._static(self.force_, features, signals), Creep()
        means, known = np.empty(0), (told[rows], kept[rows])
        for edge in (np.inf, self.touch_edge):
            own = self._means(Creep(edge), static, features, signals)
            found = Creep(edge).fit(static[rows], own[rows], *known)
            # one long hold tells the slow shares of a film: left out, nothing would
            if not len(means) or found.left_ < creep.left_:
                creep, means = found, own
        if not creep.is_any:
            return
        curve = copy.deepcopy(self.force_.estimator_)
        last = ForceHead(self.force_.noise, self.size, self.series)
        for step in range(ROUNDS):
            target = (told + creep.bounded_past(static, means))[rows]
            if step == ROUNDS - 1:
                last.fit(features[rows], target, kept[rows], self.force_.name)
                static = self._static(last, features, signals)
            else:
                curve.fit(features[rows], target[:, None], kept[rows])
                static = self._static(curve, features, signals)
            means = self._means(creep, static, features, signals)
            creep.fit(static[rows], means[rows], *known)
        past, doubt = creep.past(static[rows], means[rows])
        left = np.abs(static[rows] - past - told[rows])
        if creep.is_any and np.sqrt((left**2).mean()) < self.force_.report_['held_out_rmse']:
            self.crept_, self.creep_ = last, creep
            asked = np.sqrt(np.maximum(left**2 - doubt, 0.0))
            factor = np.quantile(asked / last.predict(features[rows])[1], ONE_SIGMA)
            last.tighten(max(float(factor), LEAST_SCATTER))

    def _means(self, creep: Creep, static: Array, features: Array, signals: Signals) -> Array:
        """Fading means (s, m) of the forces (s,) of a static curve."""
        assert signals.stamp_ns is not None
        return creep.start()(
            static, features[:, :2] * self.size, signals.stamp_ns, signals.restart
        )

    def _static(self, head: ForceHead | Estimator, features: Array, signals: Signals) -> Array:
        """Forces (s,) of a static curve: 0 where nothing touches, NaN where unusable."""
        touching = signals.in_contact != 0
        static = np.zeros(len(features))
        said = head.predict(features[touching])
        static[touching] = said[0] if isinstance(said, tuple) else said[:, 0]
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
        head = Head('force', (0, 1), 'ridge', x.shape[1])
        head.fit(x[rows], told, group[rows], session, np.zeros((len(told), 3)))
        self.shear_ = head if head.report_['held_out_rmse'] < USEFUL * spread else None


def _own(signals: Signals, x: Array) -> Signals:
    """Frames of which only the divider has a baseline."""
    wide = np.repeat(x[:, None], signals.values.shape[1], axis=1)
    return replace(signals, delta=wide, baseline=np.zeros_like(signals.values))


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
        for one in (
            FiveWireEstimation,
            ContactGate,
            Creep,
            *REGRESSION_CLASSES,
            *PLACE_CLASSES,
            *FORCE_CLASSES,
        )
    }.values()
)
