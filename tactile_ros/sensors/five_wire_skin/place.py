"""Place of a touch from the two potentials: which map serves is chosen on held-out places."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.covariance import SigmaCalibration
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import chosen, some_rows, trials, verdict
from tactile_ros.estimators.potential_map import HarmonicMap, SheetPotentials
from tactile_ros.estimators.rbf_force import ThinPlate
from tactile_ros.estimators.regression import ColumnSelector, Perceptron, Ridge, predict_rows
from tactile_ros.physics.resistive_sheet import linear_place
from tactile_ros.sensors.five_wire_skin.contact_gate import CONSTANT
from tactile_ros.types import Array, Estimator, Integers

NOMINAL_SPREAD = 0.06  # of the sheet: an uneven border bends the linear formula that much
POTENTIALS = 2  # in front of the divider
REGRESSORS = ('ridge', 'grid_knn')
LEAST_SPREAD = 0.02  # of the sheet: deviation of places in every direction


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

    Where there are more than two potentials, as many as tell the place are made of them: sums
    whose slopes over the sheet are all that the slopes of the potentials say, and whose noise is
    as large. Sums of harmonic functions are harmonic.

    Attributes
    ----------
    sums_ : ndarray, shape (p, 2), or None
        Shares of the potentials in two sums; None: there are but two, or no fit.
    name : str
        Of the map in use.
    spread_ : SigmaCalibration
        Scale of its covariance, measured on held-out places.
    level_ : ndarray, shape (2,)
        Spread of a map that states none (m).
    report_ : dict of str to float
        Errors on held-out places (m).
    """

    estimator_: Estimator  # fitted on all rows

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)
        self.name = 'linear'
        self.estimator_ = LinearPlace(self.size)
        self.spread_: SigmaCalibration | None = None
        self.level_ = NOMINAL_SPREAD * self.size
        self.report_: dict[str, float] = {}
        self.sums_: Array | None = None

    def fit(self, x: Array, y: Array, groups: Integers, wanted: str | None) -> PlaceHead:
        """Choose and fit.

        Parameters
        ----------
        x : ndarray, shape (s, 3..)
            Potentials u_AC and u_BD, the divider's reading, and further potentials.
        y : ndarray, shape (s, 2)
            Places (m).
        groups : ndarray of int, shape (s,)
            What a split keeps together: places, where they repeat.
        wanted : str or None
            'printed' or 'mean_curve': the linear formula; None: the best.
        """
        if x.shape[1] > POTENTIALS + 1 and wanted is None:
            self.sums_ = _sums(_potentials(x), y)
        x = self._seen(x)
        some = some_rows(x, y)
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
        judged = verdict(found, best, told, groups)
        self.spread_, self.level_, self.report_ = judged.spread, judged.level, judged.report
        return self

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) (m) and covariances of their errors (s, 2, 2) (m2)."""
        x = self._seen(x)
        if isinstance(self.estimator_, HarmonicMap):
            return self.estimator_.place(x)
        place = self.estimator_.predict(x)
        spread = np.broadcast_to(self.level_, place.shape)
        spread = spread if self.spread_ is None else self.spread_(spread)
        return place, spread[:, :, None] * spread[:, None, :] * np.eye(2)

    def _seen(self, x: Array) -> Array:
        """Two potentials, or two sums of them, and the divider (s, 3) of readings (s, 3..)."""
        if self.sums_ is None:
            return x if x.shape[1] == POTENTIALS + 1 else x[:, : POTENTIALS + 1].copy()
        seen = np.empty((len(x), POTENTIALS + 1))
        # no product of matrices: its sums run otherwise for one frame than for many
        seen[:, :POTENTIALS] = np.einsum('sp,pk->sk', _potentials(x), self.sums_)
        seen[:, POTENTIALS] = x[:, POTENTIALS]
        return seen

    def _candidates(self, wanted: str | None) -> dict[str, Estimator]:
        """Maps to choose from."""
        formula: dict[str, Estimator] = {'linear': LinearPlace(self.size)}
        if wanted is not None:
            return formula
        return ({} if self.sums_ is not None else formula) | {
            'harmonic': HarmonicMap(self.size),
            'thin_plate': ColumnSelector(ThinPlate(), np.array([0, 1])),
            'ridge': Ridge(),
            'grid_knn': GridKnn(),
        }


def tells_places(potentials: Array, places: Array) -> bool:
    """Whether two of the potentials (s, p) move, and places (s, 2) do in every direction.

    Touches of one place, or along a line, would make a map that is sure of what it never saw.
    Places are in units of the sheet's edges.
    """
    least = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[-1]
    moving = (np.ptp(potentials, axis=0) > CONSTANT).sum()
    return bool(moving >= POTENTIALS and least > LEAST_SPREAD * np.sqrt(len(places)))


def _potentials(x: Array) -> Array:
    """Potentials (s, p) of readings (s, 3..), without the divider between them."""
    return np.concatenate([x[:, :POTENTIALS], x[:, POTENTIALS + 1 :]], axis=1)


def _sums(potentials: Array, y: Array) -> Array:
    """Shares (p, 2) of potentials (s, p) in sums that tell places y (s, 2) best.

    The best guess of a place from values with slopes G and equal noise is (G'G)^-1 G' u; times
    (G'G)^1/2 its noise is that of a potential in every direction.
    """
    plane = np.column_stack([np.ones(len(y)), y])
    slopes = np.linalg.lstsq(plane, potentials, rcond=None)[0][1:]
    left, _, right = np.linalg.svd(slopes.T, full_matrices=False)
    return np.asarray(left @ right)


def _told(x: Array, y: Array) -> Array:
    """Places of rows, which are their targets."""
    return y


CLASSES = (
    PlaceHead,
    LinearPlace,
    HarmonicMap,
    SheetPotentials,
    ColumnSelector,
    ThinPlate,
    SigmaCalibration,
    Perceptron,
    Ridge,
    GridKnn,
)
