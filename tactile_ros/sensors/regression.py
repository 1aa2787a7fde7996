# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Estimation by generic regressors, for sensors without a model of their own.

A place, a turn and classes are regressed from the change of the readings since the tare; forces
also from how far that is from its fading means, since skins are viscoelastic, and from the state
of the skin that its resting reading shows. Which regressor serves is chosen on held-out groups;
ridge and nearest neighbours are always among the candidates of a sensor's own choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import ClassVar, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist
from scipy.special import stdtrit

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.covariance import ONE_SIGMA, CovarianceModel
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import held_out_report, select, spread_rows
from tactile_ros.estimators.regression import (
    KernelRidge,
    Perceptron,
    Ridge,
    Standardisation,
    fitted,
    group_folds,
    spread_out,
)
from tactile_ros.estimators.slip_detector import FEWEST, SlipDetector
from tactile_ros.types.contracts import Estimation, Estimator, Report, Signals
from tactile_ros.types.frame import Array, Bools, Columns, FrameStatus, Integers, SensorConfig
from tactile_ros.types.recording import CALM

Scalar = TypeVar('Scalar', bound=np.generic)

FORCES = ('force', 'torque')
TARGETS = ('position', *FORCES)
NAMED = ('cell', 'label')
VOTER = 'grid_knn'
BETTER = 1.5
FEWEST_ROWS = 5
MOST_FOLDS = 10  # of groups or runs that are held out, a fit each
TIME_CONSTANTS = (0.5, 2.0, 8.0, 32.0)
PAST_WEIGHT = 3.0  # relaxation and the set of the skin are small parts of the change; their share
STATE_WEIGHT = 3.0  # of a distance
USUAL_GAIN = 0.025  # standard deviation of the gain between runs before any was recorded
RATIOS = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
PLACE = 1e-5  # m, to which places are the same
MOST_SINGLE = 0.9  # places per touch above which touches, not places, are what repeats
ROUNDING = 1e-9  # of the largest reading: what moves less is a constant
BLOCK = 1024  # rows whose history stays in the cache
STORED, SAME = 13, 1e-9  # features of a touch; of the largest of them
SOFT = 2.0  # width of a step, over the lightest load that counts
CALM_TOUCHES = 0.005  # of held-out rows without a load; unseen runs may have twice as many
BEYOND_CALM = 2.0  # of the largest change without a load: what changes more is a touch
OUT_OF_RANGE = np.int64(FrameStatus.OUT_OF_RANGE)


def methods(*, place: bool = True, trial: bool = False) -> dict[str, Estimator]:
    """All regressors by name, of a place or of a force: here alone a method is registered.

    The skin under a force has moved on since the presses it was learned from: a plane as strong
    as the bumps carries the answer to loads and states beyond those, and presses of one run, on
    which a penalty could be chosen, know nothing of the next. In a trial an ensemble has fewer
    members, and errs slightly more.
    """
    force = KernelRidge(length=0.4, linear=1.0, strengths=(1e-6,), common=10.0)
    return {
        'ridge': Ridge(),
        'grid_knn': GridKnn(),
        'kernel_ridge': KernelRidge() if place else force,
        'perceptron': Perceptron(members=6 if trial else 8, pattern=place),
    }


ESTIMATORS = tuple(methods())


def candidates(wanted: str | None, *, place: bool, trial: bool = False) -> dict[str, Estimator]:
    """Regressors to choose from, by name: the wanted one, or those that suit the target."""
    known = methods(place=place, trial=trial)
    if wanted is not None:
        return {wanted: known[wanted]}
    del known['kernel_ridge' if place else 'perceptron']
    return known


