# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Label, place and turn from the pattern of one press: templates, known presses, or both.

Templates come from the model of the skin, so that described heads are recognised at places and
turns where nothing ever pressed. Known presses are supports of their class, compared in a metric
in which place, turn and depth cost little; heads that nobody described have a described one, or
one of a small library, as a stand-in for what these do. The best score of a class counts.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

import numpy as np

from tactile_ros.estimators.embedding import Embedding
from tactile_ros.estimators.few_shot import (
    SupportSet,
    prototype_scores,
    share_of,
    support_scores,
    without_field,
)
from tactile_ros.estimators.press_templates import PressBank
from tactile_ros.estimators.prototypes import Prototypes

if TYPE_CHECKING:
    from tactile_ros.estimators.covariance import CovarianceModel
    from tactile_ros.estimators.few_shot import Presses
    from tactile_ros.estimators.press_templates import Matches
    from tactile_ros.estimators.sheet_calibration import SkinModel
    from tactile_ros.types import Array, Bools, Integers, Outline

NONE = 0.1  # how often something presses that is none of the classes
UNLIKE = 4.6  # logarithm of the misfit, over which that is spread: a factor of a hundred
VARY = 0.8  # deviation of that logarithm of classes about 0
BANKS: WeakValueDictionary[tuple[bytes, ...], PressBank] = WeakValueDictionary()  # those in use


def press_bank(model: SkinModel, heads: tuple[Outline, ...]) -> PressBank:
    """Templates of heads on a skin; those of a file that is read again are the same object."""
    parts = [getattr(model, part.name) for part in fields(model)]
    for head in heads:
        parts += [*head.loops, head.thickness or 0.0, head.bend or 0.0]
    key = tuple(np.asarray(part).tobytes() for part in parts)
    bank = BANKS.get(key)
    if bank is None:
        bank = BANKS[key] = PressBank(model, heads)
    return bank


def class_chances(scores: Array, misfits: Array) -> tuple[Array, Array]:
    """Probabilities of classes, shape (n, k), and that it is none of them (n,).

    Scores (n, k) are twice the negative log-likelihood, inf: far away; misfits (n, k) are over
    their variance. What is none of the classes fits anyhow, within a wide factor; classes as their
    variance says, or better.
    """
    n, best = np.arange(len(scores)), scores.argmin(axis=1)
    near = np.isfinite(scores[n, best])
    low, misfit = np.where(near, scores[n, best], 0.0), np.where(near, misfits[n, best], 1.0)
    away = np.log(np.maximum(misfit, 1.0)) / VARY
    fits = np.exp(-0.5 * np.square(away)) / (np.sqrt(2 * np.pi) * VARY)
    none = np.where(near, NONE / UNLIKE / (NONE / UNLIKE + (1 - NONE) * fits), 1.0)
    # where nothing fits well, differences of misfits say less
    likely = np.exp(-0.5 * (scores - low[:, None]) / np.maximum(misfit, 1.0)[:, None])
    total = np.maximum(likely.sum(axis=1), 1e-30)
    return ((1 - none) / total)[:, None] * likely, none


TRAINED = ('shapes', 'postures')
FRAMES, CHANNELS = 10, 60  # of a window


def pronet(what: str) -> Embedding:
    """Network for 'shapes' of heads or 'postures' of a bar; ValueError for anything else.

    It knows the skin that `training/pronet.py` trained it on, and no other.
    """
    if what not in TRAINED:
        msg = f'what of pronet must be one of {", ".join(TRAINED)}; received {what!r}'
        raise ValueError(msg)
    return Embedding(Path(__file__).with_name(f'pronet_{what}.onnx'))


NETWORKS = tuple(f'pronet_{what}' for what in TRAINED)
FOLDS = 5
FEWEST = 3  # presses
FARTHEST = 2.0  # over the distance that nineteen of twenty held-out presses keep
ENOUGH = 0.95


