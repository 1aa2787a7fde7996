"""Normal force of a touch from its place and the divider: which curve serves is chosen."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import nnls

from tactile_ros.estimators.covariance import SigmaCalibration, extrapolation_error
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import chosen, some_rows, trials, verdict
from tactile_ros.estimators.power_law_force import FilmResistance, MeanCurve, PowerLawForce
from tactile_ros.estimators.rbf_force import RbfForce
from tactile_ros.estimators.regression import ColumnSelector, KernelRidge, Ridge
from tactile_ros.estimators.smooth_fields import SmoothFields
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.resistive_sheet import SeriesResistance
from tactile_ros.sensors.five_wire_skin.contact_gate import CONSTANT
from tactile_ros.types import Array, Bools, Estimator, FrameStatus, Integers

STILL = 0.05  # of the touch's edge: moves that are noise
SECONDS_PER_NS = 1e-9
FORCE, X, Y, MEANS = 0, 1, 2, 3  # columns of what is kept


@compiled
def overlap(kept: Array, x: float, y: float, edge: float) -> float:
    """Share of a touch at a place with the one that is kept (3..), which follows it."""
    share = 1.0
    for i, now in ((X, x), (Y, y)):
        if math.isnan(kept[i]):
            kept[i] = now
        off = now - kept[i]
        beyond = max(abs(off) - STILL * edge, 0.0)
        share *= max(1.0 - beyond / edge, 0.0)
        kept[i] += math.copysign(beyond, off)
    return share


@compiled
def memory_rows(
    force: Array, places: Array, elapsed: Array, rates: Array, edge: float, kept: Array,
    means: Array,
) -> None:  # fmt: skip
    """Fill fading means (s, m) of forces (s,) at places (s, 2); what is kept (3 + m,) moves on.

    Parameters
    ----------
    force : ndarray, shape (s,)
        0 where nothing touches; NaN: unusable, the last one is held.
    places : ndarray, shape (s, 2)
        Of the touches (m); NaN, or where nothing touches: they do not count.
    elapsed : ndarray, shape (s,)
        Since the frame before (s); 0: not newer, not remembered; below 0: a stream begins.
    rates : ndarray, shape (m,)
        1 / time constants (1/s).
    edge : float
        Of a touch (m); infinite: the past counts wherever it was.
    """
    for s in range(len(force)):
        if elapsed[s] < 0.0:
            kept[:] = 0.0
        now = kept[FORCE] if math.isnan(force[s]) else force[s]
        if elapsed[s] < 0.0:
            kept[FORCE], kept[X], kept[Y] = now, math.nan, math.nan
        elif elapsed[s] > 0.0:
            share = 1.0
            # true of no NaN: a frame that was lost moves the touch nowhere
            if force[s] > 0.0 and math.isfinite(edge) and math.isfinite(places[s, 0]):
                share = overlap(kept, places[s, 0], places[s, 1], edge)
            for i in range(len(rates)):
                phase = rates[i] * elapsed[s]
                decay = math.exp(-phase)
                average = -math.expm1(-phase) / phase
                old = decay * kept[MEANS + i] + (average - decay) * kept[FORCE]
                kept[MEANS + i] = share * old + (1.0 - average) * now
            kept[FORCE] = now
        for i in range(len(rates)):
            means[s, i] = kept[MEANS + i]


class FilmCreep:
    """Fading means of one stream, one frame at a time or many with the same numbers.

    Parameters
    ----------
    time_constants : ndarray, shape (m,)
        Of the means (s).
    edge : float
        Of a touch (m); infinite: the past counts wherever it was.
    """

    def __init__(self, time_constants: Array, edge: float) -> None:
        self._rates, self._edge = 1.0 / time_constants, edge
        self.reset()

    def reset(self) -> None:
        """Forget the past: what came before counts as rest."""
        self._kept = np.zeros(MEANS + len(self._rates))
        self._newest_ns: int | None = None

    def __call__(self, force: Array, places: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """Means (s, m) after each frame, 0 at the first one of a stream.

        Parameters
        ----------
        force : ndarray, shape (s,)
            0 where nothing touches; NaN: unusable.
        places : ndarray, shape (s, 2)
            Of the touches (m).
        stamp_ns : ndarray, shape (s,)
            Acquisition times; a frame that is not newer than the last one is not remembered.
        restart : ndarray, shape (s,)
            Frames before which the past is forgotten.
        """
        means = np.empty((len(force), len(self._rates)))
        elapsed = self._elapsed(stamp_ns, restart)
        memory_rows(force, places, elapsed, self._rates, self._edge, self._kept, means)
        return means

    def _elapsed(self, stamp_ns: Integers, restart: Bools) -> Array:
        """Seconds (s,) since the newest frame before; 0: not newer, below 0: a stream begins."""
        elapsed, newest = np.empty(len(stamp_ns)), self._newest_ns
        for i, (now, begins) in enumerate(zip(stamp_ns.tolist(), restart.tolist(), strict=True)):
            if begins or newest is None:
                elapsed[i], newest = -1.0, now
            else:
                elapsed[i] = max(now - newest, 0) * SECONDS_PER_NS
                newest = max(now, newest)
        self._newest_ns = newest
        return elapsed


TIME_CONSTANTS = (0.3, 1.0, 4.0, 16.0, 64.0)
PENALTY = 1e-4
FOLDS = 5
WORTH = 0.97  # of the static error; creep that takes off less is none
DOUBT = 0.15  # of what is taken off: no two places of a film creep alike
MOST = 0.5  # of a static force that its past can hold


class Creep:
    """Force from a static force and fading means of it.

    Attributes
    ----------
    root_ : ndarray, shape (m + 1, m + 1)
        Square root of the covariance of the shares, from places that were left out.
    edge : float
        Of a touch (m), where the past counts by place; infinite: wherever it was.
    """

    shares_: Array  # (m + 1,) of the means, and of the static force itself; 0 where creep is none
    root_: Array
    forgets_: bool  # whether a mean never counts for more than the force now
    error_: float  # root mean square error (N) at places that were not learned from
    left_: float  # that of the rows learned from

    def __init__(self, edge: float = np.inf) -> None:
        self.edge = edge

    def start(self) -> FilmCreep:
        """Fresh memory of a stream."""
        return FilmCreep(np.array(TIME_CONSTANTS), self.edge)

    def fit(self, static: Array, means: Array, told: Array, groups: Integers) -> Creep:
        """Learn shares.

        Parameters
        ----------
        static : ndarray, shape (s,)
            Forces of a static curve (N).
        means : ndarray, shape (s, m)
            Their fading means (N).
        told : ndarray, shape (s,)
            True forces (N).
        groups : ndarray of int, shape (s,)
            What a split keeps together.
        """
        error = static - told
        fold = np.unique(groups, return_inverse=True)[1].reshape(-1) % FOLDS
        self.error_, self.forgets_ = WORTH * float(np.sqrt((error**2).mean())), False
        self.shares_ = np.zeros(means.shape[1] + 1)
        for forgets in (False, True):
            terms = _terms(static, means, forgets)
            left = np.empty(len(error))
            for part in range(FOLDS):
                held = fold == part
                seen = ~held if (~held).any() else held
                left[held] = error[held] - terms[held] @ _solve(terms[seen], error[seen])
            size = float(np.sqrt((left**2).mean()))
            if size < self.error_:
                self.error_, self.forgets_ = size, forgets
                self.shares_ = _solve(terms, error)
        terms = _terms(static, means, self.forgets_)
        self.left_ = float(np.sqrt(((error - terms @ self.shares_) ** 2).mean()))
        self.root_ = _jackknife(terms, error, groups) if self.is_any else np.zeros_like(terms[:1])
        return self

    @property
    def is_any(self) -> bool:
        """Whether there is creep to take off."""
        return bool(self.shares_.any())

    @property
    def most(self) -> float:
        """Share of a static force that a hold without end adds, and a release leaves."""
        return 0.0 if self.forgets_ else float(self.shares_[:-1].sum())

    def past(self, static: Array, means: Array) -> tuple[Array, Array]:
        """What of a static force (s,) is of its past (N), from its fading means; its variance."""
        terms = _terms(static, means, self.forgets_)
        # no product of matrices: its sums run otherwise for one frame than for many
        past = np.asarray(np.einsum('sm,m->s', terms, self.shares_))
        off = np.einsum('sm,km->sk', terms, self.root_)
        return past, (DOUBT * past) ** 2 + np.einsum('sk,sk->s', off, off)

    def bounded_past(self, static: Array, means: Array) -> Array:
        """The same, never more than half of the static force (N)."""
        return np.clip(self.past(static, means)[0], -MOST * static, MOST * static)


def _terms(static: Array, means: Array, forgets: bool) -> Array:
    """What shares are of (s, m + 1): fading means, and the static force itself."""
    terms = np.empty((len(means), means.shape[1] + 1))
    terms[:, :-1] = np.minimum(means, static[:, None]) if forgets else means
    terms[:, -1] = static
    return terms


def _solve(terms: Array, error: Array) -> Array:
    """Ridge solution, with a penalty that knows the size of the terms; no past takes off."""
    return _shares(terms.T @ terms, terms.T @ error)


def _jackknife(terms: Array, error: Array, groups: Integers) -> Array:
    """Root (n, m) of the covariance of shares, from fits without each group."""
    gram, cross = terms.T @ terms, terms.T @ error
    found = []
    for group in np.unique(groups):
        own = terms[groups == group]
        found.append(_shares(gram - own.T @ own, cross - own.T @ error[groups == group]))
    apart = np.array(found) - np.mean(found, axis=0)
    return np.asarray(np.linalg.qr(apart, mode='r'))


def _shares(gram: Array, cross: Array) -> Array:
    """Shares (m,) from sums of products (m, m) of terms, and of terms and errors (m,)."""
    gram = gram.copy()
    gram[np.diag_indices_from(gram)] += PENALTY * (np.trace(gram) / len(gram) + 1e-12)
    root = np.linalg.cholesky(gram)
    wanted = np.linalg.solve(root, cross)
    both = np.column_stack([root.T, -root.T[:, -1]])
    found = nnls(both, wanted)[0]
    return np.asarray(np.append(found[:-2], found[-2] - found[-1]))


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
    """

    most_: float = np.inf  # largest force that was told (N)
    estimator_: Estimator  # fitted on all rows
    spread_: SigmaCalibration  # scale of its spread, measured on held-out places
    level_: Array  # (1,) spread of an estimator that states none (N)
    report_: dict[str, float]  # errors on held-out places (N)

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
        if isinstance(self.estimator_, PowerLawForce):
            return self.estimator_.force(x)
        force = self.estimator_.predict(x)[:, 0]
        spread = np.broadcast_to(self.level_, (len(x), 1))
        return force, self.spread_(spread)[:, 0]

    def at(self, x: Array, places: Array, resistance: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) and spreads of their errors (s,) (N) for the columns of features."""
        if isinstance(self.estimator_, PowerLawForce):
            return self.estimator_.at(places, resistance)
        return self.predict(features_of(x, places, resistance))

    def unsure(self, force: Array, spread: Array) -> tuple[Array, Integers] | None:
        """Spreads (s,) (N) and status of forces (s,), some of them larger than any that was told.

        None: there is no such force. What lies beyond is unsure by half, and an answer at the end
        of all answers by itself: the force may be any larger one.
        """
        error = extrapolation_error(force, self.most_)
        if error is None:
            return None
        beyond = error > 0
        part = np.where(force > LARGEST * self.most_, force, error)
        wider = np.where(beyond, np.hypot(spread, part), spread)
        return wider, beyond * np.int64(FrameStatus.OUT_OF_RANGE)

    def tighten(self, factor: float) -> None:
        """Let errors at known places be smaller by a factor, as they are without creep."""
        if isinstance(self.estimator_, PowerLawForce):
            self.estimator_.scale_scatter(factor)
        else:
            self.spread_.factors_ += np.log(factor)

    def _candidates(self, wanted: str | None) -> dict[str, Estimator]:
        """Estimators to choose from."""
        network: Estimator = ColumnSelector(RbfForce(), np.array([0, 1, 2]))
        if wanted == 'printed':
            return {'rbf': network}
        known: dict[str, Estimator] = {
            'power': PowerLawForce(self.noise, self.size, self.series),
            'rbf': network,
            'rbf_log': ColumnSelector(RbfForce(), np.array([0, 1, 6])),
            'mean_curve': MeanCurve(6),
            'ridge': ColumnSelector(Ridge(), np.array([3, 4, 5])),
            'kernel_ridge': ColumnSelector(
                KernelRidge(length=0.4, linear=1.0, strengths=(1e-6,), common=10.0),
                np.array([3, 4, 5]),
            ),
            'grid_knn': ColumnSelector(GridKnn(), np.array([3, 4, 5])),
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
    ColumnSelector,
    PowerLawForce,
    FilmResistance,
    SeriesResistance,
    SmoothFields,
    RbfForce,
    MeanCurve,
    Ridge,
    KernelRidge,
    GridKnn,
    SigmaCalibration,
)