class RestingState:
    """Main way along which resting readings move within runs, and the readings themselves.

    Presses leave a set that recovers slowly, in the resting reading and in the stiffness (Mullins
    effect: Diani, Fayolle and Gilormini, Eur. Polym. J. 45, 2009), which shifts the gain. Of its
    variance a resting reading leaves the share 1 - exp(-(d / l)^2), less that in errors of groups
    held out: at the distance d from the nearest one of the fit, with l twice the root mean square
    deviation within runs (Gaussian process: Rasmussen and Williams, 2006, eq. 2.26).
    """

    centre_: Array  # (d,) mean resting reading (unit of the rests)
    direction_: Array  # (d,) unit vector of the way; 0 where rests never moved
    low_: float  # range of the state, and a quarter more to both sides
    high_: float
    known_: Array  # (n, d) resting readings of the fit, less the centre (unit of the rests)
    width_: float  # l (unit of the rests)
    separate_: bool  # whether no two runs share a resting reading
    usual_: float  # share left between a group and the others

    def fit(self, rests: Array, runs: Integers, groups: Integers) -> RestingState:
        """Learn from the finite resting reading (s, d) under each row, its run and group (s,)."""
        self.centre_ = rests.mean(axis=0)
        within = rests.copy()
        for run in np.unique(runs):
            within[runs == run] -= within[runs == run].mean(axis=0)
        value, vector = np.linalg.eigh(within.T @ within / len(within))
        floor = 1e-4 * float(np.sqrt((rests**2).sum(axis=1).mean())) + 1e-150
        self.width_ = max(2 * float(np.sqrt(max(value.sum(), 0.0))), floor)
        # a sign of its own, so that equal rests give equal numbers on every machine
        way = vector[:, -1] * np.sign(vector[np.argmax(np.abs(vector[:, -1])), -1])
        self.direction_ = way if self.width_ > floor else np.zeros_like(way)
        state = (rests - self.centre_) @ self.direction_
        more = 0.25 * float(np.ptp(state))
        self.low_, self.high_ = float(state.min()) - more, float(state.max()) + more
        known = np.unique(rests - self.centre_, axis=0)
        self.known_ = known[spread_out(known, 32)]
        self.separate_ = len(known) == len(np.unique(np.column_stack([runs, rests]), axis=0))
        first = np.unique(np.column_stack([groups, rests]), axis=0, return_index=True)[1]
        first = spread_rows(first, 256)
        apart = cdist(rests[first], rests[first], 'sqeuclidean')
        apart[groups[first, None] == groups[first]] = np.inf
        near = apart.min(axis=1)  # infinite: a single group, whose rows are held out
        self.usual_ = float(np.mean(-np.expm1(-near / self.width_**2) * (near < np.inf)))
        return self

    def predict(self, rests: Array) -> tuple[Array, Array]:
        """State (s, 1) along the way (unit of the rests), and share (s,) of variance left."""
        fitted(self, 'separate_')
        moved = rests - self.centre_
        state = np.clip(moved @ self.direction_, self.low_, self.high_)[:, None]
        if not self.separate_:
            return state, np.ones(len(rests))
        apart = np.einsum('nd,nd->n', self.known_, self.known_) - 2 * moved @ self.known_.T
        square = np.einsum('sd,sd->s', moved, moved) + apart.min(axis=1)
        left = -np.expm1(-np.maximum(square, 0.0) / self.width_**2)
        return state, np.maximum(left - self.usual_, 0.0)


def gain_spread(predictions: Array, y: Array, runs: Integers) -> float:
    """Half width that holds 68.27 % of gains of unseen runs about that of a fit, by Student.

    Predictions (s, k) of targets of runs (s,) are of fits that had not seen them; of one run only
    the prior is known, which counts as one run.
    """
    gains = []
    for run in np.unique(runs):
        load, own = y[runs == run], predictions[runs == run]
        gains.append(float((own * load).sum() / max((load * load).sum(), 1e-300)))
    variance, count = USUAL_GAIN**2, len(gains)
    if count > 1:
        between = (np.array(gains) - 1) ** 2 / (1 + 1 / (count - 1))
        variance = float(variance + between.sum()) / (1 + count)
    return math.sqrt(variance * (1 + 1 / count)) * float(stdtrit(count, 0.5 + 0.5 * ONE_SIGMA))


