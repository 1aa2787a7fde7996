"""What pressed, and where, from the vector of one press: templates, seen presses, or both.

Templates come from the drawing of the skin, mended by its resting field and by known presses, so
that heads are recognised at places and turns where nothing ever pressed. Presses that were seen
are supports of their class, compared in a metric in which place, turn and depth cost little. The
best of a class's scores counts; newly enrolled classes are known by their supports alone.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import REPEATS, Supports, seen_classes, support_scores
from tactile_ros.estimators.press_search import PressSearch
from tactile_ros.estimators.press_supports import modelled_supports, plain_supports
from tactile_ros.sensors.multipole_skin.chances import UNTOLD, class_chances
from tactile_ros.sensors.multipole_skin.places import (
    Spread,
    named_places,
    scattered,
    undrawn_places,
    witnesses,
)

if TYPE_CHECKING:
    from tactile_ros.estimators.few_shot import SeenClasses
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.estimators.skin_model import SkinModel
    from tactile_ros.types import Array, Integers, Outline

MODEL_ERROR = 0.03  # of what a chip sees, where no press has told it
ALIKE = 1.5  # errors of places where no press tells them: those of chips are no noise
WEAKEST = 5.0  # sigma of the strongest reading
WIDE = 2.5  # deviations of a turn that count as its range
STILL = 0.5  # of the noise: what frames do not average, where no press tells it
AROUND = 5e-3  # m, within which heads may press beside those that were seen
LEAST = np.array([1e-4, 1e-4, 1e-3])  # shares of these ranges
WHOLE = 8  # degrees of freedom, as which the misfit over all readings counts
FREE = 4  # parameters of a press that are fitted, beside a uniform field


@dataclass(frozen=True)
class Answers:
    """What is said of n presses; see `ContactStates`.

    Attributes
    ----------
    label, probability : ndarray, shape (n,)
        -1 and NaN: none of the classes.
    pose, cov : ndarray, shape (n, 4) and (n, 4, 4)
        Place (m), turn (rad) and depth (m) of the head named; of a class that nobody drew the
        place alone; NaN without a model.
    order : ndarray, shape (n,)
        Of the head's symmetry; -1 unknown.
    """

    label: Integers
    probability: Array
    pose: Array
    cov: Array
    order: Integers


class Recogniser:
    """Classes of one skin.

    Parameters
    ----------
    model : SkinModel or None
        The skin as it is; None: templates are of no use.
    outlines : tuple of Outline
        Heads that have templates; their labels are 0, 1, 2 ...
    noise : ndarray, shape (d,)
        Of a reading (T).
    common : ndarray, shape (d, 3)
        What a uniform field does to readings.
    error : float
        Of the model, as a share of what a chip sees.

    Attributes
    ----------
    known_, enrolled_ : Supports
        Presses of classes that were fitted, and of those enrolled since.
    road_ : str
        'press_templates', 'press_neighbours' or 'press_both'.
    turnings : tuple of float
        Other shares of the body's turns that the skin's magnets may follow; each press is taken
        for one of the skin that explains it best.
    still_ : float
        Error of a pattern that frames do not average (T).
    spread_ : Spread
        Errors of places over what the covariance of a template says.
    usual_, vary_ : float
        Logarithm of the misfit, over its variance, of presses that are named rightly: its middle,
        and how far above it comes.
    """

    def __init__(
        self,
        model: SkinModel | None,
        outlines: tuple[Outline, ...],
        noise: Array,
        common: Array,
        error: float = MODEL_ERROR,
    ) -> None:
        self.model, self.outlines, self.error = model, outlines, error
        self.noise, self.common = noise, common
        self.turnings: tuple[float, ...] = ()
        self.known_ = Supports.empty(len(noise))
        self.enrolled_ = Supports.empty(len(noise))
        self.road_ = 'press_neighbours' if model is None else 'press_templates'
        self.spread_ = Spread(ALIKE, 0.0)
        self.usual_, self.vary_ = 0.0, UNTOLD
        self.still_ = STILL * float(np.mean(noise))

    @cached_property
    def basis(self) -> Array:
        """Orthonormal patterns of a uniform field, shape (d, 3)."""
        return np.asarray(np.linalg.qr(self.common)[0])

    @cached_property
    def spare(self) -> int:
        """Readings that are left over by what is fitted; chips that say nothing have none."""
        return int(np.count_nonzero(np.abs(self.common).sum(axis=1))) - 3 - FREE

    @property
    def freedom(self) -> int:
        """Degrees of freedom of misfits."""
        return self.spare if self.search is None else len(self.outlines) - 1 + WHOLE

    @cached_property
    def search(self) -> PressSearch | None:
        """Search among templates; None without a model or heads."""
        if self.model is None or not self.outlines:
            return None
        found = None
        others = [replace(self.model, turning=turning) for turning in self.turnings]
        for skin in (*others, self.model):
            bank, still = skin.bank(self.outlines), self.still_
            found = PressSearch(bank, self.noise, self.common, skin.body, self.error, still, found)
        return found

    @cached_property
    def _sectors(self) -> tuple[Array, Integers]:
        """Turns after which heads look the same, and their orders of symmetry, (heads,) each."""
        assert self.search is not None
        heads = self.search.bank.heads
        return np.array([head.sector for head in heads]), np.array([head.order for head in heads])

    @cached_property
    def _narrow(self) -> Array:
        """One over variances as wide as heads may press (per m2) and turn, shape (heads, 3)."""
        sector = self._sectors[0]
        room = np.column_stack([np.full((len(sector), 2), AROUND), sector])
        return np.square(WIDE / room)

    def with_enrolled(self, enrolled: Supports) -> Recogniser:
        """The same with other enrolled classes."""
        other = copy(self)
        vars(other).pop('_last', None)
        other.enrolled_ = enrolled
        return other

    def refresh(self) -> None:
        """Forget what was made for another error or skin."""
        for name in ('search', 'basis', '_last', '_sectors', '_narrow', 'spare'):
            vars(self).pop(name, None)

    def matches(self, presses: PressVectors) -> Matches | None:
        """The best press of every head."""
        return None if self.search is None else self.search.find(presses)

    def supports(
        self,
        presses: PressVectors,
        labels: Integers,
        matches: Matches | None,
        number: Integers | None = None,
    ) -> Supports:
        """Windows as supports of their classes; without numbers each is a press of its own."""
        if number is None:
            number = np.arange(len(labels))
        if matches is None:
            return plain_supports(presses, labels, number)
        assert self.search is not None
        bank, basis = self.search.bank, self.basis
        return modelled_supports(presses, labels, number, matches, bank, basis)

    def strength(self, presses: PressVectors) -> Array:
        """Strongest reading of each press over its noise, without any uniform field."""
        own = presses.pattern - (presses.pattern @ self.basis) @ self.basis.T
        noise = np.sqrt(presses.variance(self.noise, self.still_))
        return np.asarray((np.abs(own) / noise).max(axis=1))

    def template_scores(self, matches: Matches) -> Array:
        """Twice the negative log-likelihood of every head, shape (n, heads)."""
        assert self.search is not None
        # classes of presses that were seen press where they were seen, heads around there; a
        # head that may turn has more templates, of which one fits noise well
        with np.errstate(invalid='ignore'):
            wide = matches.cov.diagonal(axis1=2, axis2=3)[..., :3] * self._narrow
            part = np.maximum(np.fmin(wide, 1.0), np.square(LEAST))  # NaN: 1
        return np.asarray(matches.cost + matches.level[:, None] - np.log(part).sum(axis=2))

    def template_misfits(self, matches: Matches) -> Array:
        """How much worse than by chance the likeliest head fits, for every head (n, heads).

        Along the other heads, and a little over all readings: few heads tell little of shapes.
        """
        heads = matches.cost.shape[1]
        whole = matches.cost.min(axis=1) / self.spare
        found = ((heads - 1) * matches.misfit + WHOLE * whole) / self.freedom
        return np.repeat(found[:, None], heads, axis=1)

    def scores(
        self,
        presses: PressVectors,
        matches: Matches | None,
        known: Supports,
        road: str,
    ) -> tuple[Integers, Array, Array]:
        """Classes (k,), their scores (n, k) and misfits over variance (n, k)."""
        n = len(presses.pattern)
        columns: dict[int, tuple[Array, Array]] = {}
        seen = self._seen(None if road == 'press_templates' else known)
        if matches is not None and road != 'press_neighbours':
            score = self.template_scores(matches)
            misfit = self.template_misfits(matches)
            if seen is None:
                return np.arange(score.shape[1]), score, misfit
            for i in range(score.shape[1]):
                columns[i] = score[:, i], misfit[:, i]
        if seen is not None:
            score = support_scores(seen, presses, self.noise, self.common, self.still_)
            level = self._level(presses)
            for label in np.unique(seen.supports.label):
                best = score[:, seen.supports.label == label].min(axis=1)
                cost = (best - level) / self.spare
                old = columns.get(int(label))
                if old is not None:
                    better = best < old[0]
                    best = np.where(better, best, old[0])
                    cost = np.where(better, cost, old[1])
                columns[int(label)] = best, cost
        if not columns:
            return np.zeros(0, np.int64), np.zeros((n, 0)), np.zeros((n, 0))
        labels = np.array(sorted(columns))
        return (
            labels,
            np.stack([columns[i][0] for i in labels], axis=1),
            np.stack([columns[i][1] for i in labels], axis=1),
        )

    def _seen(self, known: Supports | None) -> SeenClasses | None:
        """Enrolled classes, and known ones; made anew when they differ from the last time."""
        what = known, self.enrolled_, self.still_, self.error
        if not self._last or not _same(self._last[0][0], what):
            supports = self.enrolled_ if known is None else known.joined(self.enrolled_)
            made = None
            if len(supports.label):
                made = seen_classes(supports, self.noise, self.still_, self.error, self.basis)
            self._last[:] = [(what, made)]
        return self._last[0][1]

    @cached_property
    def _last(self) -> list[tuple[tuple[object, ...], SeenClasses | None]]:
        """What classes were made from the last time, and they."""
        return []

    def _level(self, presses: PressVectors) -> Array:
        """Logarithm of the variance of repeated presses (n,)."""
        chips = presses.pattern.reshape(len(presses.pattern), -1, 3)
        here = np.square(chips).mean(axis=2)
        share = REPEATS**2 * (here + 0.05 * here.max(axis=1, keepdims=True))
        noise = presses.variance(self.noise, self.still_)
        return np.asarray(np.log(noise + np.repeat(share, 3, axis=1)).sum(axis=1))

    def chances(self, scores: Array, misfits: Array) -> tuple[Array, Array]:
        """Probabilities of classes, shape (n, k), and that it is none of them (n,)."""
        if not scores.shape[1]:
            return scores, np.ones(len(scores))
        return class_chances(scores, misfits, self.usual_, self.vary_)

    @staticmethod
    def decide(labels: Integers, chances: Array, none: Array) -> tuple[Integers, Array]:
        """Label and its probability for each press; -1 and NaN where none of them is likelier."""
        n = len(chances)
        if not len(labels):
            return np.full(n, -1), np.full(n, np.nan)
        best = chances.argmax(axis=1)
        chance = chances[np.arange(n), best]
        return np.where(chance > none, labels[best], -1), np.where(chance > none, chance, np.nan)

    def answer(self, presses: PressVectors) -> Answers:
        """What pressed, and where."""
        n = len(presses.pattern)
        told = np.array(np.isfinite(presses.pattern).all(axis=1))
        told[told] = self.strength(presses.rows(np.flatnonzero(told))) >= WEAKEST
        label, probability = np.full(n, -1), np.full(n, np.nan)
        pose, cov = np.full((n, 4), np.nan), np.full((n, 4, 4), np.nan)
        order = np.full(n, -1)
        if told.any():
            some = presses if told.all() else presses.rows(np.flatnonzero(told))
            matches = self.matches(some)
            labels, scores, misfits = self.scores(some, matches, self.known_, self.road_)
            chances, none = self.chances(scores, misfits)
            label[told], probability[told] = self.decide(labels, chances, none)
            if matches is not None:
                likely = self.likely(matches, labels, chances, none)
                pose[told], cov[told], order[told] = self.placed(matches, label[told], likely)
        return Answers(label, probability, pose, cov, order)

    def placed(
        self, matches: Matches, label: Integers, likely: Array | None = None
    ) -> tuple[Array, Array, Integers]:
        """Pose, covariance and order of symmetry of the head named; else where several say.

        With chances (n, heads) the covariance holds how far other heads would have pressed aside.
        """
        sectors, orders = self._sectors
        mine = (label >= 0) & (label < len(orders))
        which = np.where(mine, label, matches.cost.argmin(axis=1))
        pose, cov = named_places(matches, which, sectors, orders, self.spread_)
        if likely is not None:
            cov[:, :2, :2] += scattered(likely, matches.pose[..., :2] - pose[:, None, :2])
        if not mine.all():
            pose[~mine], cov[~mine] = undrawn_places(matches, ~mine, self.spread_)
        return pose, cov, np.where(mine, orders[which], -1)

    @staticmethod
    def likely(matches: Matches, labels: Integers, chances: Array, none: Array) -> Array:
        """Weights (n, heads) of what each head says of places, by chances of classes (n, k).

        Of what is none of them, the heads that fit best say it.
        """
        drawn = labels < matches.cost.shape[1]
        found = witnesses(matches) * (none + chances[:, ~drawn].sum(axis=1))[:, None]
        found[:, labels[drawn]] += chances[:, drawn]
        return np.asarray(found)


def _same(first: tuple[object, ...], second: tuple[object, ...]) -> bool:
    """Whether two tuples hold the very same things."""
    return all(a is b for a, b in zip(first, second, strict=True))
