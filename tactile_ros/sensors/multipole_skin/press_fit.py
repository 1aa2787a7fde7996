"""Learn a recogniser from resting readings and known presses, and choose its road."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.press_window import press_vectors
from tactile_ros.estimators.skin_fit import KnownPress, SkinFit
from tactile_ros.estimators.skin_model import SkinModel, bands_of
from tactile_ros.sensors.multipole_skin.recogniser import MODEL_ERROR, Recogniser

if TYPE_CHECKING:
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Integers

ROADS = ('press_templates', 'press_neighbours', 'press_both')
FEWEST = 3  # presses from which chips are mended
MOST = 400  # presses that are kept as supports
FOLDS = 5
FAINT = 0.1  # of the drawn resting field: readings that were tared before they came
NOT_THIS = 0.3  # of a press, missed by the model: truth speaks of something else
CAREFUL = 1.3  # errors of presses that were not fitted over those that were
WIDER = 1.6  # errors of place of presses that come over those that the skin was mended with
ERRORS = (0.012, 0.2)
CHI_SQUARED_MIDDLE = 0.4549  # median of the square of a normal deviate
LEAST_STILL = 0.3  # of the noise
SAME = 1e-4  # m, places


@dataclass(frozen=True)
class Told:
    """Presses (n) with what truth says of them: NaN and -1 where it does not.

    Attributes
    ----------
    presses : PressVectors
        Of one skin.
    label : ndarray, shape (n,)
        Class.
    place, yaw : ndarray, shape (n, 3) and (n,)
        Of the head's origin (m), and its turn (rad).
    group : ndarray, shape (n,)
        Presses that must not be split, where places are not known.
    """

    presses: PressVectors
    label: Integers
    place: Array
    yaw: Array
    group: Integers

    @property
    def groups(self) -> Integers:
        """Places, where they are known and more than two; else what must not be split."""
        if np.isfinite(self.place[:, :2]).all() and len(self.place):
            grid = np.round(self.place[:, :2] / SAME)
            places = np.unique(grid, axis=0, return_inverse=True)[1]
            if places.max(initial=0) > 1:
                return np.asarray(places).reshape(-1)
        return self.group


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
) -> tuple[SkinFit | None, Array | None]:
    """Skin with what its resting readings (t, 3) tell; None: they are of another skin.

    The readings come back where they could be used.
    """
    fit = SkinFit(drawn, float(noise.mean()))
    if not np.isfinite(rest).all() or not rest.any():
        return None, None
    if np.linalg.norm(rest) < FAINT * np.linalg.norm(drawn.rest()):
        return fit, None
    return (fit, rest) if fit.fit_rest(rest) else (None, None)


def learned(
    config: MultipoleSkinConfig, rest: Array, noise: Array, windows: list[Array],
    label: Integers, place: Array, yaw: Array, group: Integers,
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
    label, place, yaw, group : ndarray
        As in `Told`.
    """
    drawn = drawn_skin(config)
    fit, used = mended_skin(drawn, rest, noise)
    basis = np.linalg.qr(drawn.common)[0]
    told = Told(press_vectors(windows, basis), label, place, yaw, group)
    error = MODEL_ERROR
    report: dict[str, dict[str, float]] = {}
    if fit is not None:
        rested, known = fit.found, known_presses(config, told)
        if len(known) >= FEWEST:
            fit.fit_presses(used, known)
            report['skin'] = {'missed': fit.missed, 'presses': float(len(known))}
            if fit.missed > NOT_THIS:
                fit.found = rested
            else:
                error = float(np.clip(CAREFUL * fit.missed, *ERRORS))
    model = None if fit is None else fit.found
    common = drawn.common if model is None else model.common
    recogniser = Recogniser(model, tuple(config.objects), noise, common, error)
    whole = np.flatnonzero(np.isfinite(told.presses.pattern).all(axis=1))
    if len(whole) >= FEWEST:
        still = told.presses.rows(whole).still(noise)
        recogniser.still_ = max(recogniser.still_, still)
    report.update(choose(recogniser, told))
    return recogniser, report


def known_presses(config: MultipoleSkinConfig, told: Told) -> list[KnownPress]:
    """Presses of which head, place and turn are known."""
    found = []
    for i, label in enumerate(told.label):
        if not 0 <= label < len(config.objects):
            continue
        pose = np.array([*told.place[i, :2], told.yaw[i]])
        whole = np.isfinite(pose).all() and np.isfinite(told.presses.pattern[i]).all()
        if whole:
            press = told.presses
            found.append(
                KnownPress(config.objects[label], pose, press.pattern[i], press.powers[i])
            )
    return found


