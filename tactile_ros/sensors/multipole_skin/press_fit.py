# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Learn a recogniser from resting readings and labelled presses, and choose its way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.few_shot import Rows, press_patterns
from tactile_ros.estimators.model_selection import spread_rows
from tactile_ros.estimators.sheet_calibration import (
    NODES,
    LabelledPress,
    SheetCalibration,
    SkinModel,
    bands_of,
)
from tactile_ros.sensors.multipole_skin.config import nine_heads
from tactile_ros.sensors.multipole_skin.recogniser import (
    WEAKEST,
    Recogniser,
    readings_of,
)

if TYPE_CHECKING:
    from tactile_ros.estimators.few_shot import Presses
    from tactile_ros.estimators.press_templates import Matches
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Bools, Integers, Report

FEWEST, MOST_FITTED = 3, 30  # presses by which the sheet is fitted
FOLDS = 5
FAINT = 0.1  # of the drawn resting field: readings that were tared before they came
NOT_THIS = 0.3  # of a press, missed by the model: truth speaks of something else
NEAR = 3e-3  # m, from its label, at which a press of an unknown turn is looked for
CHI_SQUARED_MIDDLE = 0.4549  # median of the square of a normal deviate
SAME = 1e-4  # m, places


@dataclass(frozen=True)
class Labels(Rows):
    """Truth of windows (n): NaN and -1 where it is unknown."""

    label: Integers  # (n,) class
    # (n, 3) and (n,) of the head's origin (m), and its turn (rad)
    place: Array
    yaw: Array
    group: Integers  # (n,) windows that must not be split, where places are not known
    number: Integers  # (n,) of the press that each is a window of

    @property
    def groups(self) -> Integers:
        """Places, where they are known and more than two; else what must not be split.

        Windows of one press stay together, wherever they were said to be.
        """
        group = self.group
        if np.isfinite(self.place[:, :2]).all() and len(self.place):
            grid = np.round(self.place[:, :2] / SAME)
            places = np.unique(grid, axis=0, return_inverse=True)[1].reshape(-1)
            if places.max(initial=0) > 1:
                group = places
        _, first, press = np.unique(self.number, return_index=True, return_inverse=True)
        return group[first][press.reshape(-1)]

    @cached_property
    def folds(self) -> Integers:
        """Fold of each window; groups stay together."""
        number = np.unique(self.groups, return_inverse=True)[1].reshape(-1)
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
        np.full(bands, config.remanence), np.zeros((NODES, NODES)), 0.0, chips, turned, 0.0,
    )  # fmt: skip


def rested_skin(
    drawn: SkinModel, rest: Array, noise: Array
) -> tuple[SheetCalibration | None, Array | None]:
    """Skin fitted to resting readings (t, 3), and these where they are of use.

    Neither, where they are of another skin.
    """
    fit = SheetCalibration(drawn, float(noise.mean()))
    if not np.isfinite(rest).all() or not rest.any():
        return None, None
    if np.linalg.norm(rest) < FAINT * np.linalg.norm(drawn.rest()):
        return fit, None
    return (fit, rest) if fit.fit_rest(rest) else (None, None)


def learn(
    config: MultipoleSkinConfig, rest: Array, noise: Array, windows: list[Array], labels: Labels,
    dead: Bools,
) -> tuple[Recogniser, Report]:  # fmt: skip
    """Recogniser of one skin, and errors on held-out groups.

    From resting readings (t, 3) with their noise (d,) (T), windows (w, d) of presses with labels,
    and which chips (t,) are dead.
    """
    drawn = drawn_skin(config)
    drawn = replace(drawn, responses=np.where(dead[:, None, None], 0.0, drawn.responses))
    fit, used = rested_skin(drawn, rest, noise)
    presses = press_patterns(windows, len(noise))
    whole = np.flatnonzero(np.isfinite(presses.pattern).all(axis=1))
    presses, labels = presses.rows(whole), labels.rows(whole)
    heads = tuple(config.objects)
    recogniser = Recogniser(
        None if fit is None else fit.model, heads, noise,
        drawn.common if fit is None else fit.model.common, library=() if heads else nine_heads(),
    )  # fmt: skip
    firm = np.flatnonzero(recogniser.strength(presses) >= WEAKEST)
    presses, labels = presses.rows(firm), labels.rows(firm)
    outside = presses
    report: Report = {}
    if fit is not None and heads:
        if used is not None:
            recogniser.error = fit.expected(heads)
        recogniser, outside, report = _fit_sheet(recogniser, fit, used, presses, labels)
    report.update(choose(recogniser, presses, outside, labels))
    return recogniser, report


