# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Windows in, contacts out: force of every frame; label, place and turn once a window.

Regressors and votes of frames, as every sensor has them, stay candidates beside what recognises
whole presses; held-out places decide which of them speaks of label, place and turn.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaincinv

from tactile_ros.estimators.few_shot import SupportSet, press_patterns
from tactile_ros.estimators.model_selection import spread_rows
from tactile_ros.physics.magnetics import rotations
from tactile_ros.sensors.multipole_skin.press_fit import Labels, drawn_skin, learn
from tactile_ros.sensors.multipole_skin.recogniser import (
    FEWEST,
    NETWORKS,
    WEAKEST,
    NetworkClasses,
    Recogniser,
    class_chances,
    usable,
)
from tactile_ros.sensors.regression import Regression, scatter_rows
from tactile_ros.types import Estimation

if TYPE_CHECKING:
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.sensors.multipole_skin.recogniser import Answers, Recogniser
    from tactile_ros.types import Array, Columns, Integers, Report, Signals

ONCE = ('label', 'label_probability', 'cell', 'cell_probability', 'position', 'position_cov',
        'yaw', 'yaw_std')  # fmt: skip


def column_of(truth: Columns, name: str, rows: Integers, width: int) -> Array:
    """A column of truth at some rows, shape (n, width); NaN where it is unknown."""
    found = truth.get(name)
    if found is None:
        return np.full((len(rows), width), np.nan)
    return np.asarray(found, np.float64).reshape(len(found), width)[rows]


def only_rows(known: Columns, rows: Integers) -> None:
    """Blank what is answered once a window in all other rows; `known` is changed."""
    for name in set(ONCE) & set(known):
        known[name] = scatter_rows(known[name][rows], rows, len(known[name]))


@dataclass
class WindowMemory:
    """Memory of a stream."""

    past: object  # of what else estimates from the stream
    frames: list[Array] = field(default_factory=list)  # newest changes of field (d,), a window
    # frames since the stream began, and in contact since the last window
    age: int = 0
    held: int = 0


def find_windows(
    signals: Signals, size: int, memory: WindowMemory
) -> tuple[list[int], list[Array]]:
    """Windows of a size that end in some frames: last rows, and changes of field (w, d).

    Rows that could not be used are NaN; the memory moves on.
    """
    delta = signals.delta.reshape(len(signals.good), int(np.prod(signals.delta.shape[1:])))
    if signals.stamp_ns is None:  # frames without times are presses of their own
        rows = np.flatnonzero(signals.good & (signals.in_contact != 0))
        return rows.tolist(), [delta[i : i + 1] for i in rows]
    ends, found = [], []
    for i, contact in enumerate(signals.in_contact):
        if signals.restart[i]:
            memory.frames.clear()
            memory.age, memory.held = 0, 0
        good = bool(signals.good[i])
        memory.frames.append(delta[i] if good else np.full(delta.shape[1], np.nan))
        del memory.frames[:-size]
        memory.age += 1
        if contact == 0:
            memory.held = 0
        else:  # an unusable frame ends no press, nor does one that nobody can judge
            memory.held += memory.held > 0 or good
        whole = memory.held >= size or (memory.age == size and contact != 0)
        if whole and good:
            ends.append(i)
            found.append(np.array(memory.frames))
            memory.held = 0
    return ends, found


def press_numbers(signals: Signals, size: int) -> Integers:
    """Which press each frame is of, shape (s,).

    A press ends where a stream does, and with a window of rest: contact that flickers where a head
    comes down or leaves makes no second one. Frames without times are presses of their own.
    """
    count = len(signals.good)
    if signals.stamp_ns is None:
        return np.arange(count)
    touched = np.flatnonzero(signals.in_contact != 0)
    before = np.concatenate([[-1], touched[:-1]])
    rested = touched - before > size
    stream = np.cumsum(signals.restart)
    anew = stream[touched] != stream[before]
    number = np.zeros(count, np.int64)
    number[touched] = 1
    number[touched[~(rested | anew)]] = 0
    return np.cumsum(number)


FOLDS = 5
FIRM = 2 * WEAKEST  # sigma: a press to learn from must be clearer than one to recognise


