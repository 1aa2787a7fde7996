"""Covariance of the pad beyond what its recording covers, and flags of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.sensors.magnet_pad.nominal_estimator import STRAY, SubthresholdForce
from tactile_ros.types import Array, FrameStatus, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Bools, Columns, Report, Signals

HALF = 0.5  # of the largest load: lighter touches are the lesson, heavier ones the test
FEWEST, RATIO = 40, 1.5  # light and heavy touches, and the largest load over the least, that tell
MOST = 300  # touches of each that are looked at
UNTOLD = (0.1, 0.3)  # radii and share of a force, the largest load farther on: as of specimens
QUANTILES = {1: 0.6827, 2: 0.9545}  # of what is normal, inside so many sigmas


@dataclass(frozen=True)
class LoadExtrapolation:
    """Loads of a recording, and how errors grow where a load is farther by the largest of them."""

    # of the recording (N)
    least: float
    most: float
    radius: float  # of the pad (m)
    # of what is stated: standard deviations that are added
    times_place: float = 0.0
    times_force: float = 0.0
    told: bool = False  # whether the loads told it; else `extrapolation_covariance` does

    def beyond(self, load: Array) -> Array:
        """Distance (s,) of loads (N) from those recorded, over the largest of them."""
        outside = np.maximum(load - self.most, self.least - load)
        return np.asarray(np.maximum(outside, 0.0) / self.most)

    def widen(self, mean: Array, cov: Array) -> None:
        """Add to covariances (s, 6, 6) of places (m) and forces (N) what loads ask for."""
        force = mean[:, 3:]
        away = self.beyond(np.sqrt(np.add.reduce(force * force, axis=1)))
        rows = np.flatnonzero(away)
        if not len(rows):
            return
        far = away[rows]
        wider = np.repeat([self.times_place, self.times_force], 3) * far[:, None]
        wider = np.sqrt(1 + wider * wider)
        cov[rows] *= wider[:, :, None] * wider[:, None, :]
        if not self.told:
            cov[rows] += extrapolation_covariance(mean[rows], far, self.radius)


def extrapolation_covariance(mean: Array, far: Array, radius: float) -> Array:
    """Covariance (s, 6, 6) of places and forces (s, 6) at distances of which nothing is known.

    Distances are over the largest load, or over the radius (m) of the pad.
    """
    place, share = UNTOLD
    cov, force = np.zeros((len(mean), 6, 6)), share * far[:, None] * mean[:, 3:]
    cov[:, :3, :3] = (place * radius * far)[:, None, None] ** 2 * np.eye(3)
    cov[:, 3:, 3:] = force[:, :, None] * force[:, None, :]
    return cov


def split(load: Array) -> tuple[Integers, Integers] | None:
    """Some rows of the lighter and of the heavier loads (s,); None where they tell nothing."""
    light, heavy = (np.flatnonzero((load <= HALF * load.max()) == part) for part in (True, False))
    if min(len(light), len(heavy)) < FEWEST or load[light].max() < RATIO * load[light].min():
        return None
    return light[:: -(-len(light) // MOST)], heavy[:: -(-len(heavy) // MOST)]


def growth(away: Array, error: Array) -> float:
    """Sigmas that are to be added at a distance of 1.

    Parameters
    ----------
    away, error : ndarray, shape (s,) and (s, k)
        Distances from the loads that were learned from; errors over what is stated of them.
    """
    tried = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 61)])
    wider = np.sqrt(1 + (tried[:, None] * away) ** 2)[:, :, None]
    # what is normal in the middle may not be so in its tails
    enough = np.logical_and.reduce(
        [
            np.quantile(np.abs(error) / wider, share, axis=(1, 2)) <= sigmas
            for sigmas, share in QUANTILES.items()
        ]
    )
    return float(tried[np.argmax(enough)] if enough.any() else tried[-1])


KIND = 'not told: '
ENDS = ('least', 'most')
UPRIGHT = 1e-3  # of a force along the axis (rms): touches below it press along the normal
LEANS = 0.1  # the same of the nominal touches, of which a quarter lean by up to 0.5 rad
FAR, NODES = 0.5, (41, 21)  # radii to the next touch; places that are asked
GAP = 0.02  # share of the surface
WARMER = 3.0  # degrees beyond those of the fit: the resting field changes by several noises


def upright(force: Array) -> bool:
    """Whether forces (s, 3) (N), where they are known, never have a part along the axis."""
    known = force[np.isfinite(force).all(axis=1)]
    return bool(len(known)) and bool((known[:, 0] ** 2).sum() < UPRIGHT**2 * (known**2).sum())


def lonely(config: MagnetPadConfig) -> Report:
    """What one chip alone leaves open, where a scene has fields from outside."""
    if len(config.positions) > 1 or not config.stray_term:
        return {}
    return {f'{KIND}outside fields (one chip takes most of them for touches)': {}}


def temperatures(signals: Signals) -> tuple[float, float]:
    """Least and highest temperature of chips in good rows (degrees Celsius); NaN: none told."""
    chips = signals.temperature_c
    known = np.zeros(0) if chips is None else chips[signals.good]
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)


def elsewhere(span: tuple[float, ...]) -> Report:
    """Temperatures that nothing was recorded at; () before a fit."""
    if not span:
        return {}
    if not np.isfinite(span).all():
        return {f'{KIND}temperature (no chip told one)': {}}
    return {f'{KIND}temperatures beyond those recorded (C)': dict(zip(ENDS, span, strict=True))}


def outside(span: tuple[float, ...], signals: Signals) -> Bools:
    """Rows (s,) of which a chip is clearly warmer or colder than in the fit."""
    chips = signals.temperature_c
    if chips is None or not span:
        return np.zeros(len(signals.good), bool)
    low, high = span
    return np.asarray(((chips < low - WARMER) | (chips > high + WARMER)).any(axis=1))


def untold(config: MagnetPadConfig, touches: Array) -> Report:
    """What touches (s, 5) leave open; columns as `PadInversion.touches_` has them."""
    ends = (float(np.exp(find(touches[:, 2]))) for find in (np.min, np.max))
    found = {f'{KIND}loads beyond those recorded (N)': dict(zip(ENDS, ends, strict=True))}
    share = untouched(config, touches)
    if share > GAP:
        found[f'{KIND}places half a radius from the next touch'] = {'share of the pad': share}
    return found


def untouched(config: MagnetPadConfig, touches: Array) -> float:
    """Share of the pad, as seen from above, that is far from all touches (s, 5)."""
    unit = np.array([1 / config.radius, 1.0])
    along = config.length * np.linspace(-0.5, 0.5, NODES[0])
    around = np.arccos(np.linspace(-1.0, 1.0, NODES[1]))
    places = np.stack(np.meshgrid(along, around), axis=-1).reshape(-1, 2)
    far = cKDTree(touches[:, :2] * unit).query(places * unit)[0]
    return float((far > FAR).mean())


SPARSE = 0.5  # share of the pad that is far from all touches: regressors are not judged there
LIGHT = 1e-9  # N


@dataclass(frozen=True)
class TrainingCoverage:
    """Of the places and loads that truth tells.

    Attributes
    ----------
    untouched : float
        Share of the pad that no touch came near; 0 where places were not told.
    """

    untouched: float = 0.0
    ratio: float = np.inf  # largest load over the least; infinite where loads were not told

    @classmethod
    def of(cls, config: MagnetPadConfig, truth: Columns, good: Bools) -> TrainingCoverage:
        """Of good rows (s,) of a truth."""
        share, ratio = 0.0, np.inf
        place, force = (_known(truth, name, good) for name in ('position', 'force'))
        if len(place):
            around = np.arctan2(place[:, 2], place[:, 1])
            share = untouched(config, np.column_stack([place[:, 0], around]))
        if len(force):
            load = np.linalg.norm(force, axis=1)
            ratio = float(load.max() / max(float(load.min()), LIGHT))
        return cls(share, ratio)

    @property
    def enough(self) -> bool:
        """Whether held-out touches say what regressors err by."""
        return self.untouched <= SPARSE and self.ratio >= RATIO

    @property
    def report(self) -> Report:
        """What regressors were never asked, a sentence for each."""
        found: Report = {}
        if self.untouched > SPARSE:
            share = {'share of the pad': self.untouched}
            found[f'{KIND}places half a radius from the next touch'] = share
        if self.ratio < RATIO:
            found[f'{KIND}loads other than one'] = {'most over least': self.ratio}
        return found

    def widen(self, known: Columns, config: MagnetPadConfig, targets: tuple[str, ...]) -> None:
        """Widen covariances of regressors, in place, by what a pad's places and loads may be."""
        if 'position' in targets and self.untouched > SPARSE:
            spread = np.array([config.length**2 / 12, config.radius**2 / 3, config.radius**2 / 12])
            cov = np.asarray(known['position_cov'], np.float64)
            known['position_cov'] = cov + np.diag(self.untouched * spread)
        if 'force' in targets and not self.enough:
            force = np.asarray(known['force'], np.float64)
            size = np.nansum(force * force, axis=1)[:, None, None]
            known['force_cov'] = np.asarray(known['force_cov'], np.float64) + size * np.eye(3)


