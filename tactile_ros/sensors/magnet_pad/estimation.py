"""Cell, place and force of a touch: inversion of the pad's response, regressors, neighbours.

Where truth has places, the response of the pad is fitted to the recording (`body_model`), and a
table of touches, spread like the recorded ones and thinly everywhere else, answers readings by
Gauss-Newton steps (`estimators.gaussian_sum_table`), unless the neighbours of [2] err less on
held-out groups. Without truth the table is that of the config's pad. Everything else is regressed.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.conditioning.baseline import training_baseline_variance
from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.gaussian_sum_table import Linearised, TouchEstimate, TouchPosterior
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.regression import group_folds
from tactile_ros.physics.fidelity import Choice, Rated, Worth
from tactile_ros.sensors.magnet_pad.body_model import (
    EDGE,
    LEAST_NOISE,
    NOISE,
    STRAY,
    PadResponse,
    ResponseResidual,
    Specimens,
    change_of_field,
    field_choice,
    places_and_forces,
    terms,
    touches_at,
    uniform_response,
)
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.temperature import ThermalDrift, noise_of_rest
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSORS
from tactile_ros.sensors.regression import Recognition, places_of
from tactile_ros.types import Array, Bools, FrameStatus, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.types import Columns, Report, SensorConfig, Signals

NOMINAL, TABLE = 'nominal', 'table_gauss_newton'
ESTIMATORS = (*REGRESSORS, TABLE, NOMINAL)
SEED = 19
COUNT, NOMINAL_COUNT = 30_000, 8000  # touches of a table
EVEN = 0.2  # share of touches that are spread evenly
STEP = 1e-3  # radii and rad, over which readings are differentiated
UNITS = np.array([1.0, 1.0, 0.5, 1.0, 1.0])  # of a touch, that count as a radius
NEAR = 6  # neighbour whose distance is the extent of a touch
EXTENT = (0.005, 0.3)  # radii, least and largest
FOLDS, FEWEST, FEWEST_SESSIONS = 4, 50, 3
LEANING = 0.03  # tangential over normal force, from which touches lean
UPRIGHT = 0.1  # sigma of a force along the axis, over the force, where none leaned
FLOOR = np.repeat([1e-6, 1e-4], 3) ** 2  # m2, N2: errors of truth itself
FAR = 1.5  # times the distance of known readings, from which a stray field is thought of
CONTACT, SIGMAS = 0.4, 5.0  # of the lightest recorded touch; of the noise
MARGIN = 1.1  # times the recorded forces: beyond them by chance
FIELDS = 3.0  # times the usual, of a component of a stray field
POINTS = np.random.default_rng(5).normal(size=(64, 2))
OUT_OF_RANGE, STRAY_FIELD = int(FrameStatus.OUT_OF_RANGE), int(FrameStatus.STRAY_FIELD)
NOTHING = 0.5  # of the spread of places over the pad: an uncertain place is not valid


def touch_table(
    response: Callable[[Array], Array], touches: Array, variance: Callable[[Array], Array],
    radius: float, freedoms: int,
) -> Linearised:  # fmt: skip
    """Touches (n, 5) of a response (T) with slopes; `variance` (n,) (T2) is that of a channel."""
    spots = touches / UNITS * np.array([1 / radius, 1.0, 1.0, 1.0, 1.0])
    extent = cKDTree(spots).query(spots, k=[min(NEAR + 1, len(spots))])[0][:, 0]
    extent = np.clip(extent, *EXTENT)

    def answers(at: Array) -> Array:
        return np.column_stack([places_and_forces(at, radius), response(at)])

    level, leads = answers(touches), []
    for unit in np.diag(UNITS * np.array([radius, 1.0, 1.0, 1.0, 1.0]))[:freedoms]:
        leads.append((answers(touches + STEP * unit) - level) / STEP * extent[:, None])
    lead = np.stack(leads, axis=-1)
    sigma = np.sqrt(variance(level[:, 6:]))
    share = np.full(len(touches), 1 / len(touches))
    return Linearised(level[:, 6:], lead[:, 6:], level, lead, sigma, share)


def likely_touches(config: MagnetPadConfig, known: Array, count: int) -> Array:
    """Touches (n, 5) drawn like known ones (s, 5), and some evenly over the pad and its loads.

    Known touches are blurred by the distances of their places (Parzen, Ann. Math. Stat. 33, 1962).
    """
    rng = np.random.default_rng(SEED)
    unit = UNITS * np.array([config.radius, 1.0, 1.0, 1.0, 1.0])
    place = (known / unit)[:, :2]
    gap = cKDTree(place).query(place, k=[min(5, len(known))])[0][:, 0]
    pick = rng.integers(0, len(known), count)
    blur = np.full((count, 5), 0.2)
    blur[:, :2] = np.clip(0.5 * gap, EXTENT[0], 0.2)[pick, None]
    drawn = known[pick] + blur * rng.normal(size=(count, 5)) * unit
    free, last = int(EVEN * count), known[:, 2].max() + 0.8
    # at least a decade and a half of loads
    first = min(known[:, 2].min() - 1.6, last - 4.7)
    drawn[:free] = even_touches(config, free, rng, (first, last))
    drawn[:free, 3:] = known[pick[:free], 3:]
    low = np.array([-config.length / 2, np.arccos(EDGE), first])
    high = np.array([config.length / 2, np.pi - np.arccos(EDGE), last])
    drawn[:, :3] = np.clip(drawn[:, :3], low, high)
    drawn[:, 3:] *= (known[:, 3:] ** 2).mean() > LEANING**2
    return np.asarray(drawn)


def even_touches(
    config: MagnetPadConfig, count: int, rng: np.random.Generator, loads: tuple[float, float]
) -> Array:
    """Touches (n, 5) along the normal, even over the pad, of logarithms of loads in a range."""
    along = config.length * (rng.uniform(size=count) - 0.5)
    around = np.arccos(EDGE * rng.uniform(-1, 1, count))
    upright = np.zeros((count, 2))
    return np.column_stack([along, around, rng.uniform(*loads, count), upright])


class PadInversion:
    """Touches from readings.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.
    live : ndarray of bool, shape (c,)
        Channels that are alive; the d of them are the features.
    noise : float
        Of a channel (T).

    Attributes
    ----------
    response_ : PadResponse or None
        Fitted; None: that of the config.
    touches_ : ndarray, shape (n, 5)
        Recorded ones.
    radius_ : float
        Of the surface on which places lie (m).
    scatter_ : float
        Residual of the response over the readings, beside the noise.
    misfit_ : float
        That most touches leave.
    contact_ : float
        Channel less a uniform field, beyond which something touches (T).
    span_ : ndarray, shape (2,)
        Least and largest recorded force (N); NaN: none.
    covariance_ : CovarianceModel or None
        Of place and force.
    report_ : dict
        Errors on held-out groups, and those of the neighbours of [2].
    """

    RIGHT = 0.06  # of a reading: error of the config's pad
    LOADS = (0.01, 0.6)  # of shear modulus times the square of the radius
    TIPS, BONDS, LEAN = (0.05, 0.7), (-0.8, 1.6), 0.5  # radii; shares; rad
    SPECIMENS, EACH = 40, 40

    def __init__(self, config: MagnetPadConfig, live: Bools, noise: float) -> None:
        self.config, self.live, self.noise = config, live, max(noise, LEAST_NOISE)
        self.response_: PadResponse | None = None
        self.touches_, self.radius_, self.scatter_ = np.zeros((0, 5)), config.radius, self.RIGHT
        self.misfit_, self.contact_ = float(live.sum()), SIGMAS * self.noise
        self.span_ = np.full(2, np.nan)
        self.covariance_: CovarianceModel | None = None
        self.report_: Report = {}

    @property
    def common(self) -> Array | None:
        """Change of the features (d, 3) with a uniform field; None: no unknown of the scene."""
        chips = self.live.reshape(-1, 3)
        if chips.any(axis=1).sum() < 2 or not self.config.stray_term:
            return None
        return uniform_response(self.config)[self.live]

    # -- from the config alone ------------------------------------------------------------------

    def _draw(self, count: int, seed: int) -> tuple[Array, Array, Array]:
        """Touches (n, 5) of all kinds, tips (radii) and holds of the base."""
        rng = np.random.default_rng(seed)
        size = self.config.shear_modulus * self.config.radius**2
        first, last = (float(np.log(share * size)) for share in self.LOADS)
        touches = even_touches(self.config, count, rng, (first, last))
        lean = np.tan(self.LEAN * rng.uniform(size=count)) * (rng.uniform(size=count) > 0.75)
        turn = rng.uniform(0, 2 * np.pi, count)
        touches[:, 3], touches[:, 4] = lean * np.cos(turn), lean * np.sin(turn)
        bond = np.clip(rng.uniform(*self.BONDS, count), 0.0, 1.0)
        return touches, rng.uniform(*self.TIPS, count), bond

    def _nominal_rows(self) -> Linearised:
        touches, tip, bond = self._draw(NOMINAL_COUNT, SEED)
        nodes = field_choice(self.config, touches, self.noise).size[0]

        def response(at: Array) -> Array:
            field = change_of_field(self.config, at, tip, bond, nodes)
            return field.reshape(len(at), -1)[:, self.live]

        return touch_table(response, touches, self.variance, self.radius_, 3)

    def _specimens(self) -> tuple[Array, Array, Integers]:
        """Readings, true places and forces, and numbers of specimens."""
        size = self.LOADS[1] * self.config.shear_modulus * self.config.radius**2
        pad, parts = Specimens(self.config, size), []
        for seed in range(self.SPECIMENS):
            rng = np.random.default_rng(seed)
            touches = self._draw(self.EACH, seed)[0]
            parameters = rng.normal(size=pad.count)
            parameters[2] *= 0.6  # a stiffness that follows from a hardness
            x = pad(touches, parameters)[:, self.live]
            true = places_and_forces(touches, self.radius_)
            parts.append((x + self.noise * rng.normal(size=x.shape), true))
        readings, true = (np.concatenate(part) for part in zip(*parts, strict=True))
        return readings, true, np.repeat(np.arange(self.SPECIMENS), self.EACH)

    # -- from a recording -----------------------------------------------------------------------

    def fit(self, touches: Array, x: Array, groups: Integers, radius: float) -> PadInversion:
        """Learn from readings x (s, d) (T) of touches (s, 5) on a cylinder of `radius` (m)."""
        order = np.lexsort(np.column_stack([x, touches]).T[::-1])
        touches, x, groups = touches[order], x[order], groups[order]
        self.touches_, self.radius_ = touches, radius
        leaning = bool((touches[:, 3:] ** 2).mean() > LEANING**2)
        self.response_ = self._response(touches, x, np.ones(len(x), bool), leaning)
        _, first, index = np.unique(groups, return_index=True, return_inverse=True)
        rank = np.empty(len(first), np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        fold = group_folds(rank[index.reshape(-1)], FOLDS, seed=0)
        self._validate(touches, x, groups, fold)
        remains = x if self.common is None else self._less_uniform(x)
        lightest = float(np.quantile(np.abs(remains).max(axis=1), 0.01))
        self.contact_ = max(SIGMAS * self.noise, CONTACT * lightest)
        force = np.exp(touches[:, 2]) * np.sqrt(1 + (touches[:, 3:] ** 2).sum(axis=1))
        self.span_ = np.array([force.min(), force.max()])
        return self

    def _response(self, touches: Array, x: Array, rows: Bools, leaning: bool) -> PadResponse:
        """Response by some rows (s,), which begins at that of all."""
        start = None if self.response_ is None else self.response_.parameters_
        response = PadResponse(self.config, self.live, leaning=leaning)
        response.fit(touches[rows], x[rows], self.noise, start, 6 if start is None else 2)
        residual = ResponseResidual(response, touches[rows], x[rows], self.noise)
        return response.learned(residual)

    def _validate(self, touches: Array, x: Array, groups: Integers, fold: Integers) -> None:
        """Errors on groups of which neither the response nor the table has learned."""
        assert self.response_ is not None
        answers = places_and_forces(touches, self.radius_)
        mean, cov, peer = np.empty_like(answers), np.empty((len(x), 6, 6)), np.empty_like(answers)
        left, misfit, tables = np.empty(len(x)), np.empty(len(x)), []
        every = [fold == part for part in range(int(fold.max()) + 1)]
        for held in every:
            seen = ~held if not held.all() else held
            way = self._response(touches, x, seen, self.response_.leaning)
            left[held] = self._unexplained(way, touches[held], x[held])
            tables.append((held, seen, way))
            peer[held] = GridKnn().fit(x[seen], answers[seen]).predict(x[held])
        self.scatter_ = self._scatter(x, left)
        self.misfit_ = np.inf
        for held, seen, way in tables:
            rows = self._rows(way, touches[seen], COUNT // 2)
            table = TouchPosterior(rows, None, STRAY, 0.0, self.noise, np.inf)
            found = table(x[held], np.zeros((1, 3)))
            mean[held], cov[held], misfit[held] = found.mean, found.cov, found.misfit
        self.misfit_ = max(float(np.quantile(misfit, 0.95)), 1.0)
        cov *= np.maximum(misfit / self.misfit_, 1.0)[:, None, None]
        error, stated = mean - answers, cov + np.diag(FLOOR)
        self.covariance_ = CovarianceModel().fit(error, stated, groups, x)
        sigma = np.sqrt(np.diagonal(self.covariance_.predict(stated, x)[0], axis1=1, axis2=2))
        for target, part in (('position', slice(0, 3)), ('force', slice(3, 6))):
            away, other = (np.linalg.norm(e[:, part], axis=1) for e in (error, peer - answers))
            self.report_[target] = {
                'held_out_mean': float(away.mean()),
                'held_out_rmse': float(np.sqrt((away**2).mean())),
                'inside_one_sigma': float((np.abs(error) <= sigma)[:, part].mean()),
                'groups': float(len(np.unique(groups))),
                'rows': float(len(x)),
                f'rmse_{TABLE}': float(np.sqrt((away**2).mean())),
                'rmse_grid_knn': float(np.sqrt((other**2).mean())),
            }

    def _unexplained(self, response: PadResponse, touches: Array, x: Array) -> Array:
        """Mean square (s,) (T2) of what no touch near the reference ones explains of readings.

        Errors of the references, such as those of a load cell's gain, are none of the response.
        """
        freedoms = 5 if response.leaning else 3
        near = touch_table(response, touches, self.variance, self.radius_, freedoms)
        across = np.linalg.qr(near.slopes)[0]
        left = (x - near.readings)[:, :, None]
        left = left - across @ (across.transpose(0, 2, 1) @ left)
        return np.asarray((left * left).sum(axis=(1, 2)) / max(x.shape[1] - freedoms, 1))

    def _scatter(self, x: Array, left: Array) -> float:
        """Residuals over the readings, beside the noise, of most rows; squares (s,) (T2)."""
        size, excess = (x * x).mean(axis=1), left - self.noise**2
        ratio = float(np.median(excess / np.maximum(size, self.noise**2)))
        mean = float(excess.mean() / size.mean())
        return float(np.sqrt(np.clip(max(ratio, 0.5 * mean), 1e-4**2, 0.3**2)))

    def variance(self, readings: Array) -> Array:
        """Variance (s,) (T2) of a channel of readings (s, d) about their touch."""
        return np.asarray(self.noise**2 + self.scatter_**2 * (readings**2).mean(axis=1))

    def _rows(self, response: PadResponse, known: Array, count: int) -> Linearised:
        """Touches of a table with their readings."""
        touches = likely_touches(self.config, known, count)
        freedoms = 5 if response.leaning else 3
        return touch_table(response, touches, self.variance, self.radius_, freedoms)

    # -- use ------------------------------------------------------------------------------------

    @cached_property
    def posterior(self) -> TouchPosterior:
        """Table of touches that answers readings."""
        rows = self._nominal_rows() if self.response_ is None else self._rows(
            self.response_, self.touches_, COUNT
        )
        # the part of the chips' gains that both have counts as field
        entry = 0.5 * self.config.gain_spread
        return TouchPosterior(rows, self.common, STRAY, entry, self.noise, self.misfit_)

    @cached_property
    def covariance(self) -> CovarianceModel:
        """Covariance of the answers; of the config's pad by specimens that differ from it."""
        if self.covariance_ is not None:
            return self.covariance_
        x, true, specimen = self._specimens()
        found = self.posterior(x, self.config.cells)
        stated = found.cov + np.diag(FLOOR)
        return CovarianceModel().fit(found.mean - true, stated, specimen, x)

    def _less_uniform(self, x: Array) -> Array:
        """Readings (s, d) without the uniform field that is nearest to them."""
        assert self.common is not None
        return np.asarray(x - x @ np.linalg.pinv(self.common).T @ self.common.T)

    def invert(self, x: Array, cells: Array) -> tuple[TouchEstimate, Array, Bools]:
        """Touches of finite readings x (s, d) (T) and cells (n, 3) (m); covariance, out of range.

        The covariance (s, 6, 6) is of place (m) and force (N).
        """
        found = self.posterior(x, cells)
        touch = x
        if found.cause.any():
            assert self.common is not None
            touch = x - np.matmul(found.cause[:, None], self.common.T)[:, 0]
        cov, beyond = self.covariance.predict(found.cov + np.diag(FLOOR), touch)
        return found, cov, beyond