def enrolled(
    recogniser: Recogniser, signals: Signals, size: int, number: int, name: str
) -> SupportSet:
    """SupportSet of a new class from conditioned frames of its presses, windows of a size.

    ValueError if no press is found, one is clipped or faulty, or one is too weak.
    """
    ends, windows = find_windows(signals, size, WindowMemory(None))
    spoilt = int((~signals.good).sum())
    if spoilt:
        msg = (
            f'presses of {name!r} must be whole; {spoilt} of {len(signals.good)} frames '
            'are clipped or faulty: press less, or choose a larger range'
        )
        raise ValueError(msg)
    if not windows:
        msg = (
            f'recording of {name!r} must hold a press of {size} frames; '
            'found none: press harder, and longer'
        )
        raise ValueError(msg)
    presses = press_patterns(windows, len(recogniser.noise))
    strength = recogniser.strength(presses)
    weak = strength < FIRM
    if weak.any():
        msg = (
            f'presses of {name!r} must reach {FIRM:.0f} sigma of the noise; '
            f'{int(weak.sum())} of {len(weak)} reach {strength.min():.1f}: press harder'
        )
        raise ValueError(msg)
    labels = np.full(len(presses.pattern), number)
    press = press_numbers(signals, size)[np.array(ends)]
    press += recogniser.enrolled_.number.max(initial=-1) + 1
    return recogniser.supports(presses, labels, press)


def lost_by(recogniser: Recogniser, number: int) -> dict[str, float]:
    """Held-out presses of known classes that a class now takes: count, share, 95 % bound.

    Lost is what would be named rightly without the class. A press is lost with the first of its
    windows: they are no evidence of their own. Shares are NaN where none is known.
    """
    known = recogniser.known_
    press = np.asarray(np.unique(known.number, return_inverse=True)[1], np.int64).reshape(-1)
    count = int(press.max(initial=-1)) + 1
    part = press * FOLDS // max(count, 1)
    lost = np.zeros(count, bool)
    for fold in np.unique(part):
        rows = np.flatnonzero(part == fold)
        presses = known.rows(rows)
        seen = recogniser.evidence_by(known.rows(np.flatnonzero(part != fold)), recogniser.road_)
        matches = recogniser.matches(presses)
        labels, scores, _ = recogniser.scores(presses, matches, seen, recogniser.road_)
        without = np.where(labels == number, np.inf, scores)
        taken = (labels[scores.argmin(axis=1)] == number) & np.isfinite(without.min(axis=1))
        taken &= labels[without.argmin(axis=1)] == known.label[rows]
        lost[press[rows[taken]]] = True
    taken_of = int(lost.sum())
    share = taken_of / count if count else float('nan')
    # Clopper and Pearson's
    most = betaincinv(taken_of + 1, count - taken_of, 0.95) if taken_of < count else share
    return {
        'known_presses_judged': float(count),
        'known_presses_lost': share,
        'known_presses_lost_at_most': float(most),
    }


def lost_there(recogniser: Recogniser, new: SupportSet, number: int) -> dict[str, float]:
    """Share of the other classes that a class takes where it was pressed.

    A class is taken whole or not at all, by chance, since what its template or its presses are
    wrong by is the same from press to press: it is what pressed, as far as it was known without
    the new class. Of each that is more likely taken than not, the chance stands under its number;
    NaN where none is open.
    """
    found = recogniser.scores(new, recogniser.matches(new), recogniser.evidence, recogniser.road_)
    others = found[0] != number
    labels = found[0][others]
    if not len(labels):
        return {'lost_there': float('nan'), 'lost_there_at_most': float('nan')}
    # by how well each fits: the nearest one of classes that nobody described need not be alike
    fits = class_chances(found[1][:, others], found[2][:, others])[0]
    chance = fits.mean(axis=0)
    taken = {
        f'lost_there {label}': float(one)
        for label, one in zip(labels.tolist(), chance, strict=True)
        if one > 0.5
    }
    return {'lost_there': float(chance.mean()), 'lost_there_at_most': _most_of(chance), **taken}


def _most_of(chances: Array) -> float:
    """Upper bound (95 %) of the share of heads that are lost, each by a chance (n,)."""
    count = np.ones(1)
    for chance in chances:
        count = np.convolve(count, [1 - chance, chance])
    return float(np.searchsorted(np.cumsum(count), 0.95)) / len(chances)