class Head:
    """Regressor of those components (`columns`) of one target that truth has.

    It is the `wanted` one by name; None: the best of all. The first `channels` features are the
    change of the readings now; the others are its history.
    """

    name: str  # of the estimator in use
    report_: dict[str, float]  # errors on held-out groups (unit of the target)
    estimator_: Estimator  # fitted on all rows
    state_: RestingState | None  # of a force
    gain_: float  # of a force, half width of the gain of an unseen run
    covariance_: CovarianceModel
    signal_: float  # typical change of the readings
    ratio_: float  # growth of the variance with the square of that over the change

    def __init__(
        self, target: str, columns: tuple[int, ...], wanted: str | None, channels: int
    ) -> None:
        self.target = target
        self.columns = columns
        self.wanted = wanted
        self.channels = channels
        self.name = ''

    def fit(self, x: Array, y: Array, groups: Integers, sessions: Integers, rests: Array) -> Head:
        """Choose, fit and calibrate by features (s, d) and known targets (s, k).

        A split keeps `groups` (s,) together; `sessions` (s,) are runs, which differ in gain, and
        `rests` (s, channels) the resting readings. Beside a history, the last column of x is
        overwritten.
        """
        force, place = self.target in FORCES, self.target == 'position'
        self.state_ = RestingState().fit(rests, sessions, groups) if force else None
        if self.state_ is not None:
            x = self._with_state(x, self.state_.predict(rests)[0])
        tried = candidates(self.wanted, place=place, trial=True)
        slow = 'perceptron' in tried  # thousands of touches are judged well by two fifths of them
        folds, rounds = (5, 2) if slow else (MOST_FOLDS, None)
        choice = select(tried, x, y, groups, folds=folds, rounds=rounds)
        self.name = choice.name
        self.estimator_ = candidates(self.name, place=place)[self.name].fit(x, y, groups)
        self._fit_ratio(choice.x, choice.predictions, choice.residuals)
        stated = self._stated(choice.x, choice.predictions)
        readings = choice.x[:, : self.channels]
        self.covariance_ = CovarianceModel().fit(choice.residuals, stated, choice.groups, readings)
        self.gain_ = self._fit_gain(x, y, sessions) if force else 0.0
        sigma = np.sqrt(np.einsum('skk->sk', self.covariance_.predict(stated, readings)[0]))
        off, groups = choice.residuals, choice.groups
        self.report_ = held_out_report(off, sigma, groups, len(x), choice.errors)
        return self

    @property
    def title(self) -> str:
        """Target with the names of its components."""
        return f'{self.target}_{"".join("xyz"[i] for i in self.columns)}'

    def predict(self, x: Array, rests: Array) -> tuple[Array, Array, Bools]:
        """Components (s, k), covariance (s, k, k) and rows (s,) beyond the training readings.

        Beside a history, the last column of x is overwritten.
        """
        share: Array | None = None
        if self.state_ is not None:
            state, share = self.state_.predict(rests)
            x = self._with_state(x, state)
        mean = self.estimator_.predict(x)
        readings = x[:, : self.channels]
        cov, out_of_range = self.covariance_.predict(self._stated(x, mean), readings)
        if share is not None:
            size = self.gain_ * mean
            cov += size[:, :, None] * size[:, None, :] * share[:, None, None]
        return mean, cov, out_of_range

    def _with_state(self, x: Array, state: Array) -> Array:
        """Features; beside a history, the state of the skin is written to the last of them."""
        if x.shape[1] > self.channels:
            np.multiply(state, STATE_WEIGHT, out=x[:, -1:])
        return x

    def _stated(self, x: Array, mean: Array) -> Array:
        """Standard deviation (s, k) up to the scale that held-out errors give it."""
        faint = self.signal_**2 / (np.square(x[:, : self.channels]).sum(axis=1) + 1e-150)
        sigma = np.sqrt(1 + self.ratio_ * np.minimum(faint, 1e6))
        return np.repeat(sigma[:, None], mean.shape[1], axis=1)

    def _fit_ratio(self, x: Array, mean: Array, residuals: Array) -> None:
        """Learn the most probable ratio from held-out errors (s, k), by Laplace's law."""
        self.signal_ = float(np.median(np.linalg.norm(x[:, : self.channels], axis=1)))
        length = np.linalg.norm(residuals, axis=1)
        costs = []
        for self.ratio_ in RATIOS.tolist():
            sigma = self._stated(x, mean)[:, 0]
            costs.append(float(np.log((length / sigma).mean() + 1e-300) + np.log(sigma).mean()))
        self.ratio_ = float(RATIOS[int(np.argmin(costs))])

    def _fit_gain(self, x: Array, y: Array, sessions: Integers) -> float:
        """Spread of gain between runs, from runs held out; of one run only a prior is known."""
        if (sessions == sessions[0]).all():
            return gain_spread(y, y, sessions)
        unseen = select({'': self.estimator_}, x, y, sessions, folds=MOST_FOLDS)
        return gain_spread(unseen.predictions, unseen.y, unseen.groups)


