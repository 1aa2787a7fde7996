"""Label, place and turn from the vector of one press: templates, seen presses, or both.

Templates come from the drawing of the skin, mended by its resting field and by known presses, so
that heads are recognised at places and turns where nothing ever pressed. Presses that were seen
are supports of their class, compared in a metric in which place, turn and depth cost little. The
best of a class's scores counts; newly enrolled classes are known by their supports alone.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from tactile_ros.estimators.embedding import Embedding
from tactile_ros.estimators.few_shot import REPEATS, SupportSet, seen_classes, support_scores
from tactile_ros.estimators.press_search import PressSearch, modelled_supports, plain_supports
from tactile_ros.estimators.prototypes import Prototypes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.few_shot import PressVectors, SeenClasses
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.estimators.sheet_calibration import SkinModel
    from tactile_ros.types import Array, Bools, Integers, Outline

NONE = 0.1  # how often something presses that is none of the classes
UNLIKE = 4.6  # logarithm of the misfit, over which that is spread: a factor of a hundred
UNTOLD = 0.8  # deviation of that logarithm where no press tells it
LEAST_TOLD = 2.4  # of it, at one degree of freedom: presses of one head tell not how others differ
FEW = 5  # presses, as which what is usual counts


def usual_misfit(misfits: Array, freedom: int) -> tuple[float, float]:
    """How well classes fit what they are: middle of the logarithm, and how far above it comes.

    Parameters
    ----------
    misfits : ndarray, shape (n,)
        Over their variance, of held-out presses that were named rightly.
    freedom : int
        Degrees of freedom of each.
    """
    if not len(misfits):
        return 0.0, UNTOLD
    found = np.log(np.maximum(misfits, 1e-3))
    weight = len(found) / (len(found) + FEW)
    usual = weight * float(np.median(found))
    above = np.square(np.maximum(found - usual, 0.0))
    square = 2 * weight * above.mean() + (1 - weight) * UNTOLD**2
    return usual, float(np.sqrt(max(square, LEAST_TOLD**2 / freedom)))


def none_chance(misfits: Array, usual: float, vary: float) -> Array:
    """Probability that what pressed is none of the classes, from the best one's misfit (n,).

    Others fit anyhow, within a wide factor; classes as held-out presses do, or better.
    """
    away = np.maximum(np.log(np.maximum(misfits, 1e-3)) - usual, 0.0) / vary
    fits = np.exp(-0.5 * np.square(away)) / (np.sqrt(2 * np.pi) * vary)
    return np.asarray(NONE / UNLIKE / (NONE / UNLIKE + (1 - NONE) * fits))


def class_chances(scores: Array, misfits: Array, usual: float, vary: float) -> tuple[Array, Array]:
    """Probabilities of classes, shape (n, k), and that it is none of them (n,).

    Parameters
    ----------
    scores, misfits : ndarray, shape (n, k)
        Twice the negative log-likelihood; misfit over its variance. Infinite: far away.
    usual, vary : float
        Of `usual_misfit`.
    """
    n = np.arange(len(scores))
    best = scores.argmin(axis=1)
    low, misfit = scores[n, best], misfits[n, best]
    near = np.isfinite(low)
    none = np.where(near, none_chance(np.where(near, misfit, 1.0), usual, vary), 1.0)
    with np.errstate(invalid='ignore'):
        away = np.where(near[:, None], scores - low[:, None], np.inf)
    # where nothing fits well, differences of misfits say less
    likely = np.exp(-0.5 * away / np.where(near, np.maximum(misfit, 1.0), 1.0)[:, None])
    total = np.maximum(likely.sum(axis=1), 1e-30)
    return ((1 - none) / total)[:, None] * likely, none


WITNESSES = 2, 3  # heads, least and most, that tell where an undrawn one presses
INSIDE = 0.6827  # of errors, one stated deviation
USUAL_ERRORS = 10  # as stated, that are added to those that were found
FLOORS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])  # of the usual deviation
SMALLEST = 0.3  # scale
TAIL = 4.0  # degrees of freedom of errors: some are of a wrong turn


@dataclass(frozen=True)
class Spread:
    """Errors of places over what the covariance of templates says.

    Attributes
    ----------
    floor : float
        Deviation that the clearest press has too (m): chips and bands err alike for all of it.
    """

    scale: float  # by what stated deviations are too small
    floor: float


def fitted_spread(away: Array, sigma: Array, doubt: Array) -> Spread:
    """Scale and floor that errors of places ask for.

    Parameters
    ----------
    away : ndarray, shape (n, 2)
        Errors (m).
    sigma, doubt : ndarray, shape (n, 2)
        Deviations (m) by the covariance of templates, and beside it by what else it may be.
    """
    found: list[tuple[float, float, float]] = []
    for floor in float(np.median(sigma)) * FLOORS:
        own = np.maximum(np.hypot(sigma, floor), 1e-12)
        scale = _scale((np.square(away) - np.square(doubt)) / np.square(own))
        total = np.hypot(scale * own, doubt)
        square = np.square(away / total)
        told = -np.log(total) - 0.5 * (TAIL + 1) * np.log1p(square / TAIL)
        found.append((float(told.sum()), scale, float(scale * floor)))
    return Spread(*max(found)[1:])


def _scale(squares: Array) -> float:
    """By what stated deviations are too small: as much as two in three errors ask for.

    Some errors of a usual size are added, since few presses say little.
    """
    usual = np.square(norm.ppf((np.arange(USUAL_ERRORS) + 0.5) / USUAL_ERRORS))
    found = np.quantile(np.concatenate([squares.ravel(), usual]), INSIDE)
    return float(np.sqrt(max(found, SMALLEST**2)))


def named_places(
    matches: Matches, which: Integers, sectors: Array, orders: Integers, spread: Spread
) -> tuple[Array, Array]:
    """Pose (n, 4) and covariance (n, 4, 4) of heads by number (n,), if they are what pressed.

    Parameters
    ----------
    matches : Matches
        Of the presses.
    which : ndarray, shape (n,)
        Heads.
    sectors, orders : ndarray, shape (heads,)
        Turns after which they look the same (rad), and orders of symmetry.
    spread : Spread
        Of places.
    """
    rows = np.arange(len(which)), which
    pose, cov = matches.pose[rows], spread.scale**2 * matches.cov[rows]
    sector, free = sectors[which], orders[which] == 0
    pose[:, 2] -= sector * np.round(pose[:, 2] / sector)
    if free.any():
        pose[free, 2] = 0.0
        cov[free, 2, :] = cov[free, :, 2] = 0.0
        cov[free, 2, 2] = np.pi**2 / 3
    cov[:, 0, 0] += spread.floor**2
    cov[:, 1, 1] += spread.floor**2
    return pose, cov


def witnesses(matches: Matches) -> Array:
    """Weights (n, heads) of the heads that tell where another shape pressed: those that fit best.

    All are 0 where there are too few.
    """
    n, heads = matches.cost.shape
    found = np.zeros((n, heads))
    if heads >= WITNESSES[0]:
        best = np.argsort(matches.cost, axis=1)[:, : WITNESSES[1]]
        found[np.arange(n)[:, None], best] = 1 / best.shape[1]
    return found


def undrawn_places(matches: Matches, rows: Bools, spread: Spread) -> tuple[Array, Array]:
    """Pose and covariance of shapes that nobody drew: places alone, as several heads say.

    The heads that fit best disagree by about as much as all of them are wrong.
    """
    weight = witnesses(matches)[rows]
    pose, cov = np.full((len(weight), 4), np.nan), np.full((len(weight), 4, 4), np.nan)
    if weight.any():
        said = matches.pose[rows][..., :2]
        pose[:, :2] = np.einsum('nh,nhi->ni', weight, said)
        within = np.einsum('nh,nhij->nij', weight, matches.cov[rows][..., :2, :2])
        between = scattered(weight, said - pose[:, None, :2])
        cov[:, :2, :2] = spread.scale**2 * within + between + spread.floor**2 * np.eye(2)
    return pose, cov


def scattered(weight: Array, away: Array) -> Array:
    """Covariance (n, 2, 2) of places that are so far away (n, heads, 2), by weights (n, heads)."""
    return np.asarray(np.matmul(np.swapaxes(weight[..., None] * away, 1, 2), away))


TRAINED = ('shapes', 'postures')
FRAMES, CHANNELS = 10, 60  # of a window


def can_run() -> bool:
    """Whether onnxruntime is installed.

    `training/pronet.py` made them and says how; each file tells the command and the places that it
    learned from. They know the skin that they were trained on, and no other.
    """
    return find_spec('onnxruntime') is not None


def pronet(what: str) -> Embedding:
    """Network for 'shapes' of heads or 'postures' of a bar.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if what not in TRAINED:
        msg = f'what of pronet must be one of {", ".join(TRAINED)}; received {what!r}'
        raise ValueError(msg)
    return Embedding(Path(__file__).with_name(f'pronet_{what}.onnx'))


