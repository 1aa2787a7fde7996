# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Table of touches of a pad, fitted to a recording or the config's, that answers readings.

Touches are drawn like recorded ones, or over all the pad; a reading takes Gauss-Newton steps from
those nearest to it (`estimators.gaussian_sum_table`). Errors are those on held-out groups, or on
specimens that differ from the config.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.covariance import CovarianceModel, widened
from tactile_ros.estimators.gaussian_sum_table import Linearised, TouchEstimate, TouchPosterior
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import held_out_report, rms_length
from tactile_ros.estimators.regression import _by_appearance, group_folds
from tactile_ros.sensors.magnet_pad.body_model import (
    EDGE,
    LEAST_NOISE,
    STRAY,
    PadResponse,
    ResponseResidual,
    Specimens,
    change_of_field,
    field_choice,
    places_and_forces,
    uniform_response,
)
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.types import Array, Bools, Integers, Report

TABLE = 'table_gauss_newton'
SEED = 19
COUNT, NOMINAL_COUNT = 30_000, 8000  # touches of a table
EVEN = 0.2  # share of touches that are spread evenly
STEP = 1e-3  # radii and rad, over which readings are differentiated
UNITS = np.array([1.0, 1.0, 0.5, 1.0, 1.0])  # of a touch, that count as a radius
NEAR = 6  # neighbour whose distance is the extent of a touch
EXTENT = (0.005, 0.3)  # radii, least and largest
FOLDS = 4
LEANING = 0.03  # tangential over normal force, from which touches lean
FLOOR = np.repeat([1e-6, 1e-4], 3) ** 2  # m2, N2: errors of truth itself
CONTACT, SIGMAS = 0.4, 5.0  # of the lightest recorded touch; of the noise


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
    """Touches from readings of the d channels that are alive, of a noise (T)."""

    RIGHT = 0.06  # of a reading: error of the config's pad
    LOADS = (0.01, 0.6)  # of shear modulus times the square of the radius
    TIPS, BONDS, LEAN = (0.05, 0.7), (-0.8, 1.6), 0.5  # radii; shares; rad
    SPECIMENS, EACH = 40, 40

    def __init__(self, config: MagnetPadConfig, live: Bools, noise: float) -> None:
        self.config, self.live, self.noise = config, live, max(noise, LEAST_NOISE)
        self.response_: PadResponse | None = None  # fitted; None: that of the config
        # recorded touches (n, 5), the radius (m) of their surface, and the residual of the
        # response over the readings, beside the noise
        self.touches_, self.radius_, self.scatter_ = np.zeros((0, 5)), config.radius, self.RIGHT
        # misfit that most touches leave, and norm (T) of a reading less a uniform field, beyond
        # which something touches
        self.misfit_, self.contact_ = float(live.sum()), SIGMAS * self.noise
        self.span_ = np.full(2, np.nan)  # least and largest recorded force (N)
        self.covariance_: CovarianceModel | None = None  # of place and force
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
        fold = group_folds(_by_appearance(groups), FOLDS, seed=0)
        self._validate(touches, x, groups, fold)
        uniform, remains = self.common, x
        if uniform is not None:
            remains = x - x @ np.linalg.pinv(uniform).T @ uniform.T
        lightest = float(np.quantile(np.linalg.norm(remains, axis=1), 0.01))
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
        cov = widened(cov, misfit / self.misfit_)
        error, stated = mean - answers, cov + np.diag(FLOOR)
        self.covariance_ = CovarianceModel().fit(error, stated, groups, x)
        sigma = np.sqrt(np.diagonal(self.covariance_.predict(stated, x)[0], axis1=1, axis2=2))
        for target, part in (('position', slice(0, 3)), ('force', slice(3, 6))):
            away, other = error[:, part], (peer - answers)[:, part]
            rmse = {TABLE: rms_length(away), 'grid_knn': rms_length(other)}
            self.report_[target] = held_out_report(away, sigma[:, part], groups, len(x), rmse)

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
        rows = (
            self._nominal_rows()
            if self.response_ is None
            else self._rows(self.response_, self.touches_, COUNT)
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