def _known(truth: Columns, name: str, good: Bools) -> Array:
    """Rows of a column that are good and wholly told."""
    column = np.asarray(truth.get(name, np.full((len(good), 3), np.nan)), np.float64)
    return np.asarray(column[good & np.isfinite(column).all(axis=1)])


MARGIN = 1.1  # times the recorded forces: beyond them by chance
FIELDS = 3.0  # times the usual, of a component of a stray field
NOTHING = 0.5  # of how places spread over the pad: as unsure a place tells nothing
OUT_OF_RANGE, STRAY_FIELD = (
    np.int64(bit) for bit in (FrameStatus.OUT_OF_RANGE, FrameStatus.STRAY_FIELD)
)


def span_of(touches: Array) -> tuple[float, float]:
    """Sizes of forces (N), least and largest, of touches (s, 5) of `PadInversion.touches_`."""
    size = np.exp(touches[:, 2]) * np.sqrt(1 + (touches[:, 3:] ** 2).sum(axis=1))
    return float(size.min()), float(size.max())


def flag(known: Columns, touched: Bools, span: tuple[float, float] | None, length: float) -> None:
    """Add `status`, bits of `FrameStatus`, where an answer goes beyond what can be believed.

    Frames that neither a touch nor a field of the usual size explains, and whose place is all
    but unknown, are not `valid`.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Answers; changed in place. `odd` (s,), 1 where nothing explains a reading, is taken out.
    touched : ndarray of bool, shape (s,)
        Rows that may be touched.
    span : tuple of float, or None
        Least and largest force that was recorded (N); None: there is none.
    length : float
        Of the pad (m).
    """
    status = np.zeros(len(touched), np.int64)
    odd = touched & (np.asarray(known.pop('odd', status)) == 1)
    if np.count_nonzero(odd):
        status += odd * STRAY_FIELD
        along = np.asarray(known['position_cov'], np.float64)[:, 0, 0]
        known['valid'] = ~(odd & (along > (NOTHING * length) ** 2 / 12))
    if span is not None and 'force' in known:
        force = np.asarray(known['force'], np.float64)
        square = np.add.reduce(force * force, axis=1)
        least, most = (span[0] / MARGIN) ** 2, (span[1] * MARGIN) ** 2
        status += (touched & ((square < least) | (square > most))) * OUT_OF_RANGE
    if 'stray_field' in known:
        field = np.maximum.reduce(np.abs(known['stray_field']), axis=1)
        status |= (field > FIELDS * STRAY) * STRAY_FIELD
    if np.count_nonzero(status):
        known['status'] = status