def _fit_sheet(
    recogniser: Recogniser, fit: SheetCalibration, rest: Array | None, presses: Presses,
    labels: Labels,
) -> tuple[Recogniser, Presses, Report]:  # fmt: skip
    """Fit the sheet to presses of described heads at labelled places.

    Returns the recogniser of that sheet, presses as if it had not been fitted to them, a report.
    """
    heads = recogniser.outlines
    placed = np.isfinite(labels.place[:, :2]).all(axis=1)
    rows = np.flatnonzero(placed & (labels.label >= 0) & (labels.label < len(heads)))
    if len(rows) < FEWEST:
        return recogniser, presses, {}
    rows = spread_rows(rows, MOST_FITTED)
    matches = recogniser.matches(presses.rows(rows))
    assert matches is not None
    found = matches.pose[np.arange(len(rows)), labels.label[rows], :3]
    turned = np.isfinite(labels.yaw[rows])
    near = np.linalg.norm(found[:, :2] - labels.place[rows, :2], axis=1) < NEAR
    kept = np.flatnonzero(turned | near)
    if len(kept) < FEWEST:
        return recogniser, presses, {}
    variance = presses.variance(recogniser.noise, recogniser.still_)
    known = [
        LabelledPress(
            heads[labels.label[rows[i]]],
            np.array([*labels.place[rows[i], :2],
                      labels.yaw[rows[i]] if turned[i] else found[i, 2]]),
            bool(turned[i]), presses.pattern[rows[i]], variance[rows[i]],
        )
        for i in kept
    ]  # fmt: skip
    fit.fit_presses(rest, known)
    patterns, missed = fit.held_out(known, labels.folds[rows[kept]])
    report = {'sheet': {'missed': missed, 'presses': float(len(known))}}
    if missed > NOT_THIS:
        return recogniser, presses, report
    error = max(missed, fit.expected(heads))
    fitted = recogniser.changed(
        model=fit.model, common=fit.model.common, error=error, turnings=(fit.model.turning,)
    )
    outside = presses.pattern.copy()
    outside[rows[kept]] = patterns
    return fitted, replace(presses, pattern=outside), report


def choose(recogniser: Recogniser, presses: Presses, outside: Presses, labels: Labels) -> Report:
    """Keep supports, and choose the way that is right most often on held-out presses.

    `presses` are windows (n), `outside` the same as templates see them whose skin was fitted
    without them; the recogniser is changed.
    """
    use = np.flatnonzero(labels.label >= 0)
    if not len(use):
        return {}
    presses, outside, labels = presses.rows(use), outside.rows(use), labels.rows(use)
    matches = recogniser.matches(presses)
    if matches is not None:
        recogniser.still_ = _unaveraged(recogniser, presses, matches)
    recogniser.known_ = recogniser.supports(presses, labels.label, labels.number)
    unseen = recogniser.matches(outside)
    ways, fold = ('press_neighbours', 'prototypes'), labels.number % FOLDS
    if recogniser.described:
        ways, fold = ('press_templates', 'press_both'), labels.folds
    found = {way: _validated(recogniser, presses, unseen, fold, way) for way in ways}
    shares = {way: float((named == labels.label).mean()) for way, named in found.items()}
    if recogniser.described and labels.label.max() >= len(recogniser.outlines):
        shares['press_templates'] = 0.0  # they cannot name all
    # of ways that are as good, the one that needs the least to have been seen
    best = max(ways, key=lambda way: round(shares[way], 3))
    recogniser.road_ = best
    report = {'label_by_press': {f'accuracy_{way}': shares[way] for way in ways}}
    if recogniser.described:
        assert unseen is not None
        report.update(_placed(recogniser, labels, unseen, presses, found[best]))
    return report


def _unaveraged(recogniser: Recogniser, presses: Presses, matches: Matches) -> float:
    """Error of patterns that frames do not average (T), at chips that see little of a press."""
    n = np.arange(len(presses.pattern))
    best = matches.cost.argmin(axis=1)
    fitted = matches.fitted[n, best].reshape(len(n), -1, 3)
    here = np.square(fitted).sum(axis=2)
    quiet = here <= np.median(here, axis=1, keepdims=True)
    miss = np.where(quiet[..., None], presses.pattern.reshape(fitted.shape) - fitted, np.nan)
    square = np.square(miss - np.nanmedian(miss, axis=1, keepdims=True))
    usual = np.nanmedian(square, axis=(1, 2)) / CHI_SQUARED_MIDDLE
    usual -= np.square(recogniser.noise).mean() / presses.frames
    return float(np.sqrt(max(np.median(usual), 0.0)))


def _validated(
    recogniser: Recogniser, presses: Presses, matches: Matches | None, fold: Integers, way: str
) -> Integers:
    """Names of held-out presses, -1 where nothing is near."""
    named = np.full(len(fold), -1)
    for i in np.unique(fold):
        rows = np.flatnonzero(fold == i)
        supports = recogniser.evidence_by(recogniser.known_.rows(np.flatnonzero(fold != i)), way)
        some = None if matches is None else matches.rows(rows)
        classes, scores, _ = recogniser.scores(presses.rows(rows), some, supports, way)
        if len(classes):
            near = np.isfinite(scores.min(axis=1))
            named[rows] = np.where(near, classes[scores.argmin(axis=1)], -1)
    return named


def _placed(
    recogniser: Recogniser, labels: Labels, matches: Matches, presses: Presses, named: Integers
) -> Report:
    """Errors of place and turn of held-out presses, by which their covariance is scaled.

    Of the head that each press is named, as in use: who errs in the head errs in the place.
    """
    pose, stated, order = recogniser.placed(matches, named)
    error = np.full((len(named), 3), np.nan)
    error[:, :2] = pose[:, :2] - labels.place[:, :2]
    sector = 2 * np.pi / np.maximum(order, 1)
    turned = (order > 0) & (named == labels.label)
    off = (pose[:, 2] - labels.yaw + sector / 2) % sector - sector / 2
    error[turned, 2] = off[turned]
    recogniser.covariance_ = CovarianceModel().fit(
        error, stated, labels.groups, readings_of(presses)
    )
    report: Report = {}
    size = np.linalg.norm(error[:, :2], axis=1)
    for name, each in (('position', size), ('yaw', np.abs(error[:, 2]))):
        known = each[np.isfinite(each)]
        if len(known):
            rmse = float(np.sqrt(np.square(known).mean()))
            report[f'{name}_by_press'] = {'rmse': rmse, 'median': float(np.median(known))}
    return report
