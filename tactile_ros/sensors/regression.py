"""Estimation by generic regressors, for sensors without a model of their own."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.covariance import CalibratedCovariance, GainVariance
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.kernel_ridge import KernelRidge, RestingState
from tactile_ros.estimators.model_selection import select
from tactile_ros.estimators.perceptron import Perceptron
from tactile_ros.estimators.regression import Ridge, Standardisation
from tactile_ros.estimators.slip_detector import FEWEST, SlipDetector
from tactile_ros.types import Array, Bools, Estimation, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tactile_ros.types import Array, Bools, Columns, Integers, Report, SensorConfig, Signals

ESTIMATORS = ('ridge', 'grid_knn', 'kernel_ridge', 'perceptron')
FEWEST_ROWS = 5
TINY = np.finfo(np.float64).tiny
MOST_RUNS = 10  # folds of runs that are held out, a fit each
FEW_FOLDS = 2  # thousands of touches are judged well by two fifths of them
STATE_WEIGHT = 3.0  # the set of the skin is a small part of the change; its share of a distance


def candidates(wanted: str | None, *, place: bool) -> dict[str, Estimator]:
    """The regressors to choose from, by name; the pattern of a touch tells its place."""
    known: dict[str, Estimator] = {
        'ridge': Ridge(),
        'grid_knn': GridKnn(),
        'kernel_ridge': KernelRidge() if place else beyond_presses(),
        'perceptron': Perceptron(pattern=place),
    }
    if wanted is not None:
        return {wanted: known[wanted]}
    del known['kernel_ridge' if place else 'perceptron']
    return known


def beyond_presses() -> KernelRidge:
    """A regressor for a skin whose state has moved on since the presses it learned from.

    A plane as strong as the bumps carries the answer to loads and states beyond those seen. The
    penalty is set, to a thousandth of the range: presses of one run, on which it could be chosen,
    know nothing of the next run.
    """
    return KernelRidge(lengths=(0.4,), linear=1.0, strengths=(1e-6,), common=10.0)


class Head:
    """Regressor of some components of one target.

    Parameters
    ----------
    target : str
        Attribute of the state.
    columns : tuple of int
        Components that truth tells.
    wanted : str or None
        Name of an estimator; None: the best of all.
    channels : int
        How many features are the change of field now; the others are its history.

    Attributes
    ----------
    name : str
        Of the estimator in use.
    estimator_ : Estimator
        Fitted on all rows.
    gain_ : GainVariance or None
        Of a force: how gains differ from run to run.
    state_ : RestingState or None
        Of a force: what the resting reading tells of the skin.
    covariance_ : CalibratedCovariance
        From residuals of rows that the estimator had not seen.
    report_ : dict of str to float
        Errors on held-out groups (unit of the target).
    """

    def __init__(
        self, target: str, columns: tuple[int, ...], wanted: str | None, channels: int
    ) -> None:
        self.target = target
        self.columns = columns
        self.wanted = wanted
        self.channels = channels
        self.name = ''

    def fit(self, x: Array, y: Array, groups: Integers, sessions: Integers, rests: Array) -> Head:
        """Choose, fit and calibrate.

        Parameters
        ----------
        x : ndarray, shape (s, d)
            Features; beside a history, the last column is overwritten.
        y : ndarray, shape (s, k)
            Components of the target, all known.
        groups : ndarray, shape (s,)
            What a split keeps together.
        sessions : ndarray, shape (s,)
            Runs, which differ in gain.
        rests : ndarray, shape (s, channels)
            Resting reading under each row.
        """
        place = self.target == 'position'
        self.state_ = None if place else RestingState().fit(rests, sessions)
        x = x if self.state_ is None else self._seen(x, self.state_.along(rests))
        known = self.candidates()
        choice = select(known, x, y, groups, rounds=self.rounds(known, len(x)))
        self.name = choice.name
        self.estimator_ = known[self.name].fit(x, y, groups)
        drivers = self._drivers(choice.x, choice.predictions)
        self.covariance_ = CalibratedCovariance().fit(drivers, choice.residuals, choice.groups)
        self.gain_ = None if place else self._gain(known[self.name], x, y, sessions)
        sigma = np.sqrt(np.diagonal(self.covariance_.predict(drivers), axis1=1, axis2=2))
        error = np.linalg.norm(choice.residuals, axis=1)
        self.report_ = {
            'held_out_mean': float(error.mean()),
            'held_out_rmse': float(np.sqrt((error**2).mean())),
            'inside_one_sigma': float((np.abs(choice.residuals) <= sigma).mean()),
            'groups': float(len(np.unique(choice.groups))),
            'rows': float(len(x)),
            **{f'rmse_{name}': error for name, error in choice.errors.items()},
        }
        return self

    def candidates(self) -> dict[str, Estimator]:
        """The regressors to choose from, by name."""
        return candidates(self.wanted, place=self.target == 'position')

    def rounds(self, known: Mapping[str, Estimator], rows: int) -> int | None:
        """How many folds are held out; None: all."""
        return FEW_FOLDS if 'perceptron' in known and rows else None

    @cached_property
    def cells(self) -> tuple[slice | Integers, slice | Integers]:
        """Index of its components among three: of rows and of columns of a covariance."""
        first, last = self.columns[0], self.columns[-1] + 1
        if last - first == len(self.columns):  # a slice costs a tenth of a list
            return slice(first, last), slice(first, last)
        index = np.array(self.columns)
        return index[:, None], index

    @property
    def title(self) -> str:
        """Target with the names of its components."""
        return f'{self.target}_{"".join("xyz"[i] for i in self.columns)}'

    def predict(self, x: Array, rests: Array) -> tuple[Array, Array]:
        """Components (s, k) and their covariance (s, k, k) at rests (s, channels).

        Beside a history, the last column of x is overwritten.
        """
        if self.gain_ is None or self.state_ is None:
            mean = self.estimator_.predict(x)
            return mean, self.covariance_.predict(self._drivers(x, mean))
        state, strangeness = self.state_.read(rests)
        mean = self.estimator_.predict(self._seen(x, state))
        cov = self.covariance_.predict(self._drivers(x, mean))
        cov += self.gain_.covariance(mean, strangeness)
        return mean, cov

    def _seen(self, x: Array, state: Array) -> Array:
        """Features; beside a history, the state of the skin is written to the last of them."""
        if x.shape[1] > self.channels:
            np.multiply(state, STATE_WEIGHT, out=x[:, -1:])
        return x

    @staticmethod
    def _gain(estimator: Estimator, x: Array, y: Array, sessions: Integers) -> GainVariance:
        """Spread of gain between runs, from runs held out; of one run only a prior is known."""
        runs = len(np.unique(sessions))
        if runs < 2:
            return GainVariance().fit(y, y, sessions)
        unseen = select({'': estimator}, x, y, sessions, folds=min(runs, MOST_RUNS))
        return GainVariance().fit(unseen.predictions, unseen.y, unseen.groups)

    def _drivers(self, x: Array, mean: Array) -> Array:
        """What the error depends on: strength of the signal, and place or load."""
        now = x[:, : self.channels]
        drivers = np.empty((len(x), 1 + mean.shape[1]))
        drivers[:, 0] = 0.5 * np.log(np.add.reduce(now * now, axis=1) + TINY)
        drivers[:, 1:] = mean
        return drivers


def known_columns(y: Array, good: Bools) -> Iterator[tuple[tuple[int, ...], Bools]]:
    """Split components (s, 3) into sets that are known in the same rows.

    Yields
    ------
    columns, rows : tuple of int, ndarray of shape (s,)
        Components, and the usable rows at which all of them are known.
    """
    known = np.isfinite(y) & good[:, None]
    left = [i for i in range(y.shape[1]) if known[:, i].sum() >= FEWEST_ROWS]
    while left:
        same = tuple(i for i in left if (known[:, i] == known[:, left[0]]).all())
        yield same, known[:, same[0]]
        left = [i for i in left if i not in same]


TARGETS = ('position', 'force', 'torque')
REMEMBERING = ('force', 'torque')
TIME_CONSTANTS = (0.5, 2.0, 8.0, 32.0)
PAST_WEIGHT = 3.0  # relaxation is a small part of the change; its share of a distance
PLACE = 1e-5
ROUNDING = 1e-9  # of the largest reading: what moves less is a constant
EVEN_ODDS = 0.5
BLOCK = 1024  # rows whose history stays in the cache
MOST_SINGLE = 0.9  # places per touch above which touches, not places, are what repeats


class Regression(Estimation):
    """Regressors of one sensor, each for the components of one target that truth tells.

    Parameters
    ----------
    config : dataclass
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`; None: the best of them on held-out groups.
    channels : int
        Channels of a taxel.
    """

    def __init__(
        self, config: SensorConfig, estimator: str | None = None, channels: int = 3
    ) -> None:
        self.width = channels * len(config.positions)
        self.estimator = estimator
        self.heads_: tuple[Head, ...] = ()
        self.remembering_: tuple[Head, ...] = ()
        self.slip_: SlipDetector | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        heads = self._best if self.remembering_ else self.heads_
        slip = {} if self.slip_ is None else {'slip': 'matched_subspace'}
        return {**{head.target: head.name for head in heads}, **slip}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        plain = {head.title: head.report_ for head in self.heads_}
        past = {f'{head.title}_with_history': head.report_ for head in self.remembering_}
        slip = {} if self.slip_ is None else {'slip': self.slip_.report_}
        return {**plain, **past, **slip}

    def start(self) -> FadingMemory:
        """Fresh memory of a stream."""
        return FadingMemory(np.array(TIME_CONSTANTS))

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        truth : dict of str to ndarray, shape (s, ...)
            As in a Recording.
        groups : dict of str to ndarray, shape (s,)
            'group' and 'session': what a split keeps together.
        """
        now = signals.delta.reshape(-1, self.width)
        rest = signals.baseline.reshape(now.shape)
        past = None
        if signals.stamp_ns is not None:
            past = self._with_history(now, signals.stamp_ns, signals.restart, self.start())
        session = np.asarray(groups['session'], np.int64)
        heads: dict[str, tuple[Head, ...]] = {'now': (), 'past': ()}
        for target in TARGETS:
            y = np.asarray(truth.get(target, np.full((len(now), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, signals.good):
                if not _moves(signals.values[rows]):
                    continue
                told = y[rows][:, columns]
                kept = places_of(told) if target == 'position' else None
                kept = np.asarray(groups['group'][rows], np.int64) if kept is None else kept
                head = Head(target, columns, self.estimator, now.shape[1])
                heads['now'] += (head.fit(now[rows], told, kept, session[rows], rest[rows]),)
                if past is not None and target in REMEMBERING:
                    head = Head(target, columns, self.estimator, now.shape[1])
                    heads['past'] += (head.fit(past[rows], told, kept, session[rows], rest[rows]),)
        self.heads_, self.remembering_ = heads['now'], heads['past']
        self.slip_ = _slip(now, truth, groups, signals)
        vars(self).pop('_best', None)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets and covariances of every row, NaN for components that were never told.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        memory : FadingMemory
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, 3) or (s, 3, 3)
            One entry and its covariance for each target.
        """
        assert isinstance(memory, FadingMemory)
        now = signals.delta.reshape(-1, self.width)
        rest = signals.baseline.reshape(now.shape)
        known: Columns = {}
        for head in self.heads_:
            if head.target not in known:
                known[head.target] = _unknown((len(now), 3))
                known[f'{head.target}_cov'] = _unknown((len(now), 3, 3))
        for i in range(0, len(now), BLOCK):
            block = slice(i, i + BLOCK)
            part = now[block]
            past = part
            if signals.stamp_ns is not None and self.remembering_:
                stamps, restart = signals.stamp_ns[block], signals.restart[block]
                past = self._with_history(part, stamps, restart, memory)
            for head in self._in_use(signals.stamp_ns is not None):
                x = past if head in self.remembering_ else part
                mean, cov = head.predict(x, rest[block])
                rows, columns = head.cells
                known[head.target][block, columns] = mean
                known[f'{head.target}_cov'][block, rows, columns] = cov
        if self.slip_ is not None:
            probability = self.slip_.predict(now)
            known['slip'] = np.where(np.isnan(probability), -1, probability > EVEN_ODDS).astype(
                np.int8
            )
            known['slip_probability'] = probability
        return known

    def _in_use(self, stamped: bool) -> tuple[Head, ...]:
        """Heads for frames; a history, which stamps give, is used where it helped."""
        return self._best if stamped else self.heads_

    @cached_property
    def _best(self) -> tuple[Head, ...]:
        """For each set of components the head whose held-out error is the smaller."""
        past = {head.title: head for head in self.remembering_}
        return tuple(
            min(head, past.get(head.title, head), key=lambda one: one.report_['held_out_rmse'])
            for head in self.heads_
        )

    @staticmethod
    def _with_history(
        now: Array, stamp_ns: Integers, restart: Bools, memory: FadingMemory
    ) -> Array:
        """Change of field, how far it is from its fading means, and room: (s, d + m d + 1)."""
        behind = now[:, None] - memory(now, stamp_ns, restart)
        shape = (len(now), 1 + behind.shape[1], now.shape[1])
        wide = np.empty((len(now), shape[1] * shape[2] + 1))
        seen = wide[:, :-1].reshape(shape)  # a view: the head fills the last column
        seen[:, 0] = now
        np.multiply(behind, PAST_WEIGHT, out=seen[:, 1:])
        return wide


def _unknown(shape: tuple[int, ...]) -> Array:
    """NaN of a shape, at half the price of np.full."""
    array = np.empty(shape)
    array.fill(np.nan)
    return array


def _moves(values: Array) -> bool:
    """Whether readings (s, t, c) are more than one constant, from which nothing is learned."""
    read = np.nan_to_num(values)
    return bool((np.ptp(read, axis=0) > ROUNDING * np.abs(read).max(initial=0.0)).any())


def _slip(now: Array, truth: Columns, groups: Columns, signals: Signals) -> SlipDetector | None:
    """Detector of slip; None where too few sequences tell.

    A sequence is a stretch of one stream and repetition with one label.
    """
    told = np.asarray(truth.get('slip', np.full(len(now), -1)), np.int64)
    keys = np.column_stack([told, np.asarray(groups['group'], np.int64)])
    begins = np.ones(len(now), bool)
    begins[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    sequence = np.cumsum(begins if signals.begins is None else begins | signals.begins)
    rows = signals.good & (told >= 0)
    counts = [len(np.unique(sequence[rows & (told == label)])) for label in (0, 1)]
    if min(counts) < FEWEST:
        return None
    return SlipDetector().fit(now[rows], told[rows], sequence[rows])


def places_of(plane: Array) -> Integers | None:
    """Number of the place of each row, if places were touched more than once; else None."""
    _, place = np.unique(np.round(plane / PLACE), axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    return place if place.max(initial=0) + 1 <= MOST_SINGLE * len(place) else None


NAMED = ('cell', 'label')
VOTER = 'grid_knn'
BETTER = 1.5


class Vote:
    """Nearest neighbours that vote for one of several classes.

    Cells and classes are voted by nearest neighbours [2], weighted by one over the distance, where
    such votes are better than chance on held-out groups; a turn is regressed as cosine and sine,
    so that it has no seam.

    Parameters
    ----------
    target : str
        'cell' or 'label'.

    Attributes
    ----------
    report_ : dict of str to float
        Share of held-out rows that are named rightly, and that of the commonest class, which is
        chance; without at least two groups it is measured on the rows that were learned from.
    """

    classes_: Integers  # (k,) those that were seen
    voters_: GridKnn  # of the share of each class
    report_: dict[str, float]

    def __init__(self, target: str) -> None:
        self.target = target

    def fit(self, x: Array, named: Integers, groups: Integers) -> Vote:
        """Remember features (s, d) and their classes (s,); groups (s,) are split as wholes."""
        self.classes_, index = np.unique(named, return_inverse=True)
        shares = np.eye(len(self.classes_))[np.ravel(index)]
        trial = select({VOTER: GridKnn()}, x, shares, groups)
        right = trial.predictions.argmax(axis=1) == trial.y.argmax(axis=1)
        commonest = float(shares.mean(axis=0).max())
        self.report_ = {'held_out_accuracy': float(right.mean()), 'chance': commonest}
        self.voters_ = GridKnn().fit(x, shares)
        return self

    @property
    def useful(self) -> bool:
        """Whether it is right by half as much again as the commonest class, or nearly always."""
        accuracy, chance = self.report_['held_out_accuracy'], self.report_['chance']
        return accuracy > min(BETTER * chance, 0.5 + chance / 2)

    def predict(self, x: Array) -> tuple[Integers, Array]:
        """Class and its share of the votes, shape (s,) each; of equal shares the lowest class."""
        shares = self.voters_.predict(x)
        best = shares.argmax(axis=1)
        return self.classes_[best], shares[np.arange(len(x)), best]


class Recognition(Regression):
    """Regressors of one sensor, with votes for cell and label and the turn.

    Parameters
    ----------
    config, estimator, channels
        As in `Regression`. Votes are taken where the estimator is None or 'grid_knn'.
    """

    def __init__(
        self, config: SensorConfig, estimator: str | None = None, channels: int = 3
    ) -> None:
        super().__init__(config, estimator, channels)
        self.votes_: tuple[Vote, ...] = ()
        self.turn_: Head | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        turn = {} if self.turn_ is None else {'yaw': self.turn_.name}
        return {**super().estimators, **turn, **{vote.target: VOTER for vote in self._useful}}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and how often votes are right."""
        turn = {} if self.turn_ is None else {'yaw': self.turn_.report_}
        return {**super().report, **turn, **{vote.target: vote.report_ for vote in self.votes_}}

    @property
    def _useful(self) -> tuple[Vote, ...]:
        """Votes that are better than chance."""
        return tuple(vote for vote in self.votes_ if vote.useful)

    @property
    def label_names(self) -> tuple[str, ...]:
        """Nothing but numbers is known of classes."""
        known = [vote.classes_ for vote in self._useful if vote.target == 'label']
        return tuple(str(name) for name in known[0]) if known else ()

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        super().fit(signals, truth, groups)
        x = signals.delta.reshape(len(signals.good), self.width)
        unknown = np.full(len(x), -1)
        votes: list[Vote] = []
        for target in NAMED if self.estimator in (None, VOTER) else ():
            named = np.asarray(truth.get(target, unknown), np.int64)
            rows = signals.good & (named >= 0)
            if rows.sum() >= FEWEST_ROWS:
                group = np.asarray(groups['group'], np.int64)[rows]
                votes.append(Vote(target).fit(x[rows], named[rows], group))
        self.votes_ = tuple(votes)
        yaw = np.asarray(truth.get('yaw', np.full(len(x), np.nan)), np.float64)
        rests = signals.baseline.reshape(x.shape)
        self.turn_ = self._turn(x, rests, yaw, signals.good & np.isfinite(yaw), groups)

    def _turn(
        self, x: Array, rests: Array, yaw: Array, rows: Bools, groups: Columns
    ) -> Head | None:
        """Regressor of the turn's cosine and sine, where enough rows (s,) know it."""
        if rows.sum() < FEWEST_ROWS:
            return None
        y = np.column_stack([np.cos(yaw[rows]), np.sin(yaw[rows])])
        group = np.asarray(groups['group'], np.int64)[rows]
        session = np.asarray(groups['session'], np.int64)[rows]
        head = Head('yaw', (0, 1), self.estimator, self.width)
        return head.fit(x[rows], y, group, session, rests[rows])

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        x = signals.delta.reshape(len(signals.good), self.width)
        for vote in self._useful:
            # no class, and no neighbours, for readings that are not there
            there = np.isfinite(x).all(axis=1)
            names, shares = np.full(len(x), -1), np.full(len(x), np.nan)
            if there.any():
                names[there], shares[there] = vote.predict(x[there])
            known[vote.target], known[f'{vote.target}_probability'] = names, shares
        if self.turn_ is not None:
            mean, cov = self.turn_.predict(x, signals.baseline.reshape(x.shape))
            length = np.maximum(np.linalg.norm(mean, axis=1), 1e-9)
            across = np.column_stack([-mean[:, 1], mean[:, 0]]) / length[:, None]
            known['yaw'] = np.arctan2(mean[:, 1], mean[:, 0])
            variance = np.einsum('si,sij,sj->s', across, cov, across)
            known['yaw_std'] = np.sqrt(variance) / length
        return known


CLASSES = (
    Regression,
    SlipDetector,
    Head,
    GainVariance,
    RestingState,
    Ridge,
    GridKnn,
    KernelRidge,
    Perceptron,
    Standardisation,
    CalibratedCovariance,
    Recognition,
    Vote,
)


KIND = 'not told: '
LIGHT = 1e-3  # of the largest load: less is none


def missing_loads(force: Array) -> Report:
    """Loads beyond those recorded, from told forces of any shape (N); NaN where unknown."""
    known = np.nan_to_num(force)
    known = known[known > LIGHT * known.max(initial=0.0)]
    if not len(known):
        return {f'{KIND}force (no truth of loads)': {}}
    span = {'least': float(known.min()), 'most': float(known.max())}
    return {f'{KIND}loads beyond those recorded (N)': span}


def missing_history(signals: Signals, crept: float) -> Report:
    """What is open of a skin's past, of which a held load leaves a share `crept`; 0: none known.

    Without tare rows before the first touch of a stream, its rest is that of frames between
    touches, in which a skin that creeps has not forgotten: what it crept is then taken for rest,
    or guessed.
    """
    found: Report = {}
    if not _rests_first(signals):
        share = {'share of a load that rests may still hold': crept} if crept > 0 else {}
        found[f'{KIND}rest before any load (no tare rows)'] = share
    if signals.stamp_ns is None:
        found[f'{KIND}creep (frames without stamps)'] = {}
    else:
        found[f'{KIND}holds beyond the longest (s)'] = {'longest': longest_hold(signals)}
    return found


def _rests_first(signals: Signals) -> bool:
    """Whether every stream with a touch is tared before the first of them."""
    if signals.tare is None or not signals.tare.any():
        return False
    begins = np.arange(len(signals.tare)) == 0
    begins |= False if signals.begins is None else signals.begins
    tares = np.cumsum(signals.tare)
    before: Integers = (tares - signals.tare)[begins][np.cumsum(begins) - 1]
    return not ((signals.in_contact == 1) & (tares == before)).any()


def longest_hold(signals: Signals) -> float:
    """Duration of the longest touch (s) of stamped frames; 0: there is none."""
    assert signals.stamp_ns is not None
    touched = signals.in_contact == 1
    first = touched & (~np.roll(touched, 1) | signals.restart)
    first[:1] = touched[:1]
    begun = np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))
    lasted = signals.stamp_ns - signals.stamp_ns[begun]
    return 1e-9 * float(lasted[touched].max(initial=0))