class CoverageCovariance:
    """Of one recording.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.

    Attributes
    ----------
    coverage_ : TrainingCoverage
        How much recorded touches differ.
    upright_ : bool
        Whether no recorded force had a part along the axis.
    subthreshold_ : SubthresholdForce or None
        What regressors of force hide at rest, by recorded touches.
    span_ : tuple of float
        Least and highest temperature of the chips (degrees Celsius), NaN: none told; () unfitted.
    """

    span_: tuple[float, ...] = ()

    def __init__(self, config: MagnetPadConfig) -> None:
        self.config = config
        self.coverage_ = TrainingCoverage()
        self.upright_ = False
        self.subthreshold_: SubthresholdForce | None = None

    def fit(self, signals: Signals, x: Array, truth: Columns, noise: float) -> CoverageCovariance:
        """Learn from frames, their readings x (s, d) (T) and their truth; noise of a channel."""
        good, self.span_ = signals.good, temperatures(signals)
        self.coverage_ = TrainingCoverage.of(self.config, truth, good)
        if 'force' in truth:
            force = np.asarray(truth['force'], np.float64)
            self.upright_ = upright(force[good])
            known = good & np.isfinite(x).all(axis=1) & np.isfinite(force).any(axis=1)
            if known.any():
                felt = np.nan_to_num(force[known])
                self.subthreshold_ = SubthresholdForce(x[known], felt, noise)
        return self

    @property
    def report(self) -> Report:
        """What was not told, a sentence for each."""
        leans: Report = {f'{KIND}forces along the surface': {'sigma over load': LEANS}}
        return {**(leans if self.upright_ else {}), **self.coverage_.report}

    @property
    def scene(self) -> Report:
        """What neither touches nor the nominal model tell, a sentence for each."""
        return {**lonely(self.config), **elsewhere(self.span_)}

    def mark(self, known: Columns, signals: Signals) -> Columns:
        """The same answers, flagged where chips are warmer or colder than any of the fit."""
        rows = outside(self.span_, signals)
        if np.count_nonzero(rows):
            status = np.asarray(known.get('status', np.zeros(len(rows), np.int64)), np.int64)
            known['status'] = status | rows * OUT_OF_RANGE
        return known

    def widen(
        self, known: Columns, rest: Bools, x: Array, modelled: tuple[str, ...],
        hidden: Callable[[Array], Array],
    ) -> None:  # fmt: skip
        """Widen covariances, in place.

        Parameters
        ----------
        known : dict of str to ndarray, shape (s, ...)
            Answers.
        rest, x : ndarray, shape (s,) and (s, d)
            Rows that nothing touches; readings (T).
        modelled : tuple of str
            Targets that the response of the pad answers; regressors answer the others.
        hidden : callable
            Of readings at rest, the covariance of saying that nothing touches (N2).
        """
        regressed = tuple(name for name in known if name not in modelled)
        self.coverage_.widen(known, self.config, regressed)
        if 'force_cov' not in known:
            return
        cov = np.array(known['force_cov'], np.float64)
        size = np.square(np.asarray(known['force'], np.float64)).sum(axis=1)
        if np.count_nonzero(rest):
            rows = np.flatnonzero(rest & np.isfinite(x).all(axis=1))
            cov[rows] = hidden(x[rows])
            size[rows] = np.trace(cov[rows], axis1=1, axis2=2)
        if self.upright_:
            # what leans was never seen: its share of forces is that of the nominal touches
            cov[:, 0, 0] += LEANS**2 * size
        known['force_cov'] = cov