class NetworkClasses:
    """Classes of known presses by one network, one of `TRAINED`.

    A prototype of [1] is the mean of a class at the place of the task. Where presses of many
    places are known, each place has prototypes of its own, and the nearest one names a press.
    """

    prototypes_: Prototypes  # numbered one by one; `label_` (m,) says of which class each is
    label_: Integers
    right: float  # share of held-out presses that are named rightly; 0: none could be held out
    worst_: float  # distance beyond which no class fits

    def __init__(self, what: str) -> None:
        self.what = what
        self.right, self.worst_ = 0.0, np.inf

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return f'pronet_{self.what}'

    @cached_property
    def network(self) -> Embedding:
        """Read when it is first asked."""
        return pronet(self.what)

    def fit(self, windows: list[Array], label: Integers, groups: Integers) -> NetworkClasses:
        """Learn windows (w, d) (T) with their classes (n,), and try it on groups (n,) held out."""
        use = np.flatnonzero(usable(windows) & (label >= 0))
        found, label, groups = self.features(windows, use), label[use], groups[use]
        fold = np.unique(groups, return_inverse=True)[1].reshape(-1) % FOLDS
        right, away = np.zeros(len(use), bool), np.full(len(use), np.inf)
        for i in np.unique(fold) if fold.any() else ():
            rows = fold == i
            self._remember(found[~rows], label[~rows], groups[~rows])
            named, _, away[rows] = self._nearest(found[rows])
            right[rows] = named == label[rows]
        self._remember(found, label, groups)
        self.worst_ = FARTHEST * float(np.quantile(away[right], ENOUGH)) if right.any() else np.inf
        self.right = float(right.mean())
        return self

    def predict(self, windows: list[Array], firm: Bools) -> tuple[Integers, Array]:
        """Class of presses and its probability; -1 and NaN: not firm (n,), or unlike all."""
        label, chance = np.full(len(windows), -1), np.full(len(windows), np.nan)
        use = np.flatnonzero(usable(windows) & firm)
        if len(use):
            named, probability, away = self._nearest(self.features(windows, use))
            fits = away <= self.worst_
            label[use[fits]], chance[use[fits]] = named[fits], probability[fits]
        return label, chance

    def features(self, windows: list[Array], rows: Integers) -> Array:
        """Features (n, p) of some windows: one by one, so that live frames have the same bits."""
        return np.concatenate([self.network.features(windows[row][None]) for row in rows])

    def _remember(self, found: Array, label: Integers, groups: Integers) -> None:
        """Prototypes of features (n, p)."""
        pairs, number = np.unique(np.column_stack([label, groups]), axis=0, return_inverse=True)
        self.label_ = pairs[:, 0]
        self.prototypes_ = Prototypes().fit(found, np.asarray(number).reshape(-1))

    def _nearest(self, found: Array) -> tuple[Integers, Array, Array]:
        """Class, its probability and the distance of the nearest prototype, of features (n, p)."""
        chance = np.exp(self.prototypes_.log_probability(found))
        nearest = chance.argmax(axis=1)
        mine = self.label_[nearest][:, None] == self.label_
        away = np.square(found - self.prototypes_.means_[nearest]).sum(axis=1)
        return self.label_[nearest], (chance * mine).sum(axis=1), away


def usable(windows: list[Array]) -> Bools:
    """Windows that are such as the networks were trained on, and whole."""
    shape = FRAMES, CHANNELS
    return np.array([one.shape == shape and np.isfinite(one).all() for one in windows], bool)


MODEL_ERROR = 0.03  # of what a chip sees, where no press determines it
WEAKEST = 5.0  # sigma of the strongest reading
WIDE = np.sqrt(2 * np.pi)  # deviations that a Gaussian is wide
STILL = 0.5  # of the noise: what frames do not average, where no press determines it
LEAST = np.array([1e-4, 1e-4, 1e-3])  # shares of these ranges
TURNINGS = (0.0, 1.0)  # where no press tells
FREE = 4  # parameters of a press that are fitted, beside a uniform field
WITNESSES = 3  # heads that say where a shape presses that nobody described


