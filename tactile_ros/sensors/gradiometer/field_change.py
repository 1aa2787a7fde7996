"""Features of the gradiometer: change of field, its differences, temperatures and the disc."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactile_ros.estimators.disc_inversion import DiscInversion
from tactile_ros.estimators.disc_model import OFFSETS, WEAKENING, WEAKER, UniformField
from tactile_ros.estimators.polynomial_ridge import WarmPolynomial, errors_in_variables, times
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer.temperature import (
    LEAST_RANGE,
    STRONGEST,
    THIRD,
    UNIT,
    WEAKEST,
    StreamMemory,
    WarmRest,
    chip_temperature,
    lagging,
    lags_told,
    sensitivity,
    temperature_wander,
    thermometer_noise,
    told_ago,
    unsure_chips,
)
from tactile_ros.sensors.gradiometer.twin import LEAST_NOISE, field_model, terms

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.physics.fidelity import Choice, Worth
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Bools, Columns, Integers, Signals

CLEARLY = 20.0  # chi square by which a lag must explain more than none
FEWEST_FORCES, MOST_FORCES = 100, 1500
LATER = 0.05  # of the logarithm of a time constant
FARTHEST = 3.0  # of these
TOUCH = 2e-5  # T: a small change of one difference
FINER, GOLDEN = 7, 0.618
TURNS = 3  # each is found with the others


class WarmFit:
    """One fit of a disc's model.

    Parameters
    ----------
    signals : Signals
        Of the recording.
    readings : FieldChange
        Learned from the same; what rests at other temperatures read is learned here.
    fresh : callable
        A disc's model that has learned nothing.
    warmth : callable
        Temperatures of the disc (s,) that lags behind the chip by a time constant (s).
    resting, rows, force : ndarray, shape (s,), (m,), (s, 3)
        Rows that rest; indices of those to learn from; force (N), NaN where none was told.

    Attributes
    ----------
    lag : float
        Time constant in use (s).
    change : ndarray, shape (s, n)
        Changes of field as readings tell them by now (T).
    """

    def __init__(
        self, signals: Signals, readings: FieldChange, fresh: Callable[[], DiscInversion],
        warmth: Callable[[float], Array], resting: Bools, rows: Integers, force: Array,
    ) -> None:  # fmt: skip
        self.signals, self.readings, self.fresh, self.warmth = signals, readings, fresh, warmth
        self.resting, self.rows, self.force = resting, rows, force
        told = rows[np.isfinite(force[rows]).all(axis=1)]
        self.told = _spread(told) if len(told) >= FEWEST_FORCES else told[:0]
        self.change = readings.change(signals)
        self.lag, self.seeks_lag = 0.0, False

    def fit(self, lag: float) -> DiscInversion:
        """Learn the disc's model; a lag of 0 is sought, another one is taken."""
        self.lag = lag
        if self.readings.warm_ and lag == 0:
            self._learn_lag()
            self.seeks_lag = self.lag > 0
        disc = self._learn_disc()
        if self.readings.rest_ is not None and len(self.told):
            self._learn_from_force(disc)
        elif self.readings.rest_ is not None:
            self.readings.rest_.unsure_ = disc.unsure_warmth(disc.projection_)[:-1, :-1]
        return disc

    def _since_rest(self, warm: Array) -> Array:
        """Temperatures of the disc (s,) from that of the rests of the fit."""
        rest = warm[self.resting]
        return warm - (rest.mean() if len(rest) else 0.0)

    def _learn_lag(self) -> None:
        """Take the time constant with which the disc's model, and force, are explained best."""
        disc, costs, drift = self.fresh(), {}, self.readings.drifts(self.signals)

        def left(lag: float) -> float:
            if lag not in costs:
                costs[lag] = self._left(disc, self._since_rest(self.warmth(lag)), drift)
            return costs[lag]

        best = min([0.0, *(float(lag) for lag in self.readings.lags_)], key=left)
        if best == 0 or left(best) > left(0.0) - CLEARLY:
            return
        low, high = best / 3, best * 3
        for _ in range(FINER):  # golden section of the logarithm
            first, second = low**GOLDEN * high ** (1 - GOLDEN), low ** (1 - GOLDEN) * high**GOLDEN
            low, high = (low, second) if left(first) < left(second) else (first, high)
        near = sorted(sorted((lag for lag in costs if lag > 0), key=left)[:3])
        best = float(_lowest(np.log(near), np.array([left(lag) for lag in near])))
        self.lag = float(np.clip(np.exp(best), near[0], near[-1]))

    def _left(self, disc: DiscInversion, heat: Array, drift: Array) -> float:
        """Twice the negative logarithm of the likelihood of temperatures (s,) of the disc."""
        rows, told = self.rows, self.told
        cost = disc.leaves(self.change[rows], heat[rows], drift[rows])
        if not len(told):
            return cost
        force, read = self.force[told], self.change[told] - drift[told] @ disc.offset
        seen = np.column_stack([disc.invert(read, heat[told])[0], heat[told]])
        share = WarmPolynomial((3,)).leaves(seen, force) / force.size
        return cost + force.size * float(np.log(share))

    def _learn_disc(self) -> DiscInversion:
        """Learn the disc's model and what rests at other temperatures read."""
        readings, rows = self.readings, self.rows
        warm = self.warmth(self.lag)
        heat, offset = self._since_rest(warm), np.zeros((2, self.change.shape[1]))
        for _ in range(TURNS):
            drift = readings.drifts(self.signals)
            disc = self.fresh().fit(self.change[rows], heat[rows], drift[rows])
            if readings.rest_ is None:
                break
            offset = offset + disc.offset
            rise = self._rise(disc, self.change - drift @ disc.offset, heat)
            self._take(warm, disc.warmed(rise), offset)
            heat = warm
        return disc

    def _take(self, warm: Array, warmer: Array, offset: Array) -> None:
        """Let readings know what rests at other temperatures read."""
        self.readings.learn_warm_rest(self.signals, self.resting, warm, warmer, offset)
        self.change = self.readings.change(self.signals)

    def _rise(self, disc: DiscInversion, change: Array, heat: Array) -> float:
        """By how much a warmer disc rests higher (gaps over a unit), told by force; 0: untold."""
        if not len(self.told):
            return 0.0
        place = disc.invert(change[self.told], heat[self.told])[0]
        model = WarmPolynomial((3,))
        model.leaves(np.column_stack([place, heat[self.told]]), self.force[self.told])
        return float(model.rise_[0])

    def _learn_from_force(self, disc: DiscInversion) -> None:
        """Learn drifts, lag and what warmth does to remanence together, from force."""
        rest, told, force = self.readings.rest_, self.told, self.force[self.told]
        assert rest is not None
        base, weakening, lag = rest.offset_, disc.found_[WEAKENING], self.lag
        ways = disc.projection_
        usual = np.asarray(np.linalg.cholesky(disc.unsure_warmth(ways)))
        sizes = np.zeros(len(usual) + 1)
        for _ in range(TURNS):
            warm = self.warmth(self.lag)
            later = LATER * self._later(warm)[told]
            place = disc.invert(self.change[told], warm[told])[0]
            amiss = self._amiss(disc, place, warm[told], later, usual)
            moves = self._moves(disc, place, warm[told], amiss)
            found = errors_in_variables(place, moves, warm[told], -later, force, sizes)
            sizes = found.sizes
            *drift, weaker = usual @ sizes[:-1]
            disc.weaken(weakening + weaker / WEAKER)
            if self.seeks_lag:
                self.lag = lag * float(np.exp(LATER * np.clip(sizes[-1], -FARTHEST, FARTHEST)))
            offset = base + np.reshape(drift, (2, -1)) @ ways.T
            self._take(self.warmth(self.lag), disc.warmed(found.rise), offset)
        cov = (usual @ found.cov[:-1, :-1] @ usual.T)[:-1, :-1]
        assert self.readings.rest_ is not None
        self.readings.rest_.unsure_ = cov

    def _later(self, warm: Array) -> Array:
        """Change of the disc's temperatures (s,) by a larger logarithm of its time constant."""
        if not self.seeks_lag:
            return np.zeros(len(warm))
        return (self.warmth(self.lag * np.exp(LATER)) - warm) / LATER

    def _amiss(
        self, disc: DiscInversion, place: Array, heat: Array, later: Array, usual: Array
    ) -> Array:
        """What errors of usual sizes add to changes of told rows, shape (s, p, n) (T)."""
        drift = self.readings.drifts(self.signals)[self.told]
        each = np.einsum('sk,nm->skmn', drift, disc.projection_)
        field = disc.fields(place, heat)
        each = each.reshape(len(field), -1, field.shape[1])
        one = np.concatenate([each, (heat[:, None] * field)[:, None]], axis=1)
        weaker = WEAKER * disc.found_[WEAKENING] * later[:, None]
        amiss = np.einsum('spn,pq->sqn', one, usual)
        return np.concatenate([amiss, (weaker * field)[:, None]], axis=1)

    def _moves(self, disc: DiscInversion, place: Array, heat: Array, amiss: Array) -> Array:
        """What additions (s, p, n) (T) to changes of told rows do to places (s, p, 3)."""
        change, ways = self.change[self.told], disc.projection_
        slopes = [(disc.invert(change + TOUCH * way, heat)[0] - place) / TOUCH for way in ways.T]
        return np.asarray(np.einsum('spn,nm,msi->spi', amiss, ways, np.array(slopes)))