def known_columns(y: Array, good: Bools) -> Iterator[tuple[tuple[int, ...], Bools]]:
    """Components of y (s, 3) that are known in the same usable rows, and these rows (s,)."""
    known = np.isfinite(y) & good[:, None]
    left = [i for i in range(y.shape[1]) if known[:, i].sum() >= FEWEST_ROWS]
    while left:
        same = tuple(i for i in left if (known[:, i] == known[:, left[0]]).all())
        yield same, known[:, same[0]]
        left = [i for i in left if i not in same]


class Vote:
    """Nearest neighbours that vote for a 'cell' or a 'label' [2], weighted by the distance.

    Votes are used where they are better than chance on held-out groups.
    """

    classes_: Integers  # (k,) those of the fit
    voters_: GridKnn  # of the share of each class
    report_: dict[str, float]  # share of held-out rows named rightly, and of the commonest class

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
        """It is right by half as much again as the commonest class, or nearly always."""
        accuracy, chance = self.report_['held_out_accuracy'], self.report_['chance']
        return accuracy > min(BETTER * chance, 0.5 + chance / 2)

    def predict(self, x: Array) -> tuple[Integers, Array]:
        """Class and its share of the votes, shape (s,) each; -1 and NaN without a reading."""
        shares = self.voters_.predict(x)
        measured = np.isfinite(shares[:, 0])
        best = np.where(measured[:, None], shares, 0.0).argmax(axis=1)
        return np.where(measured, self.classes_[best], -1), shares[np.arange(len(x)), best]


