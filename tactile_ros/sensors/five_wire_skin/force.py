"""Normal force of a touch from its place and the divider: which curve serves is chosen."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.beyond_told import guessed
from tactile_ros.estimators.column_view import ColumnView
from tactile_ros.estimators.film_resistance import FilmResistance
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.kernel_ridge import KernelRidge
from tactile_ros.estimators.mean_curve import MeanCurve
from tactile_ros.estimators.power_force import PowerForce
from tactile_ros.estimators.rbf_force import RbfForce
from tactile_ros.estimators.ridge import Ridge
from tactile_ros.estimators.smooth_fields import SmoothFields
from tactile_ros.estimators.stated_spread import StatedSpread
from tactile_ros.estimators.trials import chosen, some_rows, trials, verdict
from tactile_ros.physics.resistive import SeriesResistance
from tactile_ros.sensors.five_wire_skin.touch import CONSTANT
from tactile_ros.types import Array, Estimator, FrameStatus, Integers

LEAST_RESISTANCE = 1e-4  # over R0
LEAST_RANGE = 0.1  # of the largest force
LARGEST = 1.4  # times the same: where answers end


class ForceHead:
    """Map from place and resistance to normal force, with the spread of its error.

    Features are x and y over the size of the sheet, R over R0, u_AC, u_BD, the divider's reading,
    and the logarithm of R / R0. It starts from the divider's noise, the edges of the sheet and
    its nominal Rx over R0.

    Attributes
    ----------
    name : str
        Of the estimator in use.
    estimator_ : Estimator
        Fitted on all rows.
    spread_ : StatedSpread
        Scale of its spread, measured on held-out places.
    level_ : ndarray, shape (1,)
        Spread of an estimator that states none (N).
    report_ : dict of str to float
        Errors on held-out places (N).
    most_ : float
        Largest force that was told (N).
    """

    most_: float = np.inf
    estimator_: Estimator
    spread_: StatedSpread
    level_: Array
    report_: dict[str, float]

    def __init__(self, noise: float, size: Array, series: SeriesResistance) -> None:
        self.noise = noise
        self.size = size
        self.series = series
        self.name = ''

    def fit(self, x: Array, y: Array, groups: Integers, wanted: str | None) -> ForceHead:
        """Choose and fit.

        Parameters
        ----------
        x : ndarray, shape (s, 7)
            Features.
        y : ndarray, shape (s,)
            Normal forces (N).
        groups : ndarray of int, shape (s,)
            What a split keeps together: places, where they repeat.
        wanted : str or None
            'printed': the network of [5]; or the name of a candidate; None: the best.

        Returns
        -------
        ForceHead
            Itself.
        """
        some, self.most_ = some_rows(x, y), float(np.max(y))
        candidates = self._candidates(wanted)
        found, told = trials(candidates, x[some], y[some, None], groups[some], _plane)
        best = chosen(found, 'power')
        self.name = best if wanted is None else wanted
        self.estimator_ = candidates[best].fit(x, y[:, None], groups)
        judged = verdict(found, best, told, groups)
        self.spread_, self.level_, self.report_ = judged.spread, judged.level, judged.report
        return self

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) and spreads of their errors (s,) (N)."""
        if isinstance(self.estimator_, PowerForce):
            return self.estimator_.force(x)
        force = self.estimator_.predict(x)[:, 0]
        spread = np.broadcast_to(self.level_, (len(x), 1))
        return force, self.spread_(spread)[:, 0]

    def at(self, x: Array, places: Array, resistance: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) and spreads of their errors (s,) (N) for the columns of features."""
        if isinstance(self.estimator_, PowerForce):
            return self.estimator_.at(places, resistance)
        return self.predict(features_of(x, places, resistance))

    def unsure(self, force: Array, spread: Array) -> tuple[Array, Integers] | None:
        """Spreads (s,) (N) and status of forces (s,), some of them larger than any that was told.

        None: there is no such force. What lies beyond is unsure by half, and an answer at the end
        of all answers by itself: the force may be any larger one.
        """
        error = guessed(force, self.most_)
        if error is None:
            return None
        beyond = error > 0
        part = np.where(force > LARGEST * self.most_, force, error)
        wider = np.where(beyond, np.hypot(spread, part), spread)
        return wider, beyond * np.int64(FrameStatus.OUT_OF_RANGE)

    def tighten(self, factor: float) -> None:
        """Let errors at known places be smaller by a factor, as they are without creep."""
        if isinstance(self.estimator_, PowerForce):
            self.estimator_.scale_scatter(factor)
        else:
            self.spread_.factors_ += np.log(factor)

    def _candidates(self, wanted: str | None) -> dict[str, Estimator]:
        """Estimators to choose from."""
        network: Estimator = ColumnView(RbfForce(), np.array([0, 1, 2]))
        if wanted == 'printed':
            return {'rbf': network}
        known: dict[str, Estimator] = {
            'power': PowerForce(self.noise, self.size, self.series),
            'rbf': network,
            'rbf_log': ColumnView(RbfForce(), np.array([0, 1, 6])),
            'mean_curve': MeanCurve(6),
            'ridge': ColumnView(Ridge(), np.array([3, 4, 5])),
            'kernel_ridge': ColumnView(
                KernelRidge(lengths=(0.4,), linear=1.0, strengths=(1e-6,), common=10.0),
                np.array([3, 4, 5]),
            ),
            'grid_knn': ColumnView(GridKnn(), np.array([3, 4, 5])),
        }
        return known if wanted is None else {wanted: known[wanted]}


def tells_forces(divider: Array, force: Array) -> bool:
    """Whether readings (s,) move and forces (s,) differ: one load tells no curve."""
    told = np.ptp(force) > LEAST_RANGE * np.abs(force).max()
    return bool(np.ptp(divider) > CONSTANT and told)


def features_of(x: Array, places: Array, resistance: Array) -> Array:
    """Features (s, 7) of `ForceHead` from readings (s, 3..), places (s, 2) and R (s,)."""
    features = np.empty((len(x), 7))
    features[:, :2] = places
    features[:, 2] = np.maximum(resistance, LEAST_RESISTANCE)
    features[:, 3:6] = x[:, :3]
    features[:, 6] = np.log(features[:, 2])
    return features


def _plane(x: Array, y: Array) -> Array:
    """Places of rows, the first two features."""
    return x[:, :2]


CLASSES = (
    ForceHead,
    ColumnView,
    PowerForce,
    FilmResistance,
    SeriesResistance,
    SmoothFields,
    RbfForce,
    MeanCurve,
    Ridge,
    KernelRidge,
    GridKnn,
    StatedSpread,
)