def choose(recogniser: Recogniser, told: Told) -> dict[str, dict[str, float]]:
    """Keep supports, choose the road that is right most often on held-out places."""
    rows = np.array(np.isfinite(told.presses.pattern).all(axis=1))
    rows[rows] = recogniser.strength(told.presses.rows(np.flatnonzero(rows))) >= 5
    rows &= told.label >= 0
    use = np.flatnonzero(rows)
    if not len(use):
        return {}
    use = use[np.unique(np.linspace(0, len(use) - 1, MOST).astype(int))]
    presses, labels = told.presses.rows(use), told.label[use]
    matches = recogniser.matches(presses)
    if recogniser.search is not None and matches is not None:
        recogniser.still_ = _unaveraged(recogniser, presses, matches)
        recogniser.search.still = recogniser.still_
        matches = recogniser.matches(presses)
    recogniser.known_ = recogniser.supports(presses, labels, matches)
    fold = _folds(told.groups[use])
    found = {}
    for road in _roads(recogniser, labels):
        right, misfit = trial(recogniser, presses, labels, matches, fold, road)
        found[road] = right, misfit
    # of roads that are as good, the one that needs the least to have been seen
    best = max(found, key=lambda road: (np.round(found[road][0], 3), -ROADS.index(road)))
    recogniser.road_ = best
    recogniser.worst_ = float(np.clip(3 * found[best][1], 5.0, 50.0))
    report = {'label_by_press': {f'accuracy_{road}': right for road, (right, _) in found.items()}}
    if matches is not None:
        report.update(_placed(recogniser, told, use, matches, labels))
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


def _folds(groups: Integers) -> Integers:
    """Fold of each press; groups stay together."""
    _, number = np.unique(groups, return_inverse=True)
    number = np.asarray(number).reshape(-1)
    order = np.random.default_rng(0).permutation(number.max(initial=0) + 1)
    return np.asarray(order[number] % FOLDS)


def trial(
    recogniser: Recogniser, presses: PressVectors, labels: Integers, matches: Matches | None,
    fold: Integers, road: str,
) -> tuple[float, float]:  # fmt: skip
    """Share of held-out presses named rightly, and the misfit that nineteen of twenty keep."""
    right, misfit = np.zeros(len(labels), bool), np.full(len(labels), np.inf)
    for i in np.unique(fold):
        rows = np.flatnonzero(fold == i)
        part = None if matches is None else _part(matches, rows)
        known = recogniser.known_.where(np.flatnonzero(fold != i))
        classes, scores, misfits = recogniser.scores(presses.rows(rows), part, known, road)
        if not len(classes):
            continue
        best = scores.argmin(axis=1)
        right[rows] = (classes[best] == labels[rows]) & np.isfinite(scores.min(axis=1))
        misfit[rows] = misfits[np.arange(len(rows)), best]
    finite = misfit[np.isfinite(misfit) & right]
    return float(right.mean()), float(np.quantile(finite, 0.95)) if len(finite) else 1.0


def _part(matches: Matches, rows: Integers) -> Matches:
    """Matches of some presses."""
    names = ('cost', 'pose', 'cov', 'slopes', 'fitted')
    return type(matches)(*(getattr(matches, name)[rows] for name in names))


def _placed(
    recogniser: Recogniser, told: Told, use: Integers, matches: Matches, labels: Integers
) -> dict[str, dict[str, float]]:
    """Errors of place and turn by templates, and what their covariance is too small by."""
    pose, cov, order = recogniser.placed(matches, labels)
    place, yaw = told.place[use, :2], told.yaw[use]
    report = {}
    known = np.isfinite(place).all(axis=1) & np.isfinite(pose[:, :2]).all(axis=1)
    if known.any():
        away = (pose[:, :2] - place)[known]
        sigma = np.sqrt(np.stack([cov[known, 0, 0], cov[known, 1, 1]], axis=1))
        ratio = np.abs(away / np.maximum(sigma, 1e-12))
        # the middle of the errors decides: a wrong head is another matter
        recogniser.spread_ *= WIDER * float(np.clip(np.median(ratio) / 0.6745, 0.3, 20.0))
        report['position_by_press'] = {
            'rmse': float(np.sqrt(np.square(away).mean())),
            'median': float(np.median(np.linalg.norm(away, axis=1))),
        }
    turned = np.isfinite(yaw) & (order > 0)
    if turned.any():
        sector = 2 * np.pi / order[turned]
        off = (pose[turned, 2] - yaw[turned] + sector / 2) % sector - sector / 2
        report['yaw_by_press'] = {
            'rmse': float(np.sqrt(np.square(off).mean())),
            'median': float(np.median(np.abs(off))),
        }
    return report