def object_pose(answers: Answers, place: Array) -> tuple[Array, Array]:
    """Transforms (n, 4, 4) of recognised objects at places (n, 3), their covariance (n, 6, 6)."""
    n = len(place)
    pose, cov = np.zeros((n, 4, 4)), np.zeros((n, 6, 6))
    pose[:, :3, :3] = rotations(answers.pose[:, 2:] * np.array([0.0, 0.0, 1.0]))
    pose[:, 3, 3], pose[:, :3, 3] = 1.0, place
    cov[:, 2, 2] = DEEP**2
    index = np.array([0, 1, 5])
    cov[:, index[:, None], index] = answers.cov
    nobody = np.isnan(answers.pose[:, 2]) | np.isnan(place).any(axis=1)
    pose[nobody], cov[nobody] = np.nan, np.nan
    return pose, cov


NOISE = 4e-6  # T, of a reading, where rest tells none
FEWEST_RESTING = 20
QUIETEST = 1e-7  # T
THIRD = 20.0  # variance of a third difference over that of a frame
DEEP = 1e-3  # m, by which the face of a pressed skin is uncertain
MOST_LEARNED = 1500  # windows
UNFITTED = ('size', 'layer', 'thickness', 'pole_pitch', 'youngs', 'poisson')  # of a skin