@dataclass(frozen=True)
class Answers:
    """Estimates from n presses; see `ContactStates`."""

    # (n,) -1 and NaN: none of the classes
    label: Integers
    probability: Array
    # (n, 3) and (n, 3, 3) place (m) and turn (rad) of the head named; of a class that nobody
    # described the place alone; NaN without a model
    pose: Array
    cov: Array
    order: Integers  # (n,) of the head's symmetry; -1 unknown


class Recogniser:
    """Classes of one skin.

    Parameters
    ----------
    model : SkinModel or None
        The skin as it is; None: templates are of no use.
    outlines, library : tuple of Outline
        Heads that have templates, labelled 0, 1, 2 ...; stand-ins where none is described.
    noise, common : ndarray, shape (d,) and (d, 3)
        Of a reading (T); readings of a uniform field.
    error : float
        Of the model, as a share of what a chip sees.

    Attributes
    ----------
    known_, enrolled_ : SupportSet
        Presses of classes that were fitted, and of those enrolled since.
    road_ : str
        'press_templates', 'press_both', 'press_neighbours' or 'prototypes'.
    turnings : tuple of float
        Shares of the body's turns that magnets may follow.
    still_ : float
        Error of a pattern that frames do not average (T).
    covariance_ : CovarianceModel or None
        Of place and turn, from held-out presses.
    """

    def __init__(
        self, model: SkinModel | None, outlines: tuple[Outline, ...], noise: Array, common: Array,
        error: float = MODEL_ERROR, library: tuple[Outline, ...] = (),
    ) -> None:  # fmt: skip
        self.model, self.outlines, self.library, self.error = model, outlines, library, error
        self.noise, self.common, self.turnings = noise, common, TURNINGS
        self.known_ = self.enrolled_ = SupportSet.empty(len(noise))
        self.road_ = 'press_templates' if model is not None and outlines else 'press_neighbours'
        self.covariance_: CovarianceModel | None = None
        self.still_ = STILL * float(np.mean(noise))

    @cached_property
    def basis(self) -> Array:
        """Orthonormal patterns of a uniform field, shape (d, 3)."""
        return np.asarray(np.linalg.qr(self.common)[0])

    @property
    def described(self) -> bool:
        """Classes have templates."""
        return self.model is not None and bool(self.outlines)

    @cached_property
    def spare(self) -> int:
        """Readings that are left over by what is fitted; dead chips have none."""
        return int(np.count_nonzero(np.abs(self.common).sum(axis=1))) - 3 - FREE

    @cached_property
    def templates(self) -> tuple[PressBank, ...]:
        """Templates on each skin that it may be, of stand-ins where no head is described."""
        model, heads = self.model, self.outlines or self.library
        if model is None or not heads:
            return ()
        return tuple(press_bank(replace(model, turning=one), heads) for one in self.turnings)

    @cached_property
    def evidence(self) -> SupportSet:
        """Presses by which classes are told."""
        return self.evidence_by(self.known_, self.road_)

    def evidence_by(self, known: SupportSet, road: str) -> SupportSet:
        """Known presses and enrolled ones; the latter alone where templates name all others."""
        return self.enrolled_ if road == 'press_templates' else known.joined(self.enrolled_)

    def changed(self, **parts: object) -> Recogniser:
        """The same with other attributes."""
        other = copy(self)
        vars(other).update(parts)
        stale = ('evidence', 'basis', 'spare', 'templates') if 'model' in parts else ('evidence',)
        for name in stale:
            vars(other).pop(name, None)
        return other

    def variance(self, presses: Presses) -> Array:
        """Variance of patterns (n, d): noise, and error of the model where chips see much."""
        noise = presses.variance(self.noise, self.still_)
        return np.asarray(noise + share_of(presses.pattern, self.error))

    def matches(self, presses: Presses) -> Matches | None:
        """The best press of every head, on the skin that explains a press best; None: no model."""
        variance, each = self.variance(presses), np.arange(len(presses.frames))
        best: Matches | None = None
        for bank in self.templates:
            found = bank.find(presses.pattern, variance)
            if best is not None:
                better = found.cost.min(axis=1) < best.cost.min(axis=1)
                found = best.joined(found).rows(each + len(each) * better)
            best = found
        return best

    def supports(self, presses: Presses, labels: Integers, number: Integers) -> SupportSet:
        """Windows of presses by number as supports of their classes.

        With what the most alike template of each changes by; without templates nothing is known.
        """
        n, d = presses.pattern.shape
        slopes = np.zeros((n, 4, d))
        matches = self.matches(presses)
        if matches is not None and n:
            each, best = np.arange(n), matches.cost.argmin(axis=1)
            pose, slopes = matches.pose[each, best], matches.slopes[each, best].copy()
            terms = self.templates[0].at(best, pose[:, :3])[:, 0]
            deep = pose[:, 3, None]
            slopes[:, 3] = deep**2 * terms[:, 1] + 2 * deep**3 * terms[:, 2]
        return SupportSet(presses.pattern, presses.frames, labels, number, slopes)

    def strength(self, presses: Presses) -> Array:
        """Strongest reading of each press over its noise, without any uniform field."""
        own = without_field(presses.pattern, self.basis)
        noise = np.sqrt(presses.variance(self.noise, self.still_))
        return np.asarray((np.abs(own) / noise).max(axis=1))

    def template_scores(self, presses: Presses, matches: Matches) -> Array:
        """Twice the negative log-likelihood of every head, shape (n, heads)."""
        assert self.model is not None
        # classes of presses that were seen press where they were seen, heads all over the sheet;
        # a head that may turn has more templates, of which one fits noise well
        sector = self.templates[0].sectors
        room = np.column_stack([np.tile(self.model.size, (len(sector), 1)), sector])
        with np.errstate(invalid='ignore'):
            wide = matches.cov.diagonal(axis1=2, axis2=3)[..., :3] * np.square(WIDE / room)
            part = np.maximum(np.fmin(wide, 1.0), np.square(LEAST))  # NaN: 1
        level = np.log(self.variance(presses)).sum(axis=1)
        return np.asarray(matches.cost + level[:, None] - np.log(part).sum(axis=2))

    def scores(
        self, presses: Presses, matches: Matches | None, supports: SupportSet, road: str
    ) -> tuple[Integers, Array, Array]:
        """Classes (k,), their scores (n, k) and misfits over variance (n, k)."""
        n = len(presses.pattern)
        columns: dict[int, tuple[Array, Array]] = {}
        if matches is not None and self.described:
            score, misfit = self.template_scores(presses, matches), matches.cost / self.spare
            columns = {i: (score[:, i], misfit.min(axis=1)) for i in range(score.shape[1])}
        if road == 'prototypes':
            score, level = prototype_scores(supports, presses, self.basis), np.zeros(n)
        else:
            score = support_scores(supports, presses, self.noise, self.common, self.still_)
            level = np.log(presses.variance(self.noise, self.still_)).sum(axis=1)
        for label in np.unique(supports.label).tolist():
            best = score[:, supports.label == label].min(axis=1)
            old, cost = columns.get(label, (np.full(n, np.inf), level))
            cost = np.where(best < old, (best - level) / self.spare, cost)
            columns[label] = np.minimum(best, old), cost
        labels = np.array(sorted(columns), np.int64)
        both = np.array([columns[i] for i in labels.tolist()]).reshape(len(labels), 2, n)
        return labels, both[:, 0].T, both[:, 1].T

    def chances(self, scores: Array, misfits: Array) -> tuple[Array, Array]:
        """Probabilities of classes, shape (n, k), and that it is none of them (n,)."""
        if not self.described:  # nothing is known of how other shapes fit: the nearest is named
            misfits = np.zeros_like(misfits)
        return class_chances(scores, misfits)

    def answer(self, presses: Presses) -> Answers:
        """Estimate label, place and turn of presses (n)."""
        n = len(presses.pattern)
        firm = np.array(np.isfinite(presses.pattern).all(axis=1))
        firm[firm] = self.strength(presses.rows(np.flatnonzero(firm))) >= WEAKEST
        label, probability = np.full(n, -1), np.full(n, np.nan)
        pose, cov = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        order = np.full(n, -1)
        if firm.any():
            some = presses if firm.all() else presses.rows(np.flatnonzero(firm))
            matches = self.matches(some) if self.described else None
            labels, scores, misfits = self.scores(some, matches, self.evidence, self.road_)
            if len(labels):
                chances, none = self.chances(scores, misfits)
                best = chances.argmax(axis=1)
                chance = chances[np.arange(len(best)), best]
                label[firm] = np.where(chance > none, labels[best], -1)
                probability[firm] = np.where(chance > none, chance, np.nan)
            if matches is not None:
                pose[firm], stated, order[firm] = self.placed(matches, label[firm])
                cov[firm] = self.calibrated(stated, some)
        return Answers(label, probability, pose, cov, order)

    def calibrated(self, stated: Array, presses: Presses) -> Array:
        """Covariance (n, 3, 3) as held-out presses of described heads ask for."""
        if self.covariance_ is None:
            return stated
        open_turn = stated[:, 2, 2] > OPEN_TURN
        found = self.covariance_.predict(stated, readings_of(presses))[0]
        found[open_turn, 2] = found[open_turn, :, 2] = 0.0
        found[open_turn, 2, 2] = stated[open_turn, 2, 2]
        other = np.isnan(stated[:, 2, 2])
        found[other] = stated[other]
        return np.asarray(found)

    def placed(self, matches: Matches, label: Integers) -> tuple[Array, Array, Integers]:
        """Pose (n, 3), covariance and order of symmetry of the head named; else where several say.

        Of these the covariance holds how far they are apart.
        """
        sectors, orders = self.templates[0].sectors, self.templates[0].orders
        n = np.arange(len(label))
        mine = (label >= 0) & (label < len(orders))
        which = np.where(mine, label, matches.cost.argmin(axis=1))
        pose, cov = matches.pose[n, which, :3], matches.cov[n, which][:, :3, :3].copy()
        pose[:, 2] -= sectors[which] * np.round(pose[:, 2] / sectors[which])
        free = orders[which] == 0
        pose[free, 2], cov[free, 2, :], cov[free, :, 2] = 0.0, 0.0, 0.0
        cov[free, 2, 2] = np.pi**2 / 3
        rows = np.flatnonzero(~mine)
        best = np.argsort(matches.cost[rows], axis=1)[:, :WITNESSES]
        places = matches.pose[rows[:, None], best, :2]
        pose[rows, :2] = places.mean(axis=1)
        away = places - pose[rows, None, :2]
        within = matches.cov[rows[:, None], best][..., :2, :2]
        cov[rows, :2, :2] = (within + away[..., None] * away[..., None, :]).mean(axis=1)
        pose[rows, 2], cov[rows, 2], cov[rows, :, 2] = np.nan, np.nan, np.nan
        return pose, cov, np.where(mine, orders[which], -1)


OPEN_TURN = 3.0  # rad2, of a turn that cannot be seen


def readings_of(presses: Presses) -> Array:
    """Logarithm of the strength of presses, by which errors grow, shape (n, 1)."""
    return np.asarray(np.log(np.linalg.norm(presses.pattern, axis=1) + 1e-12)[:, None])