class Touch:
    """Touch by a soft step of the load, which is regressed from the change and its history.

    A skin that creeps back deviates as much as a light touch; its fading means distinguish them.
    Features are in units of what they reach without a load, and grow with the logarithm beyond:
    runs differ least in these. Twice what was ever seen without a load is a touch in any case.
    """

    step_: KernelRidge
    calm_: Array  # (d,) largest features without a load (unit of x)
    level_: float  # step above which something touches
    stored_: Array  # (k, d + 1) a few features of the fit, and their step
    report_: dict[str, float]  # held-out shares of calm and of touched rows called touch

    def fit(self, x: Array, load: Array, groups: Integers, floor: Bools) -> Touch | None:
        """Learn from features (s, d), those of the readings first, and loads (s,) (N).

        None where held-out groups are judged no better than by the threshold, `floor` (s,).
        """
        light = 2 * CALM * float(load.max())
        calm, firm = load <= light / 2, load >= light
        fold = group_folds(np.unique(groups, return_inverse=True)[1].reshape(-1), MOST_FOLDS, 0)
        if not fold.any():
            return None
        step = np.zeros(len(x))
        for held in (fold == part for part in range(fold.max() + 1)):
            self._learn(x[~held], load[~held] / light, calm[~held])
            step[held] = self._step(x[held])
        self.level_ = float(np.quantile(step[calm], 1 - CALM_TOUCHES, method='higher'))
        share = [float(x[r].mean()) for x in (step > self.level_, floor) for r in (calm, firm)]
        false, found, usual, least = share
        if false - found >= usual - least:
            return None
        self.report_ = {
            'held_out_false': false, 'held_out_found': found,
            'threshold_false': usual, 'threshold_found': least,
        }  # fmt: skip
        return self._learn(x, load / light, calm)

    def _learn(self, x: Array, load: Array, calm: Bools) -> Touch:
        """Learn from loads (s,) over the lightest that counts."""
        self.calm_ = np.abs(x[calm]).max(axis=0, initial=1e-150)
        self.step_ = KernelRidge(length=0.8, linear=1.0, strengths=(1e-4,))
        self.step_.fit(np.arcsinh(x / self.calm_), np.tanh(load / SOFT)[:, None])
        few = x[np.linspace(0, len(x) - 1, STORED).astype(np.int64)]
        self.stored_ = np.column_stack([few, self._step(few)])
        return self

    def _step(self, x: Array) -> Array:
        return np.asarray(self.step_.predict(np.arcsinh(x / self.calm_))[:, 0])

    def refuse_damage(self) -> None:
        """Raise ValueError where stored features have another step, or a limit is not finite."""
        off = np.abs(self._step(self.stored_[:, :-1]) - self.stored_[:, -1])
        limits = np.append(self.calm_, self.level_)
        if not (np.isfinite(limits).all() and (off <= SAME * np.abs(self.stored_).max()).all()):
            msg = 'its touch is not that of the fit'
            raise ValueError(msg)

    def predict(self, x: Array) -> Bools:
        """Touch (s,) of features (s, d)."""
        now = slice(x.shape[1] // (1 + len(TIME_CONSTANTS)))
        beyond = np.abs(x[:, now]) > BEYOND_CALM * self.calm_[now]
        return beyond.any(axis=1) | (self._step(x) > self.level_)


class Regression(Estimation):
    """Regressors of a sensor of so many channels, each for components of one target.

    `estimator` is one of `ESTIMATORS`; None: the best of them on held-out groups. Classes are
    voted where it is None or 'grid_knn'. With `flags_range` touched frames whose readings are
    beyond those of the fit have the status OUT_OF_RANGE: not for sensors whose taxels are touched
    a few at a time, since their readings have no spread in common. With `learns_touch` a force
    over time teaches to distinguish a light touch from a skin that creeps back.
    """

    flags_range: ClassVar[bool] = False
    learns_touch: ClassVar[bool] = False
    touch_: Touch | None = None  # files of before it was learned have none

    def __init__(
        self, config: SensorConfig, estimator: str | None = None, channels: int = 3
    ) -> None:
        self.width = channels * len(config.positions)
        self.estimator = estimator
        self.heads_: tuple[Head, ...] = ()
        self.remembering_: tuple[Head, ...] = ()
        self.votes_: tuple[Vote, ...] = ()
        self.turn_: Head | None = None
        self.slip_: SlipDetector | None = None

    def refuse_damage(self) -> None:
        """Raise ValueError where touch is not what its fit stored."""
        if self.touch_ is not None:
            self.touch_.refuse_damage()

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        names = {head.target: head.name for head in self._in_use(stamped=True)}
        names |= {} if self.slip_ is None else {'slip': 'matched_subspace'}
        names |= {} if self.turn_ is None else {'yaw': self.turn_.name}
        return names | {vote.target: VOTER for vote in self.votes_ if vote.useful}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and how often votes are right."""
        found = {head.title: head.report_ for head in self.heads_}
        found |= {f'{head.title}_with_history': head.report_ for head in self.remembering_}
        found |= {} if self.touch_ is None else {'in_contact': self.touch_.report_}
        found |= {} if self.slip_ is None else {'slip': self.slip_.report_}
        found |= {} if self.turn_ is None else {'yaw': self.turn_.report_}
        return found | {vote.target: vote.report_ for vote in self.votes_}

    @property
    def label_names(self) -> tuple[str, ...]:
        """Numbers of the classes: nothing else is known of them."""
        labels = [vote for vote in self.votes_ if vote.target == 'label' and vote.useful]
        return tuple(str(name) for vote in labels for name in vote.classes_)

    def start(self) -> FadingMemory:
        """Fresh memory of a stream."""
        return FadingMemory(np.array(TIME_CONSTANTS))

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth has a component; see `Estimation`."""
        now = signals.delta.reshape(len(signals.good), self.width)
        rest = signals.baseline.reshape(now.shape)
        past = None
        if signals.stamp_ns is not None:
            past = self._with_history(now, signals.stamp_ns, signals.restart, self.start())
        group, session = (np.asarray(groups[key], np.int64) for key in ('group', 'session'))
        heads: dict[bool, tuple[Head, ...]] = {False: (), True: ()}
        for target in TARGETS:
            y = np.asarray(truth.get(target, np.full((len(now), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, signals.good):
                if not _moves(signals.values[rows]):
                    continue
                part = y[rows][:, columns]
                places = places_of(part) if target == 'position' else None
                kept = group[rows] if places is None else places
                for stamped, x in ((False, now), (True, past if target in FORCES else None)):
                    if x is not None:
                        head = Head(target, columns, self.estimator, self.width)
                        head.fit(x[rows], part, kept, session[rows], rest[rows])
                        heads[stamped] += (head,)
        self.heads_, self.remembering_ = heads[False], heads[True]
        vars(self).pop('_best', None)
        self.touch_ = None
        if past is not None and self.learns_touch:
            self._fit_touch(past[:, :-1], signals, truth, group)
        self._fit_classes(signals, truth, group)
        yaw = np.asarray(truth.get('yaw', np.full(len(now), np.nan)), np.float64)
        rows, self.turn_ = signals.good & np.isfinite(yaw), None
        if rows.sum() >= FEWEST_ROWS:
            y = np.column_stack([np.cos(yaw[rows]), np.sin(yaw[rows])])  # without a seam
            head = Head('yaw', (0, 1), self.estimator, self.width)
            self.turn_ = head.fit(now[rows], y, group[rows], session[rows], rest[rows])

    def _fit_touch(self, x: Array, signals: Signals, truth: Columns, group: Integers) -> None:
        """Learn touch where there are true forces with and without a load."""
        force = np.asarray(truth.get('force', np.full((len(x), 3), np.nan)), np.float64)
        load = np.linalg.norm(np.nan_to_num(force), axis=1)
        rows = signals.good & np.isfinite(force).any(axis=1)
        if signals.tare is not None:
            rows &= ~signals.tare
        calm = load[rows] <= CALM * load[rows].max(initial=0.0)
        if min(calm.sum(), (~calm).sum()) >= FEWEST_ROWS:
            floor = signals.in_contact[rows] == 1
            self.touch_ = Touch().fit(x[rows], load[rows], group[rows], floor)

    def _fit_classes(self, signals: Signals, truth: Columns, group: Integers) -> None:
        """Learn votes for cells and labels, and slip, where enough rows have them."""
        now, unknown = signals.delta.reshape(-1, self.width), np.full(len(group), -1)
        votes: list[Vote] = []
        for target in NAMED if self.estimator in (None, VOTER) else ():
            named = np.asarray(truth.get(target, unknown), np.int64)
            rows = signals.good & (named >= 0)
            if rows.sum() >= FEWEST_ROWS:
                votes.append(Vote(target).fit(now[rows], named[rows], group[rows]))
        self.votes_ = tuple(votes)
        # a sequence is a stretch of one stream and repetition with one label
        slips = np.asarray(truth.get('slip', unknown), np.int64)
        begins = np.ones(len(now), bool)
        begins[1:] = (slips[1:] != slips[:-1]) | (group[1:] != group[:-1])
        sequence = np.cumsum(begins if signals.begins is None else begins | signals.begins)
        rows = signals.good & (slips >= 0)
        counts = [len(np.unique(sequence[rows & (slips == label)])) for label in (0, 1)]
        self.slip_ = None
        if min(counts) >= FEWEST:
            self.slip_ = SlipDetector().fit(now[rows], slips[rows], sequence[rows])

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets and covariances of every row, NaN for components that truth never had."""
        assert isinstance(memory, FadingMemory)
        now = signals.delta.reshape(len(signals.good), self.width)
        rest = signals.baseline.reshape(now.shape)
        known: Columns = {}
        for head in self.heads_:
            if head.target not in known:
                known[head.target] = np.full((len(now), 3), np.nan)
                known[f'{head.target}_cov'] = np.full((len(now), 3, 3), np.nan)
        beyond, contact = np.zeros(len(now), bool), signals.in_contact.copy()
        for i in range(0, len(now), BLOCK):
            block = slice(i, i + BLOCK)
            past = None
            if signals.stamp_ns is not None and self.remembering_:
                stamps, restart = signals.stamp_ns[block], signals.restart[block]
                past = self._with_history(now[block], stamps, restart, memory)
            if past is not None and self.touch_ is not None:
                contact[block] = np.where(
                    contact[block] < 0, -1, self.touch_.predict(past[:, :-1])
                )
            for head in self._in_use(signals.stamp_ns is not None):
                x = past if past is not None and head in self.remembering_ else now[block]
                mean, cov, far = head.predict(x, rest[block])
                index = np.array(head.columns)
                known[head.target][block, index] = mean
                known[f'{head.target}_cov'][block, index[:, None], index] = cov
                beyond[block] |= far
        self._add_classes(known, now, rest)
        if self.flags_range and np.count_nonzero(beyond):
            known['status'] = (beyond & (contact != 0)) * OUT_OF_RANGE
        if self.touch_ is not None:
            if signals.tare is not None:
                contact[signals.tare] = 0
            known['in_contact'] = contact
        return known

    def _add_classes(self, known: Columns, now: Array, rest: Array) -> None:
        """Add slip, cell, label and yaw of changes (s, d) of readings."""
        if self.slip_ is not None:
            probability = self.slip_.predict(now)
            slipping = np.where(np.isnan(probability), -1, probability > 0.5)
            known['slip'], known['slip_probability'] = slipping.astype(np.int8), probability
        for vote in self.votes_:
            if vote.useful:
                known[vote.target], known[f'{vote.target}_probability'] = vote.predict(now)
        if self.turn_ is not None:
            mean, cov, _ = self.turn_.predict(now, rest)
            length = np.maximum(np.linalg.norm(mean, axis=1), 1e-9)
            across = np.column_stack([-mean[:, 1], mean[:, 0]]) / length[:, None]
            known['yaw'] = np.arctan2(mean[:, 1], mean[:, 0])
            known['yaw_std'] = np.sqrt(np.einsum('si,sij,sj->s', across, cov, across)) / length

    def _in_use(self, stamped: bool) -> tuple[Head, ...]:
        """Heads for frames; a history, which stamps give, is used where it helped."""
        return self._best if stamped and self.remembering_ else self.heads_

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
        filled = wide[:, :-1].reshape(shape)  # a view: the head fills the last column
        filled[:, 0] = now
        np.multiply(behind, PAST_WEIGHT, out=filled[:, 1:])
        return wide


def _moves(values: Array) -> bool:
    """Readings (s, t, c) are more than one constant, from which nothing is learned."""
    read = np.nan_to_num(values)
    return bool((np.ptp(read, axis=0) > ROUNDING * np.abs(read).max(initial=0.0)).any())


def scatter_rows(column: npt.NDArray[Scalar], rows: Integers, count: int) -> npt.NDArray[Scalar]:
    """Column of some rows for all of them, NaN or -1 in the others."""
    blank = np.nan if column.dtype.kind == 'f' else -1
    wide = np.full((count, *column.shape[1:]), blank, column.dtype)
    wide[rows] = column
    return wide


def places_of(plane: Array) -> Integers | None:
    """Number (s,) of the touched place of each row (s, d) (m), -1: unknown; None: none repeats."""
    rows = np.isfinite(plane).all(axis=1)
    rounded, groups = np.round(plane[rows] / PLACE), np.full(len(plane), -1, np.int64)
    groups[rows] = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)
    repeat = 0 < groups.max(initial=-1) + 1 <= MOST_SINGLE * len(rounded)
    return groups if repeat else None


CLASSES = (
    Regression, Head, Touch, Vote, RestingState, SlipDetector, CovarianceModel,
    Standardisation, *map(type, methods().values()),
)  # fmt: skip


KIND = 'not learned: '
LIGHT = 1e-3  # of the largest load: less is none


def missing_loads(force: Array) -> Report:
    """Loads beyond those recorded, from estimated forces of any shape (N); NaN where unknown."""
    known = np.nan_to_num(force)
    known = known[known > LIGHT * known.max(initial=0.0)]
    if not len(known):
        return {f'{KIND}force (no truth of loads)': {}}
    span = {'least': float(known.min()), 'most': float(known.max())}
    return {f'{KIND}loads beyond those recorded (N)': span}


def missing_history(signals: Signals, crept: float) -> Report:
    """Unknown part of a skin's past, of which a held load leaves a share `crept`; 0: none.

    Without tare rows before the first touch, what a skin has crept is taken for rest, or guessed.
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
    """Every stream with a touch is tared before the first of them."""
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
