"""One target of the gradiometer: its estimator, chosen and calibrated on held-out groups."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.covariance import CalibratedCovariance
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import Selection, select
from tactile_ros.estimators.polynomial_force import PolynomialForce, WarmChain
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge, WarmPolynomial
from tactile_ros.estimators.regression import ColumnSelector, KernelRidge, Perceptron, Ridge
from tactile_ros.sensors.gradiometer.temperature import LEAST_RANGE
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tactile_ros.types import Array, Bools, Columns, Estimator, Integers

ROWS = 10  # for a coefficient


def ends(beyond: Array, span: Array) -> Array:
    """How far temperatures lie from the middle of a span (2,) over half of it (s,), at least 1.

    A polynomial of a degree n that is at most 1 in absolute value from -1 to 1 is at most |T_n|
    outside (Chebyshev, 1854). Models of a fit are squares of the temperature: all of an error may
    grow as T_2. Only what held-out errors show of a cubic may grow as T_3.

    `beyond` (s,) are the degrees by which they lie outside.
    """
    return np.asarray(1 + 2 * beyond / max(float(span[1] - span[0]), LEAST_RANGE))


def grown(cov: Array, bend: Array, ends: Array) -> Array:
    """Covariances (s, k, k) of errors at `ends` (s,), of those at 1 and the cubic (k,) there."""
    second, third = 2 * ends**2 - 1, (4 * ends**2 - 3) * ends
    more = np.sqrt(third**2 - 1)[:, None] * bend
    return np.asarray(cov * (second**2)[:, None, None] + more[:, :, None] * more[:, None])


def bent(errors: Array, warm: Array, place: Array) -> Array:
    """Size (k,) of the cubic of the temperature in held-out errors, and of what may hide it.

    Parameters
    ----------
    errors : ndarray, shape (s, k)
        Of answers.
    warm : ndarray, shape (s,)
        Temperatures.
    place : ndarray, shape (s, d)
        What the cubic may follow linearly.

    Returns
    -------
    ndarray, shape (k,)
        Root mean square of T_3 of the temperature, over its range, times a linear function of
        the place; all of an error where rows are few.
    """
    size: Array = np.sqrt((errors**2).mean(axis=0))
    width = np.ptp(warm)
    scaled = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300)
    each = np.column_stack([np.ones(len(place)), scaled])
    count = each.shape[1]
    if len(errors) < 4 * ROWS * count or width == 0:
        return size
    u = 2 * (warm - warm.min())[:, None] / width - 1
    terms = np.column_stack([each, each * u, each * u**2, each * (4 * u**2 - 3) * u])
    found = np.linalg.lstsq(terms, errors, rcond=None)[0][-count:]
    return np.asarray(np.sqrt(((each @ found) ** 2).mean(axis=0)))


FARTHEST = 2.0  # times the largest that can be
_AXES = np.arange(3)


def largest(targets: Iterable[Target], full_scale: float) -> dict[str, float]:
    """Largest size of each quantity that can be, by the names of targets.

    Parameters
    ----------
    targets : iterable of Target
        Fitted; their spans tell what truth knew.
    full_scale : float
        Of the sensor (N); other quantities grow to it as force does.

    Returns
    -------
    dict of str to float
        (Unit of the quantity.) Infinite where truth told nothing but 0.
    """
    told: dict[str, float] = {}
    for target in targets:
        told[target.name] = max(told.get(target.name, 0.0), float(np.abs(target.span_).max()))
    force = told.get('force', 0.0)
    more = max(1.0, full_scale / force) if force > 0 else 1.0
    return {name: more * size if size > 0 else np.inf for name, size in told.items()}


def reject_implausible(known: Columns, most: dict[str, float], touched: Bools) -> Bools:
    """Make quantities NaN in touched rows where nobody should believe them.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Quantities and their covariances; changed in place. `valid` (s,) is added: False where
        none of them is told.
    most : dict of str to float
        Of `largest`.
    touched : ndarray of bool, shape (s,)
        Rows to look at.

    Returns
    -------
    ndarray of bool, shape (s,)
        Rows that lost something.
    """
    some, every = np.zeros_like(touched), np.array(touched)
    for name, size in most.items():
        mean, cov = (np.asarray(known[one], np.float64) for one in (name, f'{name}_cov'))
        variance = cov[:, _AXES, _AXES]
        farther = (variance > size * size) | (np.abs(mean) > FARTHEST * size)
        if not np.count_nonzero(farther):
            every = every & False
            continue
        lost = touched & farther.any(axis=1)
        mean[lost], cov[lost] = np.nan, np.nan
        some, every = some | lost, every & lost
    known['valid'] = ~every
    return some


PLAIN = (
    'ridge', 'grid_knn', 'kernel_ridge', 'perceptron', 'polynomial', 'differences', 'channels',
    'history',
)  # fmt: skip
MODELS = ('inversion', 'inversion_tilt', 'inversion_rest')
ESTIMATORS = (*MODELS, *PLAIN)
FOLDS = 10  # for the covariance: fits on fewer rows err more than the one in use
SURE = 2.0  # standard errors
TRIED = 1500  # rows on which candidates are compared
STRENGTHS = (5.0, 20.0, 80.0, 320.0)  # rows, for the noise that is carried through as it is
TINY = 1e-12


def candidates(parts: dict[str, Integers], wanted: str | None) -> dict[str, Estimator]:
    """Estimators of the features that there are, by name."""
    warm = parts['thermal']
    low, slow = (1, 2, 3), len(warm)
    seen = np.concatenate([parts['differences'], warm])
    every = np.concatenate([parts['field'], warm])
    known: dict[str, Estimator] = {}
    if 'place' in parts:
        place = np.concatenate([parts['place'], warm])
        known['inversion'] = ColumnSelector(_of_place((1, 2, 3, 4, 5, 6, 7), slow), place)
        tilted = np.concatenate([parts['tilted'], warm])
        known['inversion_tilt'] = ColumnSelector(_of_place((*low, 4), slow), tilted)
        rest = np.concatenate([parts['place'], parts['rest'], warm])
        known['inversion_rest'] = ColumnSelector(PolynomialRidge(low, slow), rest)
    if 'history' in parts:
        known['history'] = _with_history(parts, slow)
    known['channels'] = ColumnSelector(PolynomialRidge(low, slow), every)
    known['differences'] = ColumnSelector(PolynomialRidge((*low, 4), slow), seen)
    chain = WarmChain(slow) if slow else PolynomialForce()
    known['polynomial'] = ColumnSelector(chain, every)
    known['kernel_ridge'] = ColumnSelector(KernelRidge(), parts['differences'])
    known['ridge'] = ColumnSelector(Ridge(), seen)
    known['grid_knn'] = ColumnSelector(GridKnn(), parts['differences'])
    if wanted == 'perceptron':
        return {wanted: ColumnSelector(Perceptron(), parts['differences'])}
    return known if wanted is None else {wanted: known[wanted]}


def _of_place(degrees: tuple[int, ...], slow: int) -> WarmPolynomial | PolynomialRidge:
    """Polynomial of a place; with temperatures, of an elastomer that expands and softens."""
    return WarmPolynomial(degrees, slow) if slow else PolynomialRidge(degrees)


def _with_history(parts: dict[str, Integers], slow: int) -> ColumnSelector:
    """Polynomial of the place, or of differences, beside what they were a while ago."""
    now = parts.get('place', parts['differences'])
    columns = np.concatenate([now, parts['thermal'], parts['history']])
    return ColumnSelector(PolynomialRidge((1, 2, 3, 4), slow + len(parts['history'])), columns)


class Target:
    """Estimator of some components of force, torque or position.

    Parameters
    ----------
    name : str
        Attribute of the state.
    columns : tuple of int
        Components that truth tells.
    drivers : ndarray of int, shape (d,)
        Features on which the error depends.
    strength : ndarray of int, shape (m,)
        Features whose size does too.

    Attributes
    ----------
    estimator_name : str
        Of the estimator in use.
    estimator_ : Estimator
        Fitted on all rows, on components over `unit_`.
    unit_ : ndarray, shape (k,)
        Spread of each component.
    span_ : ndarray, shape (2, k)
        Least and most of each component that truth told.
    covariance_ : CalibratedCovariance
        From residuals of rows that the estimator had not seen.
    bend_ : ndarray, shape (k,)
        Cubic of the temperature in them, over `unit_`; 0 where no temperature is a feature.
    report_ : dict of str to float
        Errors on held-out groups (unit of the target).
    """

    def __init__(
        self, name: str, columns: tuple[int, ...], drivers: Integers, strength: Integers
    ) -> None:
        self.name = name
        self.columns = columns
        self.drivers = drivers
        self.strength = strength
        self.estimator_name = ''

    def fit(self, x: Array, y: Array, groups: Integers, known: dict[str, Estimator]) -> Selection:
        """Choose among `known` by features (s, f), components (s, k) and groups (s,).

        What the one in use said about rows that it had not seen, over `unit_`, for `calibrate`.
        """
        spread, self.span_ = y.std(axis=0), np.stack([y.min(axis=0), y.max(axis=0)])
        self.unit_ = np.where(spread > 0, spread, 1.0)
        scaled = y / self.unit_
        few = _few_groups(groups)
        choice = select(known, x[few], scaled[few], groups[few])
        errors, name = choice.errors, choice.name
        usual = next(iter(known))
        if name != usual:
            plain = select({usual: known[usual]}, x[few], scaled[few], groups[few])
            name = name if _clearly_better(choice, plain) else usual
        folds = 3 if len(few) < len(x) else FOLDS
        choice = select({name: known[name]}, x, scaled, groups, folds=folds)
        self.estimator_name = name
        self.estimator_ = known[name].fit(x, scaled, groups)
        self.report_ = {f'share_{name}': error for name, error in errors.items()}
        return choice

    def calibrate(self, choice: Selection, noise: Array) -> None:
        """Learn the covariance from rows left out, and what noise does to them (s, k).

        The spread is that of the noise, carried through, times what the residuals ask for
        (Papadopoulos, Gammerman and Vovk, Normalized nonconformity measures, 2008).
        """
        drivers = self.drive(choice.x)
        self.covariance_ = CalibratedCovariance(STRENGTHS).fit(
            drivers, choice.residuals, choice.groups, noise
        )
        place, warm = np.split(choice.x[:, self.drivers], [3], axis=1)
        self.bend_ = np.zeros(len(self.columns))
        if warm.shape[1]:
            self.bend_ = bent(choice.residuals, warm[:, 0], place)
        sigma = self.covariance_.sigma(drivers, noise) * self.unit_
        residuals = choice.residuals * self.unit_
        length = np.linalg.norm(residuals, axis=1)
        self.report_ = {
            'held_out_mean': float(length.mean()),
            'held_out_rmse': float(np.sqrt((length**2).mean())),
            'held_out_p95': float(np.percentile(length, 95)),
            'inside_one_sigma': float((np.abs(residuals) <= sigma).mean()),
            'inside_two_sigma': float((np.abs(residuals) <= 2 * sigma).mean()),
            'groups': float(len(np.unique(choice.groups))),
            'rows': float(len(choice.x)),
            **{
                f'rmse_{"xyz"[c]}': float(np.sqrt((residuals[:, k] ** 2).mean()))
                for k, c in enumerate(self.columns)
            },
            **self.report_,
        }

    @property
    def title(self) -> str:
        """Target with the names of its components."""
        return f'{self.name}_{"".join("xyz"[i] for i in self.columns)}'

    @cached_property
    def places(self) -> Integers:
        """Where its components lie among x, y, z, shape (k,)."""
        return np.array(self.columns)

    def predict(
        self, x: Array, drivers: Array, noise: Array, shift: Array, far: Array
    ) -> tuple[Array, Array]:
        """Components and their covariance.

        Parameters
        ----------
        x : ndarray, shape (s, f)
            Features.
        drivers : ndarray, shape (s, 1 + d)
            Of `drive`, the same for all targets.
        noise, shift : ndarray, shape (s, k)
            What noise does, as in `calibrate`, and an error that is known, in `unit_`.
        far : ndarray, shape (s,)
            Of `outside.ends`.

        Returns
        -------
        mean, cov : ndarray, shape (s, k), (s, k, k)
            (Unit of the target, and squared.)
        """
        mean = (self.estimator_.predict(x) - shift) * self.unit_
        sigma = self.covariance_.sigma(drivers, noise) * self.unit_
        cov = sigma[:, :, None] * sigma[:, None, :] * self.covariance_.correlation_
        if np.count_nonzero(far > 1):
            cov = grown(cov, self.bend_ * self.unit_, far)
        return mean, cov

    def drive(self, x: Array) -> Array:
        """Logarithm of the signal's size, and features: what errors depend on, (s, 1 + d)."""
        drivers = np.empty((len(x), 1 + len(self.drivers)))
        strong = x[:, self.strength]
        size = np.sqrt(np.add.reduce(strong * strong, axis=1) / strong.shape[1])
        np.log(size + TINY, out=drivers[:, 0])
        drivers[:, 1:] = x[:, self.drivers]
        return drivers