NETWORKS = tuple(f'pronet_{what}' for what in TRAINED)
FOLDS = 5
FEWEST = 3  # presses
BETTER = 1.5
FARTHEST = 2.0  # over the distance that nineteen of twenty held-out presses keep
ENOUGH = 0.95


class NetworkClasses:
    """What one network makes of known presses.

    A prototype of [1] is the mean of a class at the place of the task. Where presses of many
    places are known, each place has prototypes of its own, and the nearest one names a press.

    Parameters
    ----------
    what : str
        Network: one of `pronet.TRAINED`.

    Attributes
    ----------
    right : float
        Share of held-out presses that are named rightly; 0 where none could be held out.
    chance : float
        Share of the commonest class.
    worst_ : float
        Distance beyond which no class fits.
    """

    prototypes_: Prototypes  # numbered one by one; `label_` (m,) says of which class each is
    label_: Integers

    def __init__(self, what: str) -> None:
        self.what = what
        self.right, self.chance, self.worst_ = 0.0, 1.0, np.inf

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return f'pronet_{self.what}'

    @property
    def useful(self) -> bool:
        """Whether it is right by half as much again as the commonest class, or nearly always."""
        return self.right > min(BETTER * self.chance, 0.5 + self.chance / 2)

    @cached_property
    def network(self) -> Embedding:
        """Read when it is first asked."""
        return pronet(self.what)

    def fit(self, windows: list[Array], label: Integers, groups: Integers) -> NetworkClasses:
        """Learn presses, and try it on groups that are split as wholes.

        Parameters
        ----------
        windows : list of ndarray, shape (w, d)
            Changes of field in presses (T).
        label, groups : ndarray, shape (n,)
            Class; place, or what must not be split.
        """
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
        self.chance = float(np.bincount(label).max() / len(label))
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