def _spread(rows: Integers) -> Integers:
    """No more rows than are learned from, evenly spread."""
    few = np.linspace(0, len(rows) - 1, min(len(rows), MOST_FORCES))
    return np.asarray(rows[few.astype(int)])


def _lowest(x: Array, y: Array) -> float:
    """Where the parabola through three points is lowest; the lowest point, where it is not."""
    bend, slope, _ = np.polyfit(x - x[1], y, 2)
    return float(x[1] - slope / (2 * bend) if bend > 0 else x[np.argmin(y)])


NOISE = 3e-6  # T, where nothing tells it: of [3] at room temperature
SIGMAS = 4.0  # within which a clipped reading may fall below the range
MOST_MARGIN = 0.01  # of the range
FEWEST_RESTING, UNEVEN = 10, 2  # in succession, that tell noise beside warming; their steps
CLEAR = 20.0  # sigmas of the disc at rest beyond which it tells the baseline's temperature


class FieldChange:
    """Change of field of one gradiometer.

    Parameters
    ----------
    config : GradiometerConfig
        Axes, sensitivity and noise.

    Attributes
    ----------
    axes : ndarray, shape (n, 3)
        Direction of each channel; 0 for dead ones.
    noise : float
        Of a channel (T).
    absolute_ : bool
        FieldChange came without a baseline.
    level_ : ndarray, shape (n,)
        Mean field at rest (T).
    usual_ : float
        Mean temperature of the fit (degrees Celsius); NaN: none was told.
    warm_ : bool
        Temperatures of the fit differed.
    lags_ : ndarray, shape (m,)
        Time constants by which the disc may lag behind the chip (s).
    span_ : ndarray, shape (2,)
        Least and highest temperature of the fit (degrees Celsius); infinite: none was told.
    rest_ : WarmRest or None
        FieldChange at rest over temperatures; None: all of the fit were alike.
    thermometer_ : float
        Noise of the chip's thermometer (degrees); 0: no stream told it.
    wander_ : ndarray, shape (3, m)
        How far temperatures go, of `temperature_wander`.
    """

    def __init__(self, config: GradiometerConfig) -> None:
        self.sensitivity = config.sensitivity
        turned = config.rotations
        turned = np.tile(np.eye(3), (len(config.positions), 1, 1)) if turned is None else turned
        self.axes = np.ascontiguousarray(turned[:, :, [0, 2]].transpose(0, 2, 1)).reshape(-1, 3)
        stated = NOISE if config.noise is None else float(np.max(config.noise))
        self.noise = stated if np.isfinite(stated) else NOISE
        self.absolute_ = False
        self.level_ = np.zeros(len(self.axes))
        self.usual_ = float('nan')
        self.warm_ = False
        self.lags_ = np.zeros(0)
        self.span_ = np.array([-np.inf, np.inf])
        self.rest_: WarmRest | None = None
        self.thermometer_, self.wander_ = 0.0, np.zeros((3, 1))
        self.fitted_ = False
        self.noise_is_stated = config.noise is not None

    def fit(self, signals: Signals, resting: Bools) -> FieldChange:
        """Learn level, noise and temperatures from frames and which of them (s,) rest."""
        rows, self.fitted_ = signals.good, True
        flat = signals.values.reshape(len(rows), len(self.axes))
        if rows.any():
            dead = (flat[rows] == 0).all(axis=0)
            self.axes = np.where(dead[:, None] & ~dead.all(), 0.0, self.axes)
        self.absolute_ = not np.nan_to_num(signals.baseline[rows]).any()
        chip = chip_temperature(signals)
        if chip is not None and np.isfinite(chip[rows]).any():
            seen = chip[rows & np.isfinite(chip)]
            self.usual_ = float(seen.mean())
            self.span_ = np.array([seen.min(), seen.max()])
            self.warm_ = bool(seen.max() - seen.min() > LEAST_RANGE)
            self.lags_ = lags_told(signals) if self.warm_ else self.lags_
            self.thermometer_ = thermometer_noise(signals, chip)
            now = np.where(rows & (told_ago(signals) == 0), chip, np.nan)
            self.wander_ = temperature_wander(signals, now, self.thermometer_)
        self._learn_rest(signals, resting if resting.any() else rows)
        if not self.noise_is_stated and resting.sum() > 10:
            self.noise = _noise(signals, resting) or self.noise
        return self

    def _learn_rest(self, signals: Signals, rows: Bools) -> None:
        if self.absolute_ or not rows.any():
            return
        base = signals.baseline[rows] / self._sensitivity(signals)[rows]
        self.level_ = base.reshape(len(base), len(self.axes)).mean(axis=0)
        vars(self).pop('_pattern', None)

    def learn_warm_rest(
        self, signals: Signals, rows: Bools, disc: Array, warmer: Array, offset: Array
    ) -> None:
        """Learn what rests at other temperatures read.

        Parameters
        ----------
        signals : Signals
            Of the fit.
        rows : ndarray, shape (s,)
            Those that rest.
        disc : ndarray, shape (s,)
            Temperature of the disc (units of 25 degrees from the usual one).
        warmer : ndarray, shape (n,)
            What a unit of it changes at rest (T).
        offset : ndarray, shape (2, n)
            Of every channel, as found by now (T).
        """
        if self.absolute_ or not rows.any():
            return
        rest = WarmRest(self.axes, self.sensitivity, self.usual_)
        rest.offset_ = offset
        base = signals.baseline[rows].reshape(-1, len(self.axes))
        self.rest_ = rest.fit(base, self._chip(signals)[rows], disc[rows], warmer)
        self.level_ = self.rest_.level_
        vars(self).pop('_pattern', None)

    def _chip(self, signals: Signals) -> Array:
        """Temperature of the chips (s,) (units from the usual one); 0 unknown."""
        chip = chip_temperature(signals)
        if chip is None:
            return np.zeros(len(signals.good))
        return np.asarray(np.nan_to_num((chip - self.usual_) / UNIT))

    def drifts(self, signals: Signals) -> Array:
        """How changes follow the drifts of their channels, shape (s, 2); 0 where none is found."""
        if self.rest_ is None or signals.temperature_c is None:
            return np.zeros((len(signals.good), 2))
        base = signals.baseline.reshape(-1, len(self.axes))
        return self.rest_.drifts(self._chip(signals), self.rest_.temperatures(base))

    def unsure_drifts(self, signals: Signals) -> Array:
        """The same, (s, 2); where temperatures of the fit were alike, from that of the tare."""
        if self.warm_ or signals.temperature_c is None or not np.isfinite(self.usual_):
            return self.drifts(signals)
        base = signals.baseline.reshape(-1, len(self.axes))
        steep = UNIT * (self.steepness - REMANENCE_SLOPE)
        tare = 0.0 if self.absolute_ else (1 - self._strength(base)) / steep
        return np.column_stack([self._chip(signals) - tare, np.zeros(len(base))])

    def unsure_drift(self, count: int) -> Array:
        """Covariance (2 m, 2 m) (T2) of drifts of m differences, one power after the other."""
        if self.rest_ is not None:
            return self.rest_.unsure_
        return np.asarray(np.kron(np.diag(OFFSETS**2), np.eye(count)))

    def unsure_chips(self, signals: Signals) -> Array | None:
        """What temperatures (s, t) that are not told now are wrong by (degrees); None: all are."""
        return unsure_chips(signals, self.wander_) if np.isfinite(self.usual_) else None

    def unknown(self, signals: Signals) -> Bools:
        """Rows (s,) whose temperatures may be any of a fit in which they differed, or any."""
        unsure, most = self.unsure_chips(signals), self.wander_[1, -1] / np.sqrt(2)
        if unsure is None:
            return np.zeros(len(signals.good), bool)
        if not self.warm_:  # held ones are as near to those of the fit as they were
            return np.isinf(told_ago(signals)) | (signals.temperature_c is None)
        return np.asarray(unsure.mean(axis=1) > (1 - 1e-9) * most)

    def warmer_chips(self, field: Array, unsure: Array) -> Array:
        """Changes of fields (s, n) (T) where chips are told warmer than they are (s, t)."""
        drift = 0.0 if self.rest_ is None else self.rest_.offset_[0] / UNIT
        every = np.repeat(unsure, len(self.axes) // unsure.shape[1], axis=1)
        return np.asarray((self.steepness * field - drift) * every)

    def _sensitivity(self, signals: Signals) -> Array:
        """Of every reading, shape (s, t, 1); 1 where a fit was told no temperature."""
        if signals.temperature_c is None or not np.isfinite(self.usual_):
            return np.ones((len(signals.good), 1, 1))
        chip, told = signals.temperature_c, np.isfinite(signals.temperature_c)
        if np.count_nonzero(told) < told.size:
            mean = chip_temperature(signals)
            assert mean is not None
            mean = np.where(np.isfinite(mean), mean, self.usual_)
            chip = np.where(told, chip, mean[:, None])
        return sensitivity(chip, self.sensitivity)[..., None]

    @property
    def steepness(self) -> float:
        """Relative change of fields for a degree that the thermometer is wrong by (1 / degree)."""
        warm = self.usual_ + np.array([-0.5, 0.5])
        low, high = sensitivity(warm, self.sensitivity)
        return float((low - high) / (0.5 * (low + high)))

    def change(self, signals: Signals) -> Array:
        """Change of field since rest, or the field, shape (s, n) (T)."""
        shape = (len(signals.good), len(self.axes))
        if signals.temperature_c is None or not np.isfinite(self.usual_):
            return signals.delta.reshape(shape)
        field = signals.values / self._sensitivity(signals)
        if self.absolute_:
            return np.asarray(field.reshape(shape))
        base = signals.baseline.reshape(shape)
        if self.rest_ is not None:
            return self._warm_change(signals, base)
        return np.asarray(field.reshape(shape) - base / self._strength(base)[:, None])

    def _warm_change(self, signals: Signals, base: Array) -> Array:
        """Change of field since a rest at the usual temperature, (s, n) (T)."""
        assert self.rest_ is not None
        field = signals.values.reshape(base.shape) - self.rest_.drift(self._chip(signals))
        field = field.reshape(signals.values.shape) / self._sensitivity(signals)
        warm = self.rest_.temperatures(base)
        return np.asarray(field.reshape(base.shape) - self.rest_.usual_rest(base, warm))

    def _strength(self, base: Array) -> Array:
        """How strong the disc at rest was when baselines (s, n) were read, against the fit."""
        pattern, size = self._pattern
        if size < (CLEAR * self.noise) ** 2:
            return np.ones(len(base))
        found = np.add.reduce(base * pattern, axis=1) / size
        found = np.where(np.isfinite(found), found, 1.0)
        return np.minimum(np.maximum(found, WEAKEST), STRONGEST)

    @cached_property
    def _pattern(self) -> tuple[Array, float]:
        """Level of the disc at rest less its mean over the pixels, shape (n,), and its square."""
        pixels = self.level_.reshape(-1, 2)
        pattern = (pixels - pixels.mean(axis=0)).reshape(-1)
        return pattern, float(pattern @ pattern)


def _noise(signals: Signals, resting: Bools) -> float:
    """Noise of a channel (T) by resting rows (s,); of streams, what changes slowly left aside."""
    size = float(np.sqrt(signals.delta[resting].var(axis=0).mean()))
    if signals.stamp_ns is None or len(resting) < FEWEST_RESTING:
        return size
    # every row of a tare begins a baseline: streams are told apart by their times
    step = sliding_window_view(np.diff(signals.stamp_ns), 3)
    even = (step.min(axis=1) > 0) & (step.max(axis=1) <= UNEVEN * step.min(axis=1))
    even &= sliding_window_view(resting, 4).all(axis=1)
    third = np.diff(signals.values, 3, axis=0)[even]
    if len(third) < FEWEST_RESTING:
        return size
    return min(size, float(np.sqrt((third**2).mean() / THIRD)))


def margins(signals: Signals, config: GradiometerConfig, noise: float) -> Bools:
    """Rows (s,) with a reading so near its limit that noise may hide that it is clipped."""
    if config.saturation is None:
        return np.zeros(len(signals.good), bool)
    limit = np.asarray(config.saturation, float)
    edge = limit - np.minimum(SIGMAS * noise, MOST_MARGIN * limit)
    return np.asarray((np.abs(signals.values) >= edge).any(axis=(1, 2)))


def at_rest(signals: Signals, truth: Columns) -> Bools:
    """Rows (s,) that truth, or the readings, call untouched."""
    force = np.asarray(truth.get('force', np.full((len(signals.good), 3), np.nan)), float)
    free = np.nan_to_num(np.abs(force), nan=0.0).max(axis=1) == 0
    if 'in_contact' in truth:
        return np.asarray(np.asarray(truth['in_contact']) == 0)
    return np.asarray(free | (signals.in_contact == 0))


TILT = 0.03  # rad, beside the tilt that comes with a shift
FEWEST_ROWS = 20
FEWEST_DIFFERENCES = 5
STATES = 30  # of the scene, over which terms are weighed


class Features:
    """Features of one gradiometer, side by side.

    Parameters
    ----------
    config : GradiometerConfig
        Geometry and materials.
    remembers : bool
        What was a while ago is a feature of frames without stamps too, where it is as now.

    Attributes
    ----------
    readings_ : FieldChange
        Changes of field.
    uniform_ : UniformField
        What a uniform field does to the channels.
    place_, tilted_ : DiscInversion or None
        The disc's model without and with tilts of its own.
    terms_ : tuple of Worth
        What terms of the scene cost and buy; none before a fit.
    lag_ : float
        Time constant with which the disc follows the chip's temperature (s).
    tilts_, remembers_ : bool
        Whether tilts, and what was a while ago, are features.
    silent_ : int
        Rows of the fit whose chips told their temperature too long ago to learn from.
    """

    choice_: Choice  # model of the disc's field that the noise needs
    silent_: int = 0

    def __init__(self, config: GradiometerConfig, remembers: bool = False) -> None:
        self.config = config
        self.remembers = remembers
        self.readings_ = FieldChange(config)
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        self.place_: DiscInversion | None = None
        self.tilted_: DiscInversion | None = None
        self.lag_ = config.thermal_lag
        self.tilts_ = self.remembers_ = False
        self.terms_: tuple[Worth, ...] = ()

    @property
    def report(self) -> dict[str, dict[str, float]]:
        """The model of the disc's field, and what terms of the scene cost and buy."""
        told = [self.choice_.report, *(term.report for term in self.terms_)] if self.terms_ else []
        return {name: figures for part in told for name, figures in part.items()}

    def start(self) -> StreamMemory:
        """Fresh memory of a stream."""
        return StreamMemory(self.lag_, self.readings_.wander_, lag_is_told=self.lag_is_told)

    @property
    def lag_is_told(self) -> bool:
        """Whether config or streams of the fit tell how the disc lags, or it matters nowhere."""
        readings = self.readings_
        return not readings.warm_ or self.config.thermal_lag > 0 or len(readings.lags_) > 0

    def fit(
        self, signals: Signals, stray: Array, rest: Bools, touched: Bools, force: Array
    ) -> Array:
        """Learn from frames of which some rest and some are touched; changes (s, n) (T).

        Force (s, 3) (N) is NaN where nothing told it.
        """
        resting = signals.good & (signals.in_contact == 0)
        self.readings_ = FieldChange(self.config).fit(signals, resting)
        self.readings_.warm_ &= self.config.thermal_term
        self.choice_ = field_model(self.config, self.readings_.noise)
        self.terms_ = terms(self.config, max(self.readings_.noise, LEAST_NOISE), STATES)
        if self.readings_.warm_:
            nothing = np.zeros((2, len(self.readings_.axes)))
            self.readings_.learn_warm_rest(
                signals, resting, np.zeros(len(resting)), nothing[0], nothing
            )
        change = self.readings_.change(signals)
        self._learn_uniform(signals, stray, rest & signals.good)
        self.place_ = self.tilted_ = None
        self.lag_ = self.config.thermal_lag
        rows = np.flatnonzero(touched & signals.good & np.isfinite(change).all(axis=1))
        if len(rows) >= FEWEST_ROWS and self.projection.shape[1] >= FEWEST_DIFFERENCES:
            rows = rows[np.lexsort(change[rows].T[::-1])]
            warm_fit = WarmFit(
                signals, self.readings_, lambda: self._disc(0.0),
                lambda lag: self.thermal(signals, StreamMemory(lag))[:, :1].sum(axis=1),
                resting, rows, force,
            )  # fmt: skip
            self.place_ = warm_fit.fit(self.lag_)
            self.lag_, change = warm_fit.lag, warm_fit.change
            warm = self.thermal(signals, self.start())[rows, :1].sum(axis=1)
            self.tilted_ = self._disc(TILT).fit(change[rows], warm)
        self.tilts_ = self.place_ is not None
        self.remembers_ = self.remembers or signals.stamp_ns is not None
        return change

    def _learn_uniform(self, signals: Signals, stray: Array, rows: Bools) -> None:
        """Learn how channels respond to a uniform field, beside what warmth does to them."""
        self.uniform_ = UniformField(self.readings_.axes, self.readings_.noise)
        vars(self).pop('projection', None)
        change = self.readings_.change(_since_tare(signals))
        known = rows & np.isfinite(stray).any(axis=1) & np.isfinite(change).all(axis=1)
        if known.sum() < 3 or np.nanmax(np.abs(stray[known])) == 0:
            return
        told = np.column_stack([change, np.nan_to_num(stray)])[known]
        if self.readings_.warm_:
            lags = (0.0, *self.readings_.lags_)
            warm = [self.thermal(signals, StreamMemory(lag))[known, 0] for lag in lags]
            basis, _ = np.linalg.qr(np.column_stack([np.ones(len(told)), *warm]))
            told = told - basis @ (basis.T @ told)
        self.uniform_.fit(told[:, :-3], told[:, -3:])

    def _disc(self, tilt: float) -> DiscInversion:
        config, noise = self.config, self.readings_.noise
        disc = np.array([config.gap, config.disc_diameter, config.disc_height, config.remanence])
        rows, columns = self.choice_.size
        model = DiscInversion(
            config.positions, self.uniform_.response_, disc, tilt, (rows, columns)
        )
        return model.given(self.projection, noise, absolute=self.readings_.absolute_)

    @cached_property
    def projection(self) -> Array:
        """What a uniform field does not change; all channels, where nothing would be left."""
        differences = self.uniform_.differences
        used = (self.readings_.axes != 0).any(axis=1)
        whole = np.ascontiguousarray(np.eye(len(used))[:, used])
        return differences if differences.shape[1] >= 3 and self.config.stray_term else whole

    def thermal(self, signals: Signals, memory: StreamMemory) -> Array:
        """What `lagging` tells (s, 3); no column where temperatures of the fit were all alike."""
        rows = len(signals.good)
        if not self.readings_.warm_:
            return np.zeros((rows, 0))
        chip = chip_temperature(signals)
        chip = np.full(rows, np.nan) if chip is None else chip
        unsure = self.readings_.unsure_chips(signals)
        unsure = None if unsure is None else unsure.mean(axis=1)
        told = lagging(signals, chip, self.readings_.usual_, memory.thermal, unsure)
        behind: float | Array
        if signals.stamp_ns is None and len(self.readings_.lags_):
            behind = memory.thermal.usually_behind
        elif signals.stamp_ns is not None and memory.slower is not None:
            slower = lagging(signals, chip, self.readings_.usual_, memory.slower, unsure)
            behind = UNIT * (told[:, 0] - slower[:, 0])
        else:
            return told
        told[:, 2] = np.hypot(told[:, 2], behind)
        return told

    def table(
        self, change: Array, thermal: Array, signals: Signals | None, memory: StreamMemory
    ) -> tuple[Array, dict[str, Integers]]:
        """Features (s, f) of changes and temperatures, and which columns are whose.

        Without signals there is no past: it is as now.
        """
        known = {
            'field': change + self.readings_.level_,
            'differences': times(change, self.projection),
        }
        warm = thermal[:, 0] if thermal.shape[1] else None
        if self.place_ is not None:
            known['place'], known['rest'], left = self.place_.explain(change, warm)
            known['uniform'] = self.uniform_.solve(left)[:, self.uniform_.seen]
        known['thermal'], known['doubt'] = thermal[:, :1], thermal[:, 1:2]
        if self.tilts_ and self.tilted_ is not None:
            known['tilted'] = self.tilted_.invert(change, warm)[0]
        elif self.remembers_ and self.tilted_ is not None:
            known['tilted'] = np.zeros((len(change), self.tilted_.unknowns))
        if self.remembers_:
            now = known.get('place', known['differences'])
            known['history'] = np.tile(now, 2) if signals is None else memory.past(signals, now)
        names = tuple((name, part.shape[1]) for name, part in known.items())
        return np.concatenate(list(known.values()), axis=1), _columns(names)

    def use(self, estimators: set[str]) -> None:
        """Leave out what these estimators do not see."""
        self.tilts_ = self.tilts_ and 'inversion_tilt' in estimators
        self.remembers_ = self.remembers_ and 'history' in estimators


def _since_tare(signals: Signals) -> Signals:
    """The same frames over the baselines that their streams began with.

    A baseline that follows drift at rest follows outside fields too.
    """
    start = np.maximum.accumulate(np.where(signals.restart, np.arange(len(signals.good)), 0))
    base = signals.baseline[start]
    return replace(signals, delta=signals.delta + (signals.baseline - base), baseline=base)


@lru_cache(maxsize=16)
def _columns(names: tuple[tuple[str, int], ...]) -> dict[str, Integers]:
    """Columns of parts of these names and widths, side by side; 'where': place, temperatures."""
    ends = np.cumsum([0, *(width for _, width in names)])
    parts = {name: np.arange(ends[i], ends[i + 1]) for i, (name, _) in enumerate(names)}
    spot = parts.get('place', parts['differences'][:3])
    parts['where'] = np.concatenate([spot, parts['thermal']])
    return parts
