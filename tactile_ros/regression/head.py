"""One target's regressor with its covariance: chosen and calibrated on held-out groups."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.gain_spread import GainSpread
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.kernel_ridge import KernelRidge
from tactile_ros.estimators.perceptron import Perceptron
from tactile_ros.estimators.resting_state import RestingState
from tactile_ros.estimators.ridge import Ridge
from tactile_ros.estimators.selection import select
from tactile_ros.estimators.standardisation import Standardisation
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.types import Array, Bools, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ESTIMATORS = ('ridge', 'grid_knn', 'kernel_ridge', 'perceptron')
FEWEST_ROWS = 5
TINY = np.finfo(np.float64).tiny
MOST_RUNS = 10  # folds of runs that are held out, a fit each
FEW_FOLDS = 2  # thousands of touches are judged well by two fifths of them
STATE_WEIGHT = 3.0  # the set of the skin is a small part of the change; its share of a distance


def candidates(wanted: str | None, *, place: bool) -> dict[str, Estimator]:
    """The regressors to choose from, by name; the pattern of a touch tells its place."""
    known: dict[str, Estimator] = {
        'ridge': Ridge(),
        'grid_knn': GridKnn(),
        'kernel_ridge': KernelRidge() if place else beyond_presses(),
        'perceptron': Perceptron(pattern=place),
    }
    if wanted is not None:
        return {wanted: known[wanted]}
    del known['kernel_ridge' if place else 'perceptron']
    return known


def beyond_presses() -> KernelRidge:
    """A regressor for a skin whose state has moved on since the presses it learned from.

    A plane as strong as the bumps carries the answer to loads and states beyond those seen. The
    penalty is set, to a thousandth of the range: presses of one run, on which it could be chosen,
    know nothing of the next run.
    """
    return KernelRidge(lengths=(0.4,), linear=1.0, strengths=(1e-6,), common=10.0)


class Head:
    """Regressor of some components of one target.

    Parameters
    ----------
    target : str
        Attribute of the state.
    columns : tuple of int
        Components that truth tells.
    wanted : str or None
        Name of an estimator; None: the best of all.
    channels : int
        How many features are the change of field now; the others are its history.

    Attributes
    ----------
    name : str
        Of the estimator in use.
    estimator_ : Estimator
        Fitted on all rows.
    gain_ : GainSpread or None
        Of a force: how gains differ from run to run.
    state_ : RestingState or None
        Of a force: what the resting reading tells of the skin.
    covariance_ : CalibratedCovariance
        From residuals of rows that the estimator had not seen.
    report_ : dict of str to float
        Errors on held-out groups (unit of the target).
    """

    def __init__(
        self, target: str, columns: tuple[int, ...], wanted: str | None, channels: int
    ) -> None:
        self.target = target
        self.columns = columns
        self.wanted = wanted
        self.channels = channels
        self.name = ''

    def fit(self, x: Array, y: Array, groups: Integers, sessions: Integers, rests: Array) -> Head:
        """Choose, fit and calibrate.

        Parameters
        ----------
        x : ndarray, shape (s, d)
            Features; beside a history, the last column is overwritten.
        y : ndarray, shape (s, k)
            Components of the target, all known.
        groups : ndarray, shape (s,)
            What a split keeps together.
        sessions : ndarray, shape (s,)
            Runs, which differ in gain.
        rests : ndarray, shape (s, channels)
            Resting reading under each row.

        Returns
        -------
        Head
            Itself.
        """
        place = self.target == 'position'
        self.state_ = None if place else RestingState().fit(rests, sessions)
        x = x if self.state_ is None else self._seen(x, self.state_.along(rests))
        known = self.candidates()
        choice = select(known, x, y, groups, rounds=self.rounds(known, len(x)))
        self.name = choice.name
        self.estimator_ = known[self.name].fit(x, y, groups)
        drivers = self._drivers(choice.x, choice.predictions)
        self.covariance_ = CalibratedCovariance().fit(drivers, choice.residuals, choice.groups)
        self.gain_ = None if place else self._gain(known[self.name], x, y, sessions)
        sigma = np.sqrt(np.diagonal(self.covariance_.predict(drivers), axis1=1, axis2=2))
        error = np.linalg.norm(choice.residuals, axis=1)
        self.report_ = {
            'held_out_mean': float(error.mean()),
            'held_out_rmse': float(np.sqrt((error**2).mean())),
            'inside_one_sigma': float((np.abs(choice.residuals) <= sigma).mean()),
            'groups': float(len(np.unique(choice.groups))),
            'rows': float(len(x)),
            **{f'rmse_{name}': error for name, error in choice.errors.items()},
        }
        return self

    def candidates(self) -> dict[str, Estimator]:
        """The regressors to choose from, by name."""
        return candidates(self.wanted, place=self.target == 'position')

    def rounds(self, known: Mapping[str, Estimator], rows: int) -> int | None:
        """How many folds are held out; None: all."""
        return FEW_FOLDS if 'perceptron' in known and rows else None

    @cached_property
    def cells(self) -> tuple[slice | Integers, slice | Integers]:
        """Index of its components among three: of rows and of columns of a covariance."""
        first, last = self.columns[0], self.columns[-1] + 1
        if last - first == len(self.columns):  # a slice costs a tenth of a list
            return slice(first, last), slice(first, last)
        index = np.array(self.columns)
        return index[:, None], index

    @property
    def title(self) -> str:
        """Target with the names of its components."""
        return f'{self.target}_{"".join("xyz"[i] for i in self.columns)}'

    def predict(self, x: Array, rests: Array) -> tuple[Array, Array]:
        """Components (s, k) and their covariance (s, k, k) at rests (s, channels).

        Beside a history, the last column of x is overwritten.
        """
        if self.gain_ is None or self.state_ is None:
            mean = self.estimator_.predict(x)
            return mean, self.covariance_.predict(self._drivers(x, mean))
        state, strangeness = self.state_.read(rests)
        mean = self.estimator_.predict(self._seen(x, state))
        cov = self.covariance_.predict(self._drivers(x, mean))
        cov += self.gain_.covariance(mean, strangeness)
        return mean, cov

    def _seen(self, x: Array, state: Array) -> Array:
        """Features; beside a history, the state of the skin is written to the last of them."""
        if x.shape[1] > self.channels:
            np.multiply(state, STATE_WEIGHT, out=x[:, -1:])
        return x

    @staticmethod
    def _gain(estimator: Estimator, x: Array, y: Array, sessions: Integers) -> GainSpread:
        """Spread of gain between runs, from runs held out; of one run only a prior is known."""
        runs = len(np.unique(sessions))
        if runs < 2:
            return GainSpread().fit(y, y, sessions)
        unseen = select({'': estimator}, x, y, sessions, folds=min(runs, MOST_RUNS))
        return GainSpread().fit(unseen.predictions, unseen.y, unseen.groups)

    def _drivers(self, x: Array, mean: Array) -> Array:
        """What the error depends on: strength of the signal, and place or load."""
        now = x[:, : self.channels]
        drivers = np.empty((len(x), 1 + mean.shape[1]))
        drivers[:, 0] = 0.5 * np.log(np.add.reduce(now * now, axis=1) + TINY)
        drivers[:, 1:] = mean
        return drivers


def known_columns(y: Array, good: Bools) -> Iterator[tuple[tuple[int, ...], Bools]]:
    """Split components (s, 3) into sets that are known in the same rows.

    Yields
    ------
    columns, rows : tuple of int, ndarray of shape (s,)
        Components, and the usable rows at which all of them are known.
    """
    known = np.isfinite(y) & good[:, None]
    left = [i for i in range(y.shape[1]) if known[:, i].sum() >= FEWEST_ROWS]
    while left:
        same = tuple(i for i in left if (known[:, i] == known[:, left[0]]).all())
        yield same, known[:, same[0]]
        left = [i for i in left if i not in same]


CLASSES = (
    Head,
    GainSpread,
    RestingState,
    Ridge,
    GridKnn,
    KernelRidge,
    Perceptron,
    Standardisation,
    CalibratedCovariance,
)
