"""Learn a recogniser from resting readings and known presses, and choose its road."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import press_vectors
from tactile_ros.estimators.sheet_calibration import (
    KnownPress,
    SheetCalibration,
    SkinModel,
    bands_of,
)
from tactile_ros.sensors.multipole_skin.recogniser import (
    MODEL_ERROR,
    WEAKEST,
    Recogniser,
    Spread,
    fitted_spread,
    usual_misfit,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.estimators.few_shot import PressVectors
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Bools, Integers

ROADS = ('press_templates', 'press_neighbours', 'press_both')
FEWEST = 3  # presses from which chips are mended
MOST = 400  # windows that are kept as supports
MOST_MENDING = 30  # presses by which chips are mended
FOLDS = 5
FAINT = 0.1  # of the drawn resting field: readings that were tared before they came
NOT_THIS = 0.3  # of a press, missed by the model: truth speaks of something else
ERRORS = (0.012, 0.2)
SOMEWHERE = 0.25  # of the sheet: how far presses are made up from its middle
MADE = ((0.0, 0.0, 0.0), (1.0, 0.4, 0.5), (-0.4, 1.0, 1.0), (-1.0, -0.4, 1.5), (0.4, -1.0, 2.0))
CHI_SQUARED_MIDDLE = 0.4549  # median of the square of a normal deviate
TURNINGS = (1.0,)  # other shares of the body's turns that magnets follow, where no press tells
LEAST_STILL = 0.3  # of the noise
SAME = 1e-4  # m, places


@dataclass(frozen=True)
class Told:
    """What truth says of windows (n): NaN and -1 where it does not."""

    label: Integers  # (n,) class
    # (n, 3) and (n,) of the head's origin (m), and its turn (rad)
    place: Array
    yaw: Array
    group: Integers  # (n,) windows that must not be split, where places are not known
    number: Integers  # (n,) of the press that each is a window of

    def rows(self, rows: npt.NDArray[np.intp]) -> Told:
        """Some of them."""
        return Told(*(getattr(self, one.name)[rows] for one in fields(self)))

    @property
    def groups(self) -> Integers:
        """Places, where they are known and more than two; else what must not be split.

        Windows of one press stay together, wherever they were said to be.
        """
        group = self.group
        if np.isfinite(self.place[:, :2]).all() and len(self.place):
            grid = np.round(self.place[:, :2] / SAME)
            places = np.unique(grid, axis=0, return_inverse=True)[1]
            if places.max(initial=0) > 1:
                group = np.asarray(places).reshape(-1)
        _, first, press = np.unique(self.number, return_index=True, return_inverse=True)
        return group[first][np.asarray(press).reshape(-1)]

    @cached_property
    def folds(self) -> Integers:
        """Fold of each window; groups stay together."""
        _, number = np.unique(self.groups, return_inverse=True)
        number = np.asarray(number).reshape(-1)
        order = np.random.default_rng(0).permutation(number.max(initial=-1) + 1)
        return np.asarray(order[number] % FOLDS, np.int64)


def drawn_skin(config: MultipoleSkinConfig) -> SkinModel:
    """Skin as its config draws it."""
    size = np.asarray(config.sheet_size, float)
    chips = np.asarray(config.positions, float)
    bands = bands_of(size, config.pole_pitch, config.magnetisation)
    turned = np.tile(np.eye(3), (len(chips), 1, 1))
    if config.rotations is not None:
        turned = np.swapaxes(np.asarray(config.rotations, float), 1, 2)
    return SkinModel(
        size, config.layer_thickness, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, config.youngs_modulus, min(config.poisson_ratio, 0.4999),
        np.full(bands, config.remanence), 0.0, chips, turned, 0.0,
    )  # fmt: skip


def mended_skin(
    drawn: SkinModel, rest: Array, noise: Array
) -> tuple[SheetCalibration | None, Array | None]:
    """Skin with what its resting readings (t, 3) tell; None: they are of another skin.

    The readings come back where they could be used.
    """
    fit = SheetCalibration(drawn, float(noise.mean()))
    if not np.isfinite(rest).all() or not rest.any():
        return None, None
    if np.linalg.norm(rest) < FAINT * np.linalg.norm(drawn.rest()):
        return fit, None
    return (fit, rest) if fit.fit_rest(rest) else (None, None)


def learned(
    config: MultipoleSkinConfig, rest: Array, noise: Array, windows: list[Array], told: Told,
    dead: Bools,
) -> tuple[Recogniser, dict[str, dict[str, float]]]:  # fmt: skip
    """Recogniser of one skin, and errors on held-out groups.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the skin.
    rest, noise : ndarray, shape (t, 3) and (d,)
        Resting readings, and noise of one (T).
    windows : list of ndarray, shape (w, d)
        Changes of field in presses.
    told : Told
        What is known of them.
    dead : ndarray, shape (t,)
        Chips that say nothing.
    """
    drawn = drawn_skin(config)
    drawn = replace(drawn, responses=np.where(dead[:, None, None], 0.0, drawn.responses))
    fit, used = mended_skin(drawn, rest, noise)
    basis = np.linalg.qr(drawn.common)[0]
    presses = press_vectors(windows, basis)
    outside, error = presses, MODEL_ERROR
    report: dict[str, dict[str, float]] = {}
    if fit is not None:
        outside, error, report = _mended(fit, used, config, presses, told)
    model = None if fit is None else fit.found
    common = drawn.common if model is None else model.common
    recogniser = Recogniser(model, tuple(config.objects), noise, common, error)
    if fit is not None and not fit.turning_told:
        recogniser.turnings = TURNINGS
    whole = np.flatnonzero(np.isfinite(presses.pattern).all(axis=1))
    if len(whole) >= FEWEST:
        recogniser.still_ = max(recogniser.still_, presses.rows(whole).still(noise))
    report.update(choose(recogniser, presses, outside, told))
    return recogniser, report


def _mended(
    fit: SheetCalibration, rest: Array | None, config: MultipoleSkinConfig, presses: PressVectors,
    told: Told,
) -> tuple[PressVectors, float, dict[str, dict[str, float]]]:  # fmt: skip
    """Mend a skin with known presses: these as if it had not seen them, its error, a report."""
    rows = known_presses(config, presses, told)
    error = _expected(fit, rest, config)
    if len(rows) < FEWEST:
        return presses, error, {}
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_MENDING).astype(int))]
    known = [
        KnownPress(
            config.objects[told.label[i]], np.array([*told.place[i, :2], told.yaw[i]]),
            presses.pattern[i], presses.powers[i],
        )
        for i in rows
    ]  # fmt: skip
    rested = fit.found
    fit.fit_presses(rest, known)
    fold = told.folds[rows]
    patterns, shares = fit.left_out(known, fold)
    missed = float(np.sqrt(np.mean(np.square(shares))))
    report = {'skin': {'missed': missed, 'presses': float(len(known))}}
    if missed > NOT_THIS:
        fit.found, fit.turning_told = rested, False
        return presses, error, report
    pattern = presses.pattern.copy()
    pattern[rows] = patterns
    # where all presses are of one place, none of them can be left out
    error = missed if len(np.unique(fold)) > 1 else max(missed, error)
    return replace(presses, pattern=pattern), float(np.clip(error, *ERRORS)), report


def _expected(fit: SheetCalibration, rest: Array | None, config: MultipoleSkinConfig) -> float:
    """Error of a model that its resting readings alone have mended, as a share of a press."""
    if rest is None or not config.objects:
        return MODEL_ERROR
    reach = SOMEWHERE * np.asarray(config.sheet_size, float)
    made = [
        fit.press.made(fit.found, config.objects[0], np.array([*(place * reach), turn]))
        for *place, turn in MADE
    ]
    return float(np.clip(fit.expected(made), *ERRORS))


def known_presses(
    config: MultipoleSkinConfig, presses: PressVectors, told: Told
) -> npt.NDArray[np.intp]:
    """Windows of which head, place and turn are known."""
    posed = np.isfinite(told.place[:, :2]).all(axis=1) & np.isfinite(told.yaw)
    drawn = (told.label >= 0) & (told.label < len(config.objects))
    return np.flatnonzero(posed & drawn & np.isfinite(presses.pattern).all(axis=1))


def choose(
    recogniser: Recogniser, presses: PressVectors, outside: PressVectors, told: Told
) -> dict[str, dict[str, float]]:
    """Keep supports, choose the road that is right most often on held-out places.

    Parameters
    ----------
    recogniser : Recogniser
        Of the skin; it is changed.
    presses, outside : PressVectors
        Windows (n), and as templates see them whose skin was mended without them.
    told : Told
        What is known of them.
    """
    rows = np.array(np.isfinite(presses.pattern).all(axis=1))
    rows[rows] = recogniser.strength(presses.rows(np.flatnonzero(rows))) >= WEAKEST
    rows &= told.label >= 0
    use = np.flatnonzero(rows)
    if not len(use):
        return {}
    use = use[np.unique(np.linspace(0, len(use) - 1, MOST).astype(int))]
    presses, outside, told = presses.rows(use), outside.rows(use), told.rows(use)
    matches = recogniser.matches(presses)
    if recogniser.search is not None and matches is not None:
        recogniser.still_ = _unaveraged(recogniser, presses, matches)
        recogniser.search.let_still(recogniser.still_)
        matches = recogniser.matches(presses)
    recogniser.known_ = recogniser.supports(presses, told.label, matches, told.number)
    unseen = recogniser.matches(outside)
    found = {
        road: trial(recogniser, presses, unseen, told.folds, road)
        for road in _roads(recogniser, told.label)
    }
    right = {road: float((named == told.label).mean()) for road, (named, _) in found.items()}
    # of roads that are as good, the one that needs the least to have been seen
    best = max(found, key=lambda road: (np.round(right[road], 3), -ROADS.index(road)))
    recogniser.road_ = best
    named, misfit = found[best]
    rightly = misfit[(named == told.label) & np.isfinite(misfit)]
    recogniser.usual_, recogniser.vary_ = usual_misfit(rightly, recogniser.freedom)
    report = {'label_by_press': {f'accuracy_{road}': share for road, share in right.items()}}
    if unseen is not None:
        report.update(_placed(recogniser, told, unseen, named))
    return report


def _unaveraged(recogniser: Recogniser, presses: PressVectors, matches: Matches) -> float:
    """Error of patterns that frames do not average (T), at chips that see little of a press."""
    n = np.arange(len(presses.pattern))
    best = matches.cost.argmin(axis=1)
    fitted = matches.fitted[n, best].reshape(len(n), -1, 3)
    miss = presses.pattern.reshape(fitted.shape) - fitted
    here = np.square(fitted).sum(axis=2)
    quiet = here <= np.median(here, axis=1, keepdims=True)
    middle = np.array(
        [np.median(one[chips], axis=0) for one, chips in zip(miss, quiet, strict=True)]
    )
    square = np.square(miss - middle[:, None])
    usual = np.array([np.median(one[chips]) for one, chips in zip(square, quiet, strict=True)])
    usual = usual / CHI_SQUARED_MIDDLE - np.square(recogniser.noise).mean() / presses.frames
    least = LEAST_STILL * float(recogniser.noise.mean())
    return float(np.clip(np.sqrt(max(np.median(usual), 0.0)), least, recogniser.still_))


def _roads(recogniser: Recogniser, labels: Integers) -> tuple[str, ...]:
    """Roads that can name every class: heads that never pressed have templates alone."""
    if recogniser.search is None:
        return ROADS[1:2]
    unseen = set(range(len(recogniser.outlines))) - set(labels.tolist())
    return (ROADS[0], ROADS[2]) if unseen else ROADS


def trial(
    recogniser: Recogniser, presses: PressVectors, matches: Matches | None, fold: Integers,
    road: str,
) -> tuple[Integers, Array]:  # fmt: skip
    """What held-out presses are named, -1 where nothing is near, and their misfits."""
    named, misfit = np.full(len(fold), -1), np.full(len(fold), np.inf)
    for i in np.unique(fold):
        rows = np.flatnonzero(fold == i)
        part = None if matches is None else matches.rows(rows)
        known = recogniser.known_.where(np.flatnonzero(fold != i))
        classes, scores, misfits = recogniser.scores(presses.rows(rows), part, known, road)
        if not len(classes):
            continue
        best = scores.argmin(axis=1)
        named[rows] = np.where(np.isfinite(scores.min(axis=1)), classes[best], -1)
        misfit[rows] = misfits[np.arange(len(rows)), best]
    return named, misfit


def _placed(
    recogniser: Recogniser, told: Told, matches: Matches, named: Integers
) -> dict[str, dict[str, float]]:
    """Errors of place and turn by templates, and what their covariance is too small by.

    Of the head that each press is named, as in use: who errs in the head errs in the place.
    """
    pose, order, sigma, doubt = _stated(recogniser, matches, named)
    place, yaw = told.place[:, :2], told.yaw
    report = {}
    known = np.isfinite(place).all(axis=1) & np.isfinite(pose[:, :2]).all(axis=1)
    if known.any():
        away = (pose[:, :2] - place)[known]
        recogniser.spread_ = fitted_spread(away, sigma[known], doubt[known])
        report['position_by_press'] = {
            'rmse': float(np.sqrt(np.square(away).mean())),
            'median': float(np.median(np.linalg.norm(away, axis=1))),
        }
    turned = np.isfinite(yaw) & np.isfinite(pose[:, 2]) & (order > 0) & (named == told.label)
    if turned.any():
        sector = 2 * np.pi / order[turned]
        off = (pose[turned, 2] - yaw[turned] + sector / 2) % sector - sector / 2
        report['yaw_by_press'] = {
            'rmse': float(np.sqrt(np.square(off).mean())),
            'median': float(np.median(np.abs(off))),
        }
    return report


def _stated(
    recogniser: Recogniser, matches: Matches, named: Integers
) -> tuple[Array, Integers, Array, Array]:
    """Poses, orders, and deviations of places (n, 2): of templates, and by doubt of the heads."""
    scores = recogniser.template_scores(matches)
    found = recogniser.chances(scores, recogniser.template_misfits(matches))
    likely = recogniser.likely(matches, np.arange(scores.shape[1]), *found)
    recogniser.spread_ = Spread(0.0, 0.0)
    beside = recogniser.placed(matches, named, likely)[1][:, (0, 1), (0, 1)]
    recogniser.spread_ = Spread(1.0, 0.0)
    pose, cov, order = recogniser.placed(matches, named, likely)
    own = np.maximum(cov[:, (0, 1), (0, 1)] - beside, 0.0)
    return pose, order, np.sqrt(own), np.sqrt(beside)