class Localisation(Recognition):
    """Estimation of the magnet pad.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`; None: chosen in `fit`.

    Attributes
    ----------
    inversion_ : PadInversion or None
        Of the pad of the recording, or of the config.
    inverted_ : tuple of str
        Targets that it answers.
    flat_ : bool
        Whether the nearest cell is that seen from above.
    centred_ : bool
        Whether places are centres of cells, since truth has nothing else.
    known_, named_ : ndarray, shape (n, c) and (n,)
        Readings (T) of touches and their cells, where truth has nothing else.
    drift_ : ThermalDrift
        Of the resting field.
    """

    uses_temperature = True

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        assert isinstance(config, MagnetPadConfig)
        super().__init__(config, estimator if estimator in REGRESSORS else None)
        self.config, self.wanted = config, estimator
        self.centred_ = self.flat_ = False
        self.drift_, self.tare_variance_, self.noise_ = ThermalDrift(), 0.0, 0.0
        self.inversion_: PadInversion | None
        self.inverted_: tuple[str, ...]
        self.terms_: tuple[Worth, ...]
        self._begin()
        if estimator not in (None, NOMINAL):
            self.inversion_, self.inverted_ = None, ()

    def _begin(self) -> None:
        """Let the config's pad answer, and forget regressors."""
        self.heads_, self.remembering_, self.votes_, self.turn_ = (), (), (), None
        self.slip_, self.centred_, self.terms_ = None, False, ()
        self.known_, self.named_ = np.zeros((0, self.width)), np.zeros(0, np.int64)
        for name in ('_best', '_voters'):
            vars(self).pop(name, None)
        noise = NOISE if self.config.noise is None else float(np.max(self.config.noise))
        self.inversion_ = PadInversion(self.config, np.ones(self.width, bool), noise)
        self.inverted_ = ('position', 'force', 'cell')

    @property
    def nominal_(self) -> bool:
        """Whether the config's pad answers."""
        return self.inversion_ is not None and self.inversion_.response_ is None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        name = NOMINAL if self.nominal_ else TABLE
        known = {**super().estimators, **dict.fromkeys(self.inverted_, name)}
        return {**known, 'cell': 'nearest_centre'} if self._names_cells(known) else known

    def _names_cells(self, known: Columns | dict[str, str]) -> bool:
        """Whether places name the cells, since nothing else does."""
        free = self.wanted is None and not self.centred_
        return free and 'position' in known and 'cell' not in known

    @property
    def report(self) -> Report:
        """Errors on held-out groups, the specimen, and terms of the scene."""
        found = {**super().report, **self.drift_.report}
        if self.inversion_ is None:
            return found
        response, span = self.inversion_.response_, self.inversion_.span_
        found |= self.inversion_.report_
        if response is None:
            return found
        found |= {'pad': response.report, **response.choice_.report}
        ends = {'least': float(span[0]), 'most': float(span[1])}
        found['not told: loads beyond those recorded (N)'] = ends
        for term in self.terms_:
            found |= term.report
        return found

    def begin_fit(self) -> None:
        """Begin with magnets of neodymium, whatever was learned before."""
        self.drift_ = ThermalDrift()

    def thermal_drift(
        self, baseline: Array, reference_c: Array, temperature_c: Array | None
    ) -> Array:
        """Change of baselines with the temperature of the chips."""
        return self.drift_.change(baseline, reference_c, temperature_c)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth has a component; see `Regression`."""
        signals, truth = self.drift_.fit(signals).corrected(signals), _touched_only(truth)
        self.noise_ = noise_of_rest(signals)
        good, variance = signals.good, signals.baseline_variance
        self.tare_variance_ = training_baseline_variance(
            signals.baseline[good], None if variance is None else variance[good]
        )
        named = [k for k in ('position', 'force', 'cell', 'torque', 'label', 'yaw') if k in truth]
        stated = any(_measured(truth[k])[good].any() for k in named)
        self._begin()
        if self.wanted == NOMINAL or (self.wanted is None and not stated):
            return
        inversion: PadInversion | None = None
        answered: tuple[str, ...] = ()
        if self.wanted in (None, TABLE):
            inversion = self._inverted(signals, truth, groups)
        if inversion is not None:
            report = inversion.report_
            answered = tuple(
                k for k in report
                if self.wanted == TABLE or report[k][f'rmse_{TABLE}'] < report[k]['rmse_grid_knn']
            )
            if 'position' in answered and self._cells_are_places(truth, signals.good):
                answered += ('cell',)
            self.terms_ = terms(self.config, inversion.noise)
        self.inversion_, self.inverted_ = inversion if answered else None, answered
        if self.wanted != TABLE and not {'position', 'force'} <= {*answered}:
            self._regress(signals, {k: v for k, v in truth.items() if k not in answered}, groups)

    def _regress(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn what the inversion does not answer; a cell alone is a place, its centre."""
        cells = np.asarray(truth.get('cell', np.full(len(signals.good), -1)), np.int64)
        place = np.asarray(truth.get('position', np.full((len(cells), 3), np.nan)), np.float64)
        known = signals.good & (cells >= 0)
        fits = known.any() and cells.max() < len(self.config.cells)
        self.centred_ = bool(fits and not np.isfinite(place[signals.good]).any())
        if self.centred_ and 'position' not in self.inverted_:
            place = np.where(known[:, None], self.config.cells[cells], np.nan)
            truth = {**truth, 'position': place}
            chips = signals.delta[signals.good].any(axis=(0, 2))
            if chips.sum() > 1 and self.config.stray_term:
                self.known_ = signals.delta.reshape(len(cells), -1)[known]
                self.named_ = cells[known]
        super().fit(signals, truth, groups)

    def _cells_are_places(self, truth: Columns, good: Bools) -> bool:
        """Whether the nearest centre is the cell of truth, in space or as seen from above."""
        if 'cell' not in truth:
            return True
        cells, place = np.asarray(truth['cell'], np.int64), np.asarray(truth['position'], float)
        rows = good & (cells >= 0) & np.isfinite(place).all(axis=1)
        right = [
            float((nearest(place[rows, :k], self.config.cells[:, :k]) == cells[rows]).mean())
            for k in (3, 2)
        ] if rows.any() else [1.0, 0.0]  # fmt: skip
        self.flat_ = right[1] > right[0]
        return max(right) > 0.9

    def _inverted(self, signals: Signals, truth: Columns, groups: Columns) -> PadInversion | None:
        """Fit to the recording, where truth has places and forces on the surface."""
        blank = np.full((len(signals.good), 3), np.nan)
        place, force = (np.asarray(truth.get(k, blank), np.float64) for k in ('position', 'force'))
        rows = signals.good & np.isfinite(place).all(axis=1) & np.isfinite(force).all(axis=1)
        x = signals.delta.reshape(len(rows), self.width)[rows]
        place, force = place[rows], force[rows]
        live = np.asarray(np.abs(x).max(axis=0, initial=0.0) > 0)
        if len(x) < FEWEST or live.sum() < 3 or not _on_surface(self.config, place, force):
            return None
        session = np.asarray(groups['session'], np.int64)[rows]
        repeated = None if 'repetition' in truth else places_of(place)
        if len(np.unique(session)) >= FEWEST_SESSIONS:
            group = session
        else:
            group = np.asarray(groups['group'], np.int64)[rows] if repeated is None else repeated
        inversion = PadInversion(self.config, live, self.noise_)
        radius = float(np.median(np.hypot(place[:, 1], place[:, 2])))
        return inversion.fit(touches_at(place, force), x[:, live], group, radius)

    # -- use ------------------------------------------------------------------------------------

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Contact (s,): a uniform field that came after the tare does not touch."""
        contact, inversion = signals.in_contact, self.inversion_
        rows = np.flatnonzero(contact == 1)
        if inversion is None or inversion.common is None or not len(rows):
            return contact
        x = signals.delta.reshape(len(contact), self.width)[rows][:, inversion.live]
        touching = inversion.posterior.touching(x, inversion.contact_)
        changed = contact.copy()
        changed[rows] = touching
        return changed

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        status = self.drift_.out_of_range(signals) * OUT_OF_RANGE
        if self.inversion_ is not None:
            status |= self._add_inverted(known, signals, self.inversion_)
        if self.centred_:
            known['position_cov'] = known['position_cov'] + np.diag(extent(self.config.cells))
            if len(self.known_):
                self._vote_beside_field(known, signals)
        elif self._names_cells(known):
            place, cov = (np.asarray(known[k], float) for k in ('position', 'position_cov'))
            known['cell'], known['cell_probability'] = named_cells(place, cov, self.config.cells)
        if np.count_nonzero(status):
            known['status'] = status
        return known

    def _vote_beside_field(self, known: Columns, signals: Signals) -> None:
        """Name cells by what chips differ in, where a reading is unlike all known ones."""
        tree, limit, voters, free = self._voters
        x = signals.delta.reshape(len(signals.good), self.width)
        rows = np.flatnonzero(np.isfinite(x).all(axis=1) & (signals.in_contact != 0))
        rows = rows[tree.query(x[rows])[0] > limit]
        if len(rows):
            shares = voters.predict(np.matmul(x[rows, None], free)[:, 0])
            cells = np.unique(self.named_)[shares.argmax(axis=1)]
            known['cell'][rows], known['cell_probability'][rows] = cells, shares.max(axis=1)
            known['position'][rows] = self.config.cells[cells]

    @cached_property
    def _voters(self) -> tuple[cKDTree, float, GridKnn, Array]:
        """Known touches, how far apart they usually are, and neighbours without uniform fields."""
        tree, common = cKDTree(self.known_), uniform_response(self.config)
        usual = float(np.quantile(tree.query(self.known_, k=[2])[0], 0.995))
        free = np.eye(self.width) - common @ np.linalg.pinv(common)
        shares = (self.named_[:, None] == np.unique(self.named_)).astype(np.float64)
        return tree, FAR * usual, GridKnn().fit(self.known_ @ free, shares), free

    def _add_inverted(
        self, known: Columns, signals: Signals, inversion: PadInversion
    ) -> Integers:
        """Add what the inversion answers; return the status (s,)."""
        every = signals.delta.reshape(len(signals.good), self.width)[:, inversion.live]
        rows = np.flatnonzero(np.isfinite(every).all(axis=1))
        x, status = every[rows], np.zeros(len(every), np.int64)
        found, cov, beyond = inversion.invert(x, self._centres)
        self._add_baseline_noise(cov, found.mean, signals, inversion, rows, x)
        force, rest = found.mean[:, 3:], signals.in_contact[rows] == 0
        square = np.add.reduce(force * force, axis=1)
        if np.count_nonzero(rest):
            # a load that is too light to be felt is reported as 0
            cov[rest, 3:, 3:] += force[rest, :, None] * force[rest, None, :]
            if inversion.common is not None:
                field = inversion.posterior.cause(x[rest])[0]
                felt = np.abs(field).max(axis=1, keepdims=True) > SIGMAS * inversion.noise
                found.cause[rest] = np.where(felt, field, 0.0)
        if inversion.response_ is not None and not inversion.response_.leaning:
            cov[:, 3, 3] += UPRIGHT**2 * square
        columns: Columns = {
            'position': found.mean[:, :3], 'position_cov': cov[:, :3, :3],
            'force': force, 'force_cov': cov[:, 3:, 3:],
            'cell': found.shares.argmax(axis=1), 'cell_probability': found.shares.max(axis=1),
        }  # fmt: skip
        answered = {k: v for k, v in columns.items() if k.split('_')[0] in self.inverted_}
        if inversion.common is not None:
            answered['stray_field'] = found.cause
        for name, column in answered.items():
            known[name] = column if len(rows) == len(every) else _filled(column, rows, len(every))
        odd = found.misfit > inversion.posterior.unlike * inversion.misfit_
        strong = odd | (np.abs(found.cause) > FIELDS * STRAY).any(axis=1)
        least, most = (inversion.span_ * (1 / MARGIN, MARGIN)) ** 2
        beyond = ~rest & (beyond | (square < least) | (square > most))
        status[rows] = beyond * OUT_OF_RANGE | (strong & (odd <= ~rest)) * STRAY_FIELD
        if np.count_nonzero(odd):
            valid = np.ones(len(every), bool)
            wide = cov[:, 0, 0] > (NOTHING * self.config.length) ** 2 / 12
            valid[rows] = rest | ~(odd & wide)
            known['valid'] = valid
        return status

    def _add_baseline_noise(
        self, cov: Array, mean: Array, signals: Signals, inversion: PadInversion, rows: Integers,
        x: Array,
    ) -> None:  # fmt: skip
        """Add to covariances (r, 6, 6) the noise of tares and uncertain temperatures, in place."""
        own = signals.baseline_variance
        if own is not None and np.count_nonzero(own):
            tares = np.where(own > 0, own + self.tare_variance_, 0.0)[rows]
            share = inversion.noise**2 / inversion.variance(x)
            cov *= (1 + tares * share)[:, None, None]
        warm, sigma = self.drift_.uncertainty(signals, inversion.noise)
        if len(warm):
            index = np.searchsorted(rows, warm)
            moved = inversion.posterior(x[index] + sigma[:, inversion.live], self._centres).mean
            moved -= mean[index]
            cov[index] += moved[:, :, None] * moved[:, None]

    @property
    def _centres(self) -> Array:
        """Centres of cells (n, 3) (m), seen from above where cells are told so."""
        return self.config.cells * (np.array([1.0, 1.0, 0.0]) if self.flat_ else 1.0)


def _touched_only(truth: Columns) -> Columns:
    """Truth without the loads of untouched rows, which are 0 whatever is learned."""
    free = [np.asarray(truth['in_contact']) == 0] if 'in_contact' in truth else []
    if 'force' in truth:
        free.append((np.nan_to_num(np.asarray(truth['force'], float)) == 0).all(axis=1))
    if not free:
        return truth
    gone = np.any(free, axis=0)[:, None]
    loads: Columns = {
        k: np.where(gone, np.nan, truth[k]) for k in ('force', 'torque') if k in truth
    }
    return {**truth, **loads}


def _measured(column: npt.NDArray[np.generic]) -> Bools:
    """Rows in which truth has anything."""
    known = np.isfinite(column) if column.dtype.kind == 'f' else column != -1
    return np.asarray(known.any(axis=tuple(range(1, known.ndim))))


def _filled(column: npt.NDArray[np.generic], rows: Integers, count: int) -> Array:
    """A column of some rows for all of them, NaN or -1 in the others."""
    blank = np.nan if column.dtype.kind == 'f' else -1
    wide = np.full((count, *column.shape[1:]), blank, column.dtype)
    wide[rows] = column
    return wide


def _on_surface(config: MagnetPadConfig, place: Array, force: Array) -> bool:
    """Whether contacts (s, 3) lie on a half cylinder about the axis, pressed inward."""
    distance = np.hypot(place[:, 1], place[:, 2])
    radius = max(float(np.median(distance)), 1e-9)
    off = np.abs(distance / radius - 1) > 0.1
    off |= np.abs(place[:, 0]) > 0.55 * config.length
    off |= (place[:, 1:] * force[:, 1:]).sum(axis=1) <= 0
    return 0.5 < radius / config.radius < 2.0 and float(off.mean()) <= 0.05


def nearest(places: Array, cells: Array) -> Integers:
    """Number (...) of the cell (n, k) nearest to places (..., k).

    Examples
    --------
    >>> nearest(np.array([[0.1, 0.0]]), np.array([[1.0, 0.0], [0.0, 0.0]])).tolist()
    [1]
    """
    return np.asarray((places @ cells.T - 0.5 * (cells**2).sum(axis=1)).argmax(axis=-1))


def extent(cells: Array) -> Array:
    """Variance (3,) (m2) of places inside a cell along each axis, by the gaps of centres (n, 3).

    Examples
    --------
    >>> (1e6 * extent(np.array([[0.0, 0, 0], [6e-3, 0, 0]]))).round(3)
    array([3., 0., 0.])
    """
    steps = [max(len(np.unique(np.round(axis, 6))) - 1, 1) for axis in cells.T]
    return np.asarray((np.ptp(cells, axis=0) / steps) ** 2 / 12)


def named_cells(place: Array, cov: Array, cells: Array) -> tuple[Integers, Array]:
    """Cells (s,) nearest to places (s, 3), seen from above, and their share of the covariance."""
    known = np.isfinite(place[:, :2]).all(axis=1)
    named, share = np.full(len(place), -1), np.full(len(place), np.nan)
    root = np.linalg.cholesky(cov[known][:, :2, :2] + 1e-18 * np.eye(2))
    spread = place[known, None, :2] + np.einsum('sij,pj->spi', root, POINTS)
    named[known] = nearest(place[known, :2], cells[:, :2])
    share[known] = (nearest(spread, cells[:, :2]) == named[known, None]).mean(axis=1)
    return named, share


CLASSES = (
    *REGRESSION_CLASSES,
    Localisation,
    PadInversion,
    PadResponse,
    CovarianceModel,
    ThermalDrift,
    MagnetPadConfig,
    Choice,
    Rated,
    Worth,
)