def _clearly_better(choice: Selection, usual: Selection) -> bool:
    """Whether groups left out tell a choice from the usual estimator by more than chance.

    After the one-standard-error rule of Breiman et al., Classification and Regression Trees,
    1984, sec. 3.4.3, with two.
    """
    index = np.unique(choice.groups, return_inverse=True)[1].reshape(-1)
    size = [
        np.sqrt(np.bincount(index, (one.residuals**2).sum(axis=1)) / np.bincount(index))
        for one in (usual, choice)
    ]
    gain = size[0] - size[1]
    chance = gain.std() / np.sqrt(max(len(gain) - 1, 1))
    return bool(gain.mean() > SURE * chance or not np.isfinite(gain).all())


def _few_groups(groups: Integers) -> Integers:
    """Rows of whole groups, about `TRIED` of them."""
    if len(groups) <= TRIED:
        return np.arange(len(groups))
    names, counts = np.unique(groups, return_counts=True)
    if len(names) <= 20:  # few and large groups: some rows of each
        return np.arange(0, len(groups), -(-len(groups) // TRIED))
    order = np.random.default_rng(0).permutation(len(names))
    taken = names[order[np.cumsum(counts[order]) <= TRIED]]
    return np.flatnonzero(np.isin(groups, taken if len(taken) > 4 else names))