def best_network(
    names: Sequence[str | None], windows: list[Array], label: Integers, groups: Integers
) -> NetworkClasses | None:
    """The network that is right most often on held-out groups; None: none can be tried.

    Raises
    ------
    MissingPackageError
        If a single one was asked for and onnxruntime is not installed.
    """
    enough = int((usable(windows) & (label >= 0)).sum()) >= FEWEST
    if not enough or (len(names) > 1 and not can_run()):
        return None
    tried = [NetworkClasses(what).fit(windows, label, groups) for what in TRAINED
             if f'pronet_{what}' in names]  # fmt: skip
    return max(tried, key=lambda one: one.right)


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
    pose, cov : ndarray, shape (n, 4) and (n, 4, 4)
        Place (m), turn (rad) and depth (m) of the head named; of a class that nobody drew the
        place alone; NaN without a model.
    """

    # (n,) -1 and NaN: none of the classes
    label: Integers
    probability: Array
    pose: Array
    cov: Array
    order: Integers  # (n,) of the head's symmetry; -1 unknown


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
    known_, enrolled_ : SupportSet
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
        self, model: SkinModel | None, outlines: tuple[Outline, ...], noise: Array, common: Array,
        error: float = MODEL_ERROR,
    ) -> None:  # fmt: skip
        self.model, self.outlines, self.error = model, outlines, error
        self.noise, self.common = noise, common
        self.turnings: tuple[float, ...] = ()
        self.known_ = SupportSet.empty(len(noise))
        self.enrolled_ = SupportSet.empty(len(noise))
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

    def with_enrolled(self, enrolled: SupportSet) -> Recogniser:
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
        self, presses: PressVectors, labels: Integers, matches: Matches | None,
        number: Integers | None = None,
    ) -> SupportSet:  # fmt: skip
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
        self, presses: PressVectors, matches: Matches | None, known: SupportSet, road: str
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

    def _seen(self, known: SupportSet | None) -> SeenClasses | None:
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
