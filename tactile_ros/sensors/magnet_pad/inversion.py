"""Place, load and stray field of a touch by Gauss-Newton on the tabulated answer of the pad.

A table of touches, spread as the recorded ones are and thinly everywhere else, holds for each the
reading of the fitted response (`response`) and its slopes; what readings say follows by Bayes
(`touch_mixture`), without an outside field and with one. What is stated of errors is measured on
groups of touches that neither the response nor the table has seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.covariance import Pieces, SigmaCalibration, pieces, widen
from tactile_ros.estimators.gaussian_sum_table import GaussianSumTable, Linearised, Posterior
from tactile_ros.estimators.regression import group_folds
from tactile_ros.sensors.magnet_pad.body_model import (
    EDGE,
    PadResponse,
    PadTouches,
    ResponseResidual,
)
from tactile_ros.sensors.magnet_pad.covariance import (
    LoadExtrapolation,
    extrapolation_covariance,
    growth,
    split,
)
from tactile_ros.sensors.magnet_pad.nominal_estimator import (
    ANSWERS,
    NEIGHBOURS,
    READING,
    SIGMAS,
    SLACK,
    PosteriorMoments,
    TouchPosterior,
    UniformPart,
    widened,
)
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig

SEED = 19
ANYWHERE = 0.2  # share of touches that are spread evenly
LOAD, SHEAR = 2.0, 1.0  # radii that a factor e of load, and a leaning of 1, count as
NEAR = 6  # neighbour whose distance is the reach
LEAST_REACH, MOST_REACH = 0.005, 0.3  # radii
LEAST_BLUR, MOST_BLUR = 0.02, 0.2
USUAL = 0.99  # share of known places that have another as near
WEAKER, HARDER = 1.6, 0.8  # logarithm of loads beyond the recorded ones
DECADE = 2.3  # of loads that are thought of at least, in logarithms


@dataclass(frozen=True)
class Touched:
    """Recorded touches.

    Recorded touches, blurred by their distances from each other, say where touches are likely
    (Parzen, Ann. Math. Stat. 33, 1962); some are spread evenly, since what was recorded is not
    all.
    """

    x: Array  # (s, d) readings of live channels (T)
    # (s, 3) (m, N)
    place: Array
    force: Array
    # (s,) what a split keeps together; true cells, -1 unknown
    groups: Integers
    cells: Integers

    def in_order(self) -> Touched:
        """The same for every order of the rows."""
        order = np.lexsort(np.column_stack([self.x, self.place, self.force]).T[::-1])
        _, first, index = np.unique(self.groups[order], return_index=True, return_inverse=True)
        rank = np.empty(len(first), np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        return Touched(
            self.x[order], self.place[order], self.force[order],
            np.asarray(rank[index.reshape(-1)]), self.cells[order],
        )  # fmt: skip


def sample_training_density(
    config: MagnetPadConfig, known: Array, count: int, *, leaning: bool, sharp: bool
) -> tuple[Array, Array]:
    """Draw touches.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.
    known : ndarray, shape (s, 5)
        Recorded touches: along (m), around (rad), logarithm of the load (N), leanings.
    count : int
        How many (n).
    leaning : bool
        Whether leanings count.
    sharp : bool
        Whether touches keep as near to recorded places as those lie to each other; else as near
        as recorded touches of like loads do.

    Returns
    -------
    touches : ndarray, shape (n, 5)
        As `known`; the same for the same arguments.
    reach : ndarray, shape (n,)
        Distance to neighbours (radii; see `LOAD` and `SHEAR`).
    """
    rng = np.random.default_rng(SEED)
    unit = np.array([1 / config.radius, 1.0, LOAD, SHEAR, SHEAR])
    unit[3:] *= leaning
    free = int(ANYWHERE * count)
    drawn = np.concatenate(
        [_blurred(known, unit, count - free, rng, sharp), _even(config, known, free, rng)]
    )
    least = float(np.arccos(EDGE))
    low, high = thought_of(known[:, 2])
    drawn[:, 0] = np.clip(drawn[:, 0], -config.length / 2, config.length / 2)
    drawn[:, 1] = np.clip(drawn[:, 1], least, np.pi - least)
    drawn[:, 2] = np.clip(drawn[:, 2], low, high)
    spots = drawn * unit
    near = min(NEAR + 1, count)
    reach = cKDTree(spots).query(spots, k=[near])[0][:, 0]
    return drawn, np.clip(reach, LEAST_REACH, MOST_REACH)


def thought_of(load: Array) -> tuple[float, float]:
    """Least and largest logarithm of loads of a table, by those of recorded touches (s,)."""
    low, high = float(load.min()), float(load.max())
    room = 0.5 * max(DECADE - (high - low), 0.0)
    return low - WEAKER - room, high + HARDER + room


def distance_from_training(known: Array, places: Array, radius: float) -> Array:
    """Distance (s,) (radii, at most 1) of places (s, 2) from known ones (n, 2), beyond the usual.

    Both along (m) and around (rad); usual are the distances of known places from each other.
    """
    unit = np.array([1 / radius, 1.0])
    tree = cKDTree(known * unit)
    usual = np.quantile(tree.query(known * unit, k=[min(2, len(known))])[0], USUAL)
    return np.asarray(np.clip(tree.query(places * unit)[0] - usual, 0.0, 1.0))


def _blurred(
    known: Array, unit: Array, count: int, rng: np.random.Generator, sharp: bool
) -> Array:
    """Known touches (s, 5), each moved by half the distance to others like it."""
    spots = known * unit
    seen = spots[:, :2] if sharp else spots
    near = min(4, len(known) - 1)
    gap = cKDTree(seen).query(seen, k=[near + 1])[0][:, 0]
    pick = rng.integers(0, len(known), count)
    least = LEAST_REACH if sharp else LEAST_BLUR
    blur = np.clip(0.5 * gap, least, MOST_BLUR)[pick, None] * rng.normal(size=(count, 5))
    if sharp:
        blur[:, 2:] = MOST_BLUR * rng.normal(size=(count, 3))
    return np.asarray(known[pick] + blur * np.where(unit > 0, 1 / np.maximum(unit, 1e-9), 0.0))


def _even(config: MagnetPadConfig, known: Array, count: int, rng: np.random.Generator) -> Array:
    """Touches (n, 5) all over the pad, of all loads, leaning as known ones (s, 5) do."""
    even = np.empty((count, 5))
    even[:, 0] = config.length * (rng.uniform(size=count) - 0.5)
    even[:, 1] = np.arccos(rng.uniform(-EDGE, EDGE, count))
    even[:, 2] = rng.uniform(*thought_of(known[:, 2]), count)
    even[:, 3:] = known[rng.integers(0, len(known), count), 3:]
    return even


COUNT, FEW = 30_000, 10_000
FOLDS = 4
UNLIKE = 16.0  # misfit over its scale, from which a stray field is thought of
FLOOR = np.diag(np.repeat([1e-6, 1e-4], 3) ** 2)  # m2, N2: what truth itself is wrong by
SHARE, LIGHTEST = 0.4, 0.01  # as `conditioning.contact` has them
QUANTILE = 0.925  # variance, times rows, of the logarithm of what 68.27 % of a Gaussian are inside
LEANING = 0.03  # tangential over normal force, from which touches lean


class PadInversion:
    """Touches from readings, by the response of the pad.

    Parameters
    ----------
    config : MagnetPadConfig
        Where the fit starts.
    live : ndarray of bool, shape (c,)
        Channels that are alive; the d of them are the features.
    common : ndarray, shape (d, 3), or None
        What a uniform field adds to the features, in sensor axes; None: it cannot be told.
    noise : float
        Of a channel (T).
    """

    response_: PadResponse  # fitted
    radius_: float  # of the surface on which contacts were told (m)
    scatter_: float  # what readings differ by from the response, over their size, beside noise
    misfit_: float  # that most touches leave, over their sigma
    touches_: Array  # (s, 5) recorded ones: along, around, logarithm of the load, leanings
    spread_: SigmaCalibration  # of place and force
    sharp_: bool  # whether touches keep to recorded places
    contact_: float  # largest channel, less a uniform field, beyond which something touches (T)
    loads_: LoadExtrapolation  # how errors grow beyond the recorded loads
    report_: dict[str, dict[str, float]]  # errors on held-out groups

    def __init__(
        self, config: MagnetPadConfig, live: Bools, common: Array | None, noise: float
    ) -> None:
        self.config, self.live, self.common = config, live, common
        self.noise = max(noise, 1e-9)

    def fit(self, touched: Touched, centres: Array) -> PadInversion:
        """Learn from recorded touches; centres (n, 3) are those of cells (m)."""
        touched = touched.in_order()
        x, place = touched.x, touched.place
        self.radius_ = float(np.median(np.hypot(place[:, 1], place[:, 2])))
        touches = PadTouches.told(place, touched.force)
        self.leaning = bool(np.sqrt((touches.lean**2).mean()) > LEANING)
        model = PadResponse(self.config, self.live, leaning=self.leaning)
        model.fit(touches, x, self.noise)
        lacks = ResponseResidual(model, touches, x, self.noise)
        fold = group_folds(touched.groups, FOLDS, seed=0)
        every = np.ones(len(x), bool)
        parts = [fold != part for part in range(int(fold.max()) + 1)]
        ways = [model.learn(part if part.any() else every, lacks) for part in parts]
        self._measure_scatter(ways, touches, x, fold)
        self.response_ = model.learn(every, lacks)
        self.touches_ = _rows(touches)
        for name in ('telling', '_levels', '_whole'):
            vars(self).pop(name, None)
        size = np.abs(x).max(axis=1) if self.common is None else UniformPart(self.common)(x)[1]
        lightest = float(np.quantile(size, LIGHTEST))
        self.contact_ = max(SIGMAS * self.noise, SHARE * lightest)
        best = np.inf
        for sharp in (False, True):
            kept, self.sharp_ = dict(vars(self)), sharp
            self._calibrate(ways, touched, fold, centres)
            error = self.report_['position']['held_out_rmse']
            if error >= best:
                vars(self).update(kept)
            best = min(best, error)
        self.loads_ = self._load_reach(touched, touches)
        return self

    def _load_reach(self, touched: Touched, touches: PadTouches) -> LoadExtrapolation:
        """How errors grow beyond the recorded loads, as the heavier of them tell."""
        parts, load = split(touches.load), touches.load
        span = float(load.min()), float(load.max()), self.config.radius
        if parts is None:
            return LoadExtrapolation(*span)
        light, heavy = parts
        known = touches.take(light)
        model = PadResponse(self.config, self.live, leaning=self.leaning)
        model.fit(known, touched.x[light], self.noise)
        lacks = ResponseResidual(model, known, touched.x[light], self.noise)
        way = model.learn(np.ones(len(light), bool), lacks)
        rows = self._table(way, _rows(known), FEW).of(READING)
        seen = GaussianSumTable(rows, neighbours=NEIGHBOURS, told=ANSWERS, slack=SLACK)(
            touched.x[heavy]
        )
        cov = widened(seen, self.misfit_) + FLOOR
        sigma = self.spread_(np.sqrt(np.diagonal(cov, axis1=1, axis2=2)))
        true = np.column_stack([touched.place, touched.force])[heavy]
        error = (seen.mean[:, :ANSWERS] - true) / sigma
        away = touches.load[heavy] / known.load.max() - 1
        wider = growth(away, error[:, :2]), growth(away, error[:, 4:])
        return LoadExtrapolation(*span, *wider, told=True)

    def _calibrate(
        self, ways: list[PadResponse], touched: Touched, fold: Integers, centres: Array
    ) -> None:
        """What touches of groups that were not learned from are said to be."""
        answers = np.column_stack([touched.place, touched.force])
        said, named = np.empty_like(answers), np.empty(len(answers), np.int64)
        parts: list[tuple[Bools, Posterior]] = []
        for part, way in enumerate(ways):
            held = fold == part
            known = self.touches_[~held] if len(ways) > 1 else self.touches_
            rows = self._table(way, known, COUNT).of(READING)
            table = GaussianSumTable(rows, neighbours=NEIGHBOURS, told=ANSWERS, slack=SLACK)
            one = table(touched.x[held])
            said[held] = one.mean[:, :ANSWERS]
            parts.append((held, one))
            named[held] = table.shares(one, centres).argmax(axis=1)
        error = said - answers
        misfit = np.concatenate([one.misfit for _, one in parts])
        self.misfit_ = max(float(np.quantile(misfit, 0.95)), 1.0)
        stated = np.empty_like(answers)
        for held, one in parts:
            cov = widened(one, self.misfit_) + FLOOR
            stated[held] = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        self.spread_ = _straight(SigmaCalibration().fit(stated, error), len(error))
        sigma = self.spread_(stated)
        self.report_ = {}
        for target, columns in (('position', slice(0, 3)), ('force', slice(3, 6))):
            away = np.sqrt((error[:, columns] ** 2).sum(axis=1))
            self.report_[target] = {
                'held_out_mean': float(away.mean()),
                'held_out_rmse': float(np.sqrt((away**2).mean())),
                'inside_one_sigma': float((np.abs(error) <= sigma)[:, columns].mean()),
                'groups': float(touched.groups.max() + 1),
                'rows': float(len(error)),
            }
        known = touched.cells >= 0
        if known.any():
            right = float((named == touched.cells)[known].mean())
            self.report_['cell'] = {'held_out_accuracy': right}

    def _measure_scatter(
        self, ways: list[PadResponse], touches: PadTouches, x: Array, fold: Integers
    ) -> None:
        """What held-out readings differ by from the response, as a share of their size."""
        error = np.empty_like(x)
        for part, way in enumerate(ways):
            held = fold == part
            error[held] = x[held] - way(touches.take(np.flatnonzero(held)))
        size = (x * x).mean(axis=1)
        beyond = (error * error).mean(axis=1) - self.noise**2
        least, most = 1e-4, 0.3
        ratio = float(np.median(beyond / np.maximum(size, self.noise**2)))
        mean = float(beyond.mean() / size.mean())
        self.scatter_ = float(np.sqrt(np.clip(max(ratio, 0.5 * mean), least**2, most**2)))

    def _table(self, response: PadResponse, known: Array, count: int) -> Linearised:
        """Touches of the table with their readings."""
        rows, reach = sample_training_density(
            self.config, known, count, leaning=self.leaning, sharp=self.sharp_
        )
        width = 5 if self.leaning else 3
        touches = PadTouches(rows[:, 0], rows[:, 1], np.exp(rows[:, 2]), rows[:, 3:])
        readings, slopes = response.near(touches)
        radius = self.config.radius
        unit = np.array([radius, 1.0, 1 / LOAD, 1 / SHEAR, 1 / SHEAR])[:width]
        size = reach[:, None] * unit
        answers, leads = self._answers(touches)
        variance = self.noise**2 + self.scatter_**2 * (readings**2).mean(axis=1)
        sigma = np.sqrt(variance)
        wider = 1 + response.doubt(touches) / variance
        far = distance_from_training(known[:, :2], rows[:, :2], self.config.radius)
        beside = np.column_stack([wider, far, self.noise**2 / variance])
        still = np.zeros((len(rows), beside.shape[1], width))
        return Linearised(
            readings,
            slopes * size[:, None],
            np.concatenate([answers, beside, readings], axis=1),
            np.concatenate([leads[:, :, :width], still, slopes], axis=1) * size[:, None],
            sigma,
            np.full(len(rows), 1 / len(rows)),
        )

    def _answers(self, touches: PadTouches) -> tuple[Array, Array]:
        """Place and force (s, 6), and how they change with the five freedoms (s, 6, 5)."""
        radius, load = self.radius_, touches.load
        cosine, sine, zero = np.cos(touches.around), np.sin(touches.around), 0 * load
        normal = np.column_stack([zero, cosine, sine])
        around = np.column_stack([zero, -sine, cosine])
        side = np.eye(3)[:1]
        a, b = touches.lean[:, :1], touches.lean[:, 1:]
        place = radius * normal
        place[:, 0] = touches.along
        force = load[:, None] * (normal + a * side + b * around)
        leads = np.zeros((len(load), 6, 5))
        leads[:, 0, 0] = 1.0
        leads[:, :3, 1] = radius * around
        leads[:, 3:, 1] = load[:, None] * (around - b * normal)
        leads[:, 3:, 2] = force
        leads[:, 3, 3] = load
        leads[:, 3:, 4] = load[:, None] * around
        return np.concatenate([place, force], axis=1), leads

    @cached_property
    def telling(self) -> TouchPosterior:
        """Touches of the table."""
        known = self._table(self.response_, self.touches_, COUNT)
        limit = UNLIKE * self.misfit_
        spread = self.config.gain_spread
        told = known, self.common, self.noise, self.contact_
        return TouchPosterior(*told, self.misfit_, limit, spread)

    def invert(self, x: Array, cells: Array, doubt: Array | float = 0.0) -> PosteriorMoments:
        """What finite readings x (s, c) (T) tell, with centres (n, 3) of cells (m).

        Of a baseline whose variance over that of a frame is `doubt` (s,).
        """
        told = self.telling(self.alive(x), cells)
        widen(told.cov, FLOOR, self._levels)
        told.cov[:] *= (1 + doubt * told.noisy)[:, None, None]
        self.loads_.widen(told.mean, told.cov)
        if np.count_nonzero(told.far):
            told.cov[:] += extrapolation_covariance(told.mean, told.far, self.config.radius)
        return told

    def alive(self, x: Array) -> Array:
        """Readings (s, d) of the live channels among all (s, c)."""
        return x if self._whole else x[:, self.live]

    @cached_property
    def _levels(self) -> Pieces:
        """Of the spread."""
        return pieces(self.spread_.knots_, self.spread_.factors_)

    @cached_property
    def _whole(self) -> bool:
        return bool(self.live.all())


def _straight(spread: SigmaCalibration, rows: int) -> SigmaCalibration:
    """The same, its factors on a line over the sigma, as steep as so many rows are sure of it."""
    whole, levels = spread.factors_.mean(axis=0), len(spread.factors_)
    away = spread.knots_ - spread.knots_.mean(axis=0)
    square = np.maximum((away * away).sum(axis=0), 1e-12)
    slope = (away * (spread.factors_ - whole)).sum(axis=0) / square
    doubt = QUANTILE * levels / rows / square
    spread.factors_ = whole + slope**3 / (slope**2 + doubt) * away
    return spread


def _rows(touches: PadTouches) -> Array:
    return np.column_stack([touches.along, touches.around, np.log(touches.load), touches.lean])
