"""Place of a touch from the two potentials: which map serves is chosen on held-out places."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.column_view import ColumnView
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.harmonic_map import HarmonicMap
from tactile_ros.estimators.perceptron import Perceptron
from tactile_ros.estimators.ridge import Ridge
from tactile_ros.estimators.stated_spread import StatedSpread
from tactile_ros.estimators.thin_plate import ThinPlate
from tactile_ros.estimators.training import predict_rows
from tactile_ros.estimators.trials import chosen, trials
from tactile_ros.physics.resistive import linear_place
from tactile_ros.types import Array, Estimator, Integers

NOMINAL_SPREAD = 0.06  # of the sheet: an uneven border bends the linear formula that much
MOST_TRIED = 2000  # rows that candidates are compared on
REGRESSORS = ('ridge', 'grid_knn')


class LinearPlace:
    """The formula of [5] for a border without faults; it learns nothing.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    """

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> LinearPlace:
        """Nothing is learned."""
        return self

    def predict(self, x: Array) -> Array:
        """Places (s, 2) (m) for potentials (s, 2)."""
        return predict_rows(x, x.shape[1], lambda u: linear_place(u[:, :2], self.size))


class PlaceHead:
    """Map from potentials to place, with the covariance of its error.

    Attributes
    ----------
    name : str
        Of the map in use.
    estimator_ : Estimator
        Fitted on all rows.
    spread_ : StatedSpread
        Scale of its covariance, measured on held-out places.
    level_ : ndarray, shape (2,)
        Spread of a map that states none (m).
    report_ : dict of str to float
        Errors on held-out places (m).
    """

    estimator_: Estimator

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)
        self.name = 'linear'
        self.estimator_ = LinearPlace(self.size)
        self.spread_: StatedSpread | None = None
        self.level_ = NOMINAL_SPREAD * self.size
        self.report_: dict[str, float] = {}

    def fit(self, x: Array, y: Array, groups: Integers, wanted: str | None) -> PlaceHead:
        """Choose and fit.

        Parameters
        ----------
        x : ndarray, shape (s, 3)
            Potentials u_AC and u_BD, and the divider's reading.
        y : ndarray, shape (s, 2)
            Places (m).
        groups : ndarray of int, shape (s,)
            What a split keeps together: places, where they repeat.
        wanted : str or None
            'printed' or 'mean_curve': the linear formula; None: the best.

        Returns
        -------
        PlaceHead
            Itself.
        """
        some = np.linspace(0, len(x) - 1, min(len(x), MOST_TRIED)).astype(np.int64)
        some = np.lexsort(np.column_stack([x, y]).T)[some]
        tried = (x[some], y[some], groups[some])
        candidates = self._candidates(wanted)
        found, told = trials(candidates, *tried, _told)
        best = chosen(found, 'harmonic')
        if wanted is None and best in REGRESSORS:
            # no model of the sheet serves: the costly regressor may
            candidates['perceptron'] = Perceptron(pattern=True)
            more, _ = trials({'perceptron': candidates['perceptron']}, *tried, _told, folds=2)
            found |= more
            best = chosen(found, 'harmonic')
        self.name = best if wanted is None else wanted
        self.estimator_ = candidates[best].fit(x, y, groups)
        trial = found[best]
        self.spread_ = StatedSpread().fit(trial.spread, trial.said - told)
        self.level_ = np.sqrt(((trial.said - told) ** 2).mean(axis=0)) + 1e-9
        inside = np.abs(trial.said - told) <= self.spread_(trial.spread)
        self.report_ = {
            'held_out_mean': float(np.linalg.norm(trial.said - told, axis=1).mean()),
            'held_out_rmse': trial.error,
            'inside_one_sigma': float(inside.mean()),
            'groups': float(len(np.unique(groups))),
            'rows': float(len(x)),
            **{f'rmse_{name}': one.error for name, one in found.items()},
        }
        return self

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) (m) and covariances of their errors (s, 2, 2) (m2)."""
        if isinstance(self.estimator_, HarmonicMap):
            return self.estimator_.place(x)
        place = self.estimator_.predict(x)
        spread = np.broadcast_to(self.level_, place.shape)
        spread = spread if self.spread_ is None else self.spread_(spread)
        return place, spread[:, :, None] * spread[:, None, :] * np.eye(2)

    def _candidates(self, wanted: str | None) -> dict[str, Estimator]:
        """Maps to choose from."""
        if wanted is not None:
            return {'linear': LinearPlace(self.size)}
        return {
            'linear': LinearPlace(self.size),
            'harmonic': HarmonicMap(self.size),
            'thin_plate': ColumnView(ThinPlate(), np.array([0, 1])),
            'ridge': Ridge(),
            'grid_knn': GridKnn(),
        }


def _told(x: Array, y: Array) -> Array:
    """Places of rows, which are their targets."""
    return y


CLASSES = (
    PlaceHead,
    LinearPlace,
    HarmonicMap,
    ColumnView,
    ThinPlate,
    StatedSpread,
    Perceptron,
    Ridge,
    GridKnn,
)