class MultipoleEstimation(Estimation):
    """Estimators of one multipole skin.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Drawing of the skin: where a fit starts.
    estimator : str or None
        A regressor of frames, or a network of [1], which names presses and no more; None: the
        best of all ways on held-out places.

    Attributes
    ----------
    frames_ : Regression
        Regressors and votes of frames.
    recogniser_ : Recogniser or None
        Of presses; None before a fit, and where a regressor was asked for.
    network_ : NetworkClasses or None
        Network of [1], where it is what names known classes.
    by_press_, names_ : tuple of str
        Targets of which the recogniser speaks; names of enrolled classes.
    """

    learns_classes = True

    def __init__(self, config: MultipoleSkinConfig, estimator: str | None = None) -> None:
        self.frames_ = Regression(config, None if estimator in NETWORKS else estimator)
        self.config, self.wanted = config, estimator
        self.network_: NetworkClasses | None = None
        self.recogniser_: Recogniser | None = None
        self.by_press_: tuple[str, ...] = ()
        self.press_report_: Report = {}
        self.names_: tuple[str, ...] = ()
        self.first_new_ = len(config.objects)

    def refuse_damage(self) -> None:
        """Raise ValueError where the skin is not the drawn one; see `Estimation`."""
        model = None if self.recogniser_ is None else self.recogniser_.model
        # templates of another size may take all memory
        drawn = vars(drawn_skin(self.config))
        if model and not all(np.array_equal(vars(model)[name], drawn[name]) for name in UNFITTED):
            msg = 'its skin is not the one that its config draws'
            raise ValueError(msg)

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        road = {} if self.recogniser_ is None else {
            target: self.recogniser_.road_ if target == 'label' else 'press_templates'
            for target in self.by_press_
        }  # fmt: skip
        network = {} if self.network_ is None else {'label': self.network_.name}
        return {**self.frames_.estimators, **network, **road}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        return {**self.frames_.report, **self.press_report_}

    @property
    def label_names(self) -> tuple[str, ...]:
        """Objects of the config, numbers of classes beyond them, and enrolled classes."""
        if self.recogniser_ is None:
            return self.frames_.label_names
        objects = [outline.name for outline in self.config.objects]
        beyond = [str(i) for i in range(len(objects), self.first_new_)]
        return (*objects, *beyond, *self.names_)

    def start(self) -> WindowMemory:
        """Fresh memory of a stream."""
        return WindowMemory(self.frames_.start())

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        ends, windows = find_windows(signals, self.config.window, self.start())
        rows = np.array(ends, np.int64)
        if self.wanted not in NETWORKS:
            last = dict(truth)  # answers of once a window are learned at its last row alone
            only_rows(last, rows)
            self.frames_.fit(signals, last, groups)
        self.recogniser_, self.by_press_, self.press_report_ = None, (), {}
        self.network_, self.names_ = None, ()
        self.first_new_ = len(self.config.objects)
        if self.wanted is not None and self.wanted not in NETWORKS:
            return
        if len(rows) > MOST_LEARNED:
            chosen = spread_rows(np.arange(len(rows)), MOST_LEARNED)
            rows, windows = rows[chosen], [windows[i] for i in chosen]
        label = np.asarray(truth.get('label', np.full(len(signals.good), -1)), np.int64)[rows]
        self.first_new_ = max(self.first_new_, int(label.max(initial=-1)) + 1)
        group = np.asarray(groups['group'], np.int64)
        timed = signals.stamp_ns is not None
        number = press_numbers(signals, self.config.window) if timed else group
        labels = Labels(
            label, column_of(truth, 'position', rows, 3), column_of(truth, 'yaw', rows, 1)[:, 0],
            group[rows], number[rows],
        )  # fmt: skip
        # a chip that was dead throughout reads 0
        dead = (signals.values[signals.good] == 0).all(axis=(0, 2)) & bool(signals.good.any())
        self.recogniser_, self.press_report_ = learn(
            self.config, self._rest(signals), self._noise(signals, windows), windows, labels, dead
        )
        if self.wanted is None:
            self._choose()
        elif (usable(windows) & (label >= 0)).sum() >= FEWEST:
            what = self.wanted.removeprefix('pronet_')
            self.network_ = NetworkClasses(what).fit(windows, label, labels.groups)
            right = {f'accuracy_{self.wanted}': self.network_.right}
            self.press_report_['label_by_network'] = right

    def _rest(self, signals: Signals) -> Array:
        """Resting readings (t, 3) of the usual baseline; zeros where there is none."""
        rows = signals.good & np.isfinite(signals.baseline).all(axis=(1, 2))
        if not rows.any():
            return np.zeros(signals.baseline.shape[1:])
        return np.asarray(np.median(signals.baseline[rows], axis=0))

    def _noise(self, signals: Signals, windows: list[Array]) -> Array:
        """Noise of every reading (d,): from the config, from rest, from presses, or a usual one.

        Third differences of the frames of a press hold little but noise.
        """
        width = self.frames_.width
        if self.config.noise is not None:
            return np.broadcast_to(self.config.noise, signals.delta.shape[1:]).ravel() + 0.0
        rows = signals.good & (signals.in_contact == 0)
        still = signals.delta[rows].reshape(int(rows.sum()), -1)
        typical = float(np.median(still.std(axis=0))) if len(still) >= FEWEST_RESTING else 0.0
        if typical <= QUIETEST:
            third = [np.diff(window, 3, axis=0).ravel() for window in windows]
            square = np.square(np.concatenate([*third, np.zeros(0)])) / THIRD
            square = square[np.isfinite(square)]
            typical = float(np.sqrt(square.mean())) if len(square) >= FEWEST_RESTING else NOISE
        return np.full(width, typical if typical > QUIETEST else NOISE)

    def _choose(self) -> None:
        """Let presses, or a network, speak of what they tell better than frames do."""
        assert self.recogniser_ is not None
        report, frames = self.press_report_, self.frames_.report
        described, road = self.recogniser_.described, self.recogniser_.road_
        # what knows but some of the heads that may press speaks of none
        seen = set(self.recogniser_.known_.label.tolist())
        all_seen = not described or seen.issuperset(range(len(self.config.objects)))
        right = report.get('label_by_press', {}).get(f'accuracy_{road}', 0.0)
        votes = 0.0
        if all_seen and 'label' in self.frames_.estimators:
            votes = frames['label']['held_out_accuracy']
        chosen = []
        if right >= votes and (described or seen):
            chosen.append('label')
        for target in ('position', 'yaw') if described else ():
            own = report.get(f'{target}_by_press', {}).get('median', np.inf)
            means = [
                found['held_out_mean']
                for title, found in frames.items()
                if title.startswith(target) and 'held_out_mean' in found
            ]
            if not means or own < means[0]:
                chosen.append(target)
        self.by_press_ = tuple(chosen)
        # frames are asked no more of what presses tell
        self.press_report_ = {**frames, **report}
        if 'yaw' in chosen:
            self.frames_.turn_ = None
        if 'label' in chosen:
            votes_left = (vote for vote in self.frames_.votes_ if vote.target != 'label')
            self.frames_.votes_ = tuple(votes_left)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; label, place and turn on the last frame of a window."""
        assert isinstance(memory, WindowMemory)
        known = self.frames_.estimate(signals, memory.past)
        ends, windows = find_windows(signals, self.config.window, memory)
        rows, n = np.array(ends, np.int64), len(signals.good)
        if signals.stamp_ns is not None:
            only_rows(known, rows)
        spoken = self.by_press_ or self.names_ or self.network_ is not None
        if self.recogniser_ is None or not spoken:
            return known
        presses = press_patterns(windows, self.frames_.width)
        answers = self.recogniser_.answer(presses)
        if self.network_ is not None:
            firm = self.recogniser_.strength(presses) >= WEAKEST
            label, chance = self.network_.predict(windows, firm)
            known['label'] = scatter_rows(label, rows, n)
            known['label_probability'] = scatter_rows(chance, rows, n)
        # where votes or a network are better, presses name enrolled classes alone
        all_mine = 'label' in self.by_press_
        mine = all_mine | (answers.label >= self.first_new_)
        columns = (('label', answers.label), ('label_probability', answers.probability))
        for name, column in columns:
            if all_mine or name not in known:
                known[name] = scatter_rows(column[:0], rows[:0], n)
            known[name][rows[mine]] = column[mine]
        if 'position' in self.by_press_:
            self._place(known, rows, answers, n)
        if 'yaw' in self.by_press_:
            deviation = np.sqrt(answers.cov[:, 2, 2])
            more: Columns = {
                'yaw': answers.pose[:, 2], 'yaw_std': deviation, 'symmetry': answers.order,
                'object_pose': np.full((len(rows), 4, 4), np.nan),
                'object_pose_cov': np.full((len(rows), 6, 6), np.nan),
            }  # fmt: skip
            if 'position' in self.by_press_:
                place = np.asarray(known['position'][rows], np.float64)
                more['object_pose'], more['object_pose_cov'] = object_pose(answers, place)
            known.update({name: scatter_rows(column, rows, n) for name, column in more.items()})
        return known

    def _place(self, known: Columns, rows: Integers, answers: Answers, n: int) -> None:
        """Write places, of which regressors may know the height."""
        place = known.get('position', np.full((n, 3), np.nan))
        cov = known.get('position_cov', np.full((n, 3, 3), np.nan))
        if 'position' not in known:
            place[rows, 2] = self.config.layer_thickness + self.config.sheet_thickness
            cov[rows, 2, 2] = DEEP**2
        place[rows, :2] = answers.pose[:, :2]
        cov[rows, :2], cov[rows, :, :2] = 0.0, 0.0
        cov[rows[:, None, None], np.arange(2)[:, None], np.arange(2)] = answers.cov[:, :2, :2]
        lost = np.isnan(place[rows, 0])
        place[rows[lost]], cov[rows[lost]] = np.nan, np.nan
        known['position'], known['position_cov'] = place, cov

    def enrol(self, signals: Signals, label: str) -> None:
        """Learn a class from the presses in conditioned frames; see `enrolment`.

        ValueError if nothing was fitted, the name is taken, or a press is of no use.
        """
        if self.recogniser_ is None:
            msg = f'enrol of {label!r} must follow a fit of a method by presses; none was made'
            raise ValueError(msg)
        if label in self.label_names and label not in self.names_:
            msg = f'label of enrol must be new; {label!r} is known from the fit'
            raise ValueError(msg)
        names = self.names_ if label in self.names_ else (*self.names_, label)
        number = self.first_new_ + names.index(label)
        old = self.recogniser_
        new = enrolled(old, signals, self.config.window, number, label)
        tried = old.changed(enrolled_=old.enrolled_.joined(new))
        stated = {
            'presses': float(len(np.unique(new.number))),
            **lost_by(tried, number), **lost_there(tried, new, number),
        }  # fmt: skip
        # all of it, or nothing where judging fails
        self.recogniser_, self.names_ = tried, names
        self.press_report_ = {**self.press_report_, f'enrolled {label}': stated}

    def forget(self, label: str) -> None:
        """Undo the enrolment of a class; those enrolled after it move up.

        ValueError if it was never enrolled.
        """
        if label not in self.names_ or self.recogniser_ is None:
            msg = f'label of forget must be enrolled, one of {self.names_}; received {label!r}'
            raise ValueError(msg)
        number = self.first_new_ + self.names_.index(label)
        old = self.recogniser_
        self.recogniser_ = old.changed(enrolled_=old.enrolled_.without(number))
        self.names_ = tuple(name for name in self.names_ if name != label)
        self.press_report_ = {
            k: v for k, v in self.press_report_.items() if k != f'enrolled {label}'
        }
