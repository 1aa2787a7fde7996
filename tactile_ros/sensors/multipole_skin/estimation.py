"""Windows in, contacts out: force of every frame; label, place and turn once a window.

Regressors and votes of frames, as every sensor has them, stay candidates beside what recognises
whole presses; held-out places decide which of them speaks of label, place and turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.press_window import press_vectors
from tactile_ros.regression import Recognition
from tactile_ros.sensors.multipole_skin.columns import column_of, only_rows, write_rows
from tactile_ros.sensors.multipole_skin.enrolment import costs, enrolled
from tactile_ros.sensors.multipole_skin.network_classes import (
    NETWORKS,
    NetworkClasses,
    best_network,
)
from tactile_ros.sensors.multipole_skin.press_fit import Told, learned
from tactile_ros.sensors.multipole_skin.recogniser import WEAKEST
from tactile_ros.sensors.multipole_skin.windows import (
    WindowMemory,
    find_windows,
    press_numbers,
)

if TYPE_CHECKING:
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.sensors.multipole_skin.recogniser import Answers, Recogniser
    from tactile_ros.types import Array, Columns, Integers, Report, Signals

NOISE = 4e-6  # T, of a reading, where rest tells none
FEWEST_RESTING = 20
QUIETEST = 1e-7  # T
DEEP = 1e-3  # m, by which the face of a pressed skin is uncertain
MOST_LEARNED = 1500  # windows


class MultipoleEstimation:
    """Estimators of one multipole skin.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Drawing of the skin: where a fit starts.
    estimator : str or None
        A regressor of frames, or a network of [1], which names presses and no more; None: the
        best of all roads on held-out places.

    Attributes
    ----------
    frames_ : Recognition
        Regressors and votes of frames.
    recogniser_ : Recogniser or None
        Of presses; None before a fit, and where a regressor was asked for.
    network_ : NetworkClasses or None
        Network of [1], where it is what names known classes.
    by_press_ : tuple of str
        Targets of which the recogniser speaks.
    names_ : tuple of str
        Of enrolled classes.
    """

    def __init__(self, config: MultipoleSkinConfig, estimator: str | None = None) -> None:
        self.frames_ = Recognition(config, None if estimator in NETWORKS else estimator)
        self.config, self.wanted = config, estimator
        self.network_: NetworkClasses | None = None
        self.recogniser_: Recogniser | None = None
        self.by_press_: tuple[str, ...] = ()
        self.press_report_: Report = {}
        self.names_: tuple[str, ...] = ()
        self.first_new_ = len(config.objects)

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
        if self.wanted not in NETWORKS:
            self.frames_.fit(signals, truth, groups)
        self.recogniser_, self.by_press_, self.press_report_ = None, (), {}
        self.network_, self.names_ = None, ()
        self.first_new_ = len(self.config.objects)
        if self.wanted is not None and self.wanted not in NETWORKS:
            return
        ends, windows = find_windows(signals, self.config.window, self.start())
        rows = np.array(ends, np.int64)
        if len(rows) > MOST_LEARNED:
            chosen = np.unique(np.linspace(0, len(rows) - 1, MOST_LEARNED).astype(int))
            rows, windows = rows[chosen], [windows[i] for i in chosen]
        label = np.asarray(truth.get('label', np.full(len(signals.good), -1)), np.int64)[rows]
        self.first_new_ = max(self.first_new_, int(label.max(initial=-1)) + 1)
        group = np.asarray(groups['group'], np.int64)
        timed = signals.stamp_ns is not None
        number = press_numbers(signals, self.config.window) if timed else group
        told = Told(
            label, column_of(truth, 'position', rows, 3), column_of(truth, 'yaw', rows, 1)[:, 0],
            group[rows], number[rows],
        )  # fmt: skip
        # a chip that was dead throughout reads 0
        dead = (signals.values[signals.good] == 0).all(axis=(0, 2)) & bool(signals.good.any())
        self.recogniser_, self.press_report_ = learned(
            self.config, self._rest(signals), self._noise(signals), windows, told, dead
        )
        asked = NETWORKS if self.wanted is None else (self.wanted,)
        self.network_ = best_network(asked, windows, label, told.groups)
        if self.wanted is None:
            self._choose()

    def _rest(self, signals: Signals) -> Array:
        """Resting readings (t, 3) of the usual baseline; zeros where there is none."""
        rows = signals.good & np.isfinite(signals.baseline).all(axis=(1, 2))
        if not rows.any():
            return np.zeros(signals.baseline.shape[1:])
        return np.asarray(np.median(signals.baseline[rows], axis=0))

    def _noise(self, signals: Signals) -> Array:
        """Noise of every reading (d,): from the config, from rest, or what is usual."""
        if self.config.noise is not None:
            return np.broadcast_to(self.config.noise, signals.delta.shape[1:]).ravel() + 0.0
        rows = signals.good & (signals.in_contact == 0)
        still = signals.delta[rows].reshape(int(rows.sum()), -1)
        if len(still) < FEWEST_RESTING:
            return np.full(self.frames_.width, NOISE)
        typical = float(np.median(still.std(axis=0)))
        return np.full(self.frames_.width, typical if typical > QUIETEST else NOISE)

    def _choose(self) -> None:
        """Let presses speak of what they tell better than frames do."""
        assert self.recogniser_ is not None
        report, frames = self.press_report_, self.frames_.report
        templates = self.recogniser_.search is not None
        chosen = []
        by_press = report.get('label_by_press', {})
        right = by_press.get(f'accuracy_{self.recogniser_.road_}')
        theirs = 0.0
        if self.network_ is not None:
            report['label_by_network'] = {f'accuracy_{self.network_.name}': self.network_.right}
            told = self.network_.useful and self._names_all()
            theirs = self.network_.right if told else 0.0
        if theirs <= max(right or 0.0, self._votes(frames)):
            self.network_ = None
        if self.network_ is None and (
            templates and 'label' not in frames if right is None else right >= self._votes(frames)
        ):
            chosen.append('label')
        for target in ('position', 'yaw'):
            own = report.get(f'{target}_by_press', {}).get('median', np.inf)
            means = [
                found['held_out_mean']
                for title, found in frames.items()
                if title.startswith(target) and 'held_out_mean' in found
            ]
            other = means[0] if means else np.inf
            if templates and (own < other or (not means and not np.isfinite(own))):
                chosen.append(target)
        self.by_press_ = tuple(chosen)
        self._spare_frames(frames)

    def _spare_frames(self, report: Report) -> None:
        """Ask frames no more of what presses tell."""
        if 'yaw' in self.by_press_ and 'yaw' in report:
            self.press_report_['yaw'], self.frames_.turn_ = report['yaw'], None
        if 'label' in self.by_press_ or self.network_ is not None:
            votes = self.frames_.votes_
            self.press_report_.update({v.target: v.report_ for v in votes if v.target == 'label'})
            self.frames_.votes_ = tuple(vote for vote in votes if vote.target != 'label')

    def _votes(self, frames: Report) -> float:
        """How often votes of frames are right; never, where they cannot name every head."""
        if not self._names_all() or 'label' not in self.frames_.estimators:
            return 0.0
        return frames.get('label', {}).get('held_out_accuracy', 0.0)

    def _names_all(self) -> bool:
        """Whether every head that templates would name was seen."""
        assert self.recogniser_ is not None
        seen = set(self.recogniser_.known_.label.tolist())
        heads = range(len(self.config.objects)) if self.recogniser_.search is not None else ()
        return seen.issuperset(heads)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; label, place and turn on the last frame of a window."""
        assert isinstance(memory, WindowMemory)
        known = self.frames_.estimate(signals, memory.past)
        ends, windows = find_windows(signals, self.config.window, memory)
        rows = np.array(ends, np.int64)
        if signals.stamp_ns is not None:
            only_rows(known, rows)
        spoken = self.by_press_ or self.names_ or self.network_ is not None
        if self.recogniser_ is None or not spoken:
            return known
        n = len(signals.good)
        answers = None
        if len(rows):
            presses = press_vectors(windows, self.recogniser_.basis)
            answers = self.recogniser_.answer(presses)
            if self.network_ is not None:
                firm = self.recogniser_.strength(presses) >= WEAKEST
                write_rows(known, rows, n, *self.network_.predict(windows, firm))
        self._name(known, rows, answers, n)
        if 'position' in self.by_press_:
            self._place(known, rows, answers, n)
        if 'yaw' in self.by_press_:
            self._turn_of(known, rows, answers, n)
        return known

    def _name(self, known: Columns, rows: Integers, answers: Answers | None, n: int) -> None:
        """Write labels; where votes are better, only those of enrolled classes."""
        label = np.full(n, -1)
        chance = np.full(n, np.nan)
        if 'label' not in self.by_press_:
            label = known.get('label', label)
            chance = known.get('label_probability', chance)
        if answers is not None:
            mine = np.ones(len(rows), bool)
            if 'label' not in self.by_press_:
                mine = answers.label >= self.first_new_
            label[rows[mine]] = answers.label[mine]
            chance[rows[mine]] = answers.probability[mine]
        known['label'], known['label_probability'] = label, chance

    def _place(self, known: Columns, rows: Integers, answers: Answers | None, n: int) -> None:
        """Write places, of which regressors may know the height."""
        place = known.get('position', np.full((n, 3), np.nan))
        cov = known.get('position_cov', np.full((n, 3, 3), np.nan))
        if 'position' not in known:
            place[rows, 2] = self.config.layer_thickness + self.config.sheet_thickness
            cov[rows, 2, 2] = DEEP**2
        if answers is not None:
            place[rows, :2] = answers.pose[:, :2]
            cov[rows, :2], cov[rows, :, :2] = 0.0, 0.0
            cov[rows[:, None, None], np.arange(2)[:, None], np.arange(2)] = answers.cov[:, :2, :2]
            lost = np.isnan(place[rows, 0])
            place[rows[lost]], cov[rows[lost]] = np.nan, np.nan
        known['position'], known['position_cov'] = place, cov

    def _turn_of(self, known: Columns, rows: Integers, answers: Answers | None, n: int) -> None:
        """Write turns, poses of objects and their symmetry."""
        yaw, deviation = np.full(n, np.nan), np.full(n, np.nan)
        pose, cov = np.full((n, 4, 4), np.nan), np.full((n, 6, 6), np.nan)
        order = np.full(n, -1)
        if answers is not None:
            yaw[rows] = answers.pose[:, 2]
            deviation[rows] = np.where(
                np.isfinite(answers.pose[:, 2]), np.sqrt(answers.cov[:, 2, 2]), np.nan
            )
            order[rows] = answers.order
            if 'position' in self.by_press_:
                pose[rows], cov[rows] = self._object_pose(
                    answers, np.asarray(known['position'][rows], np.float64)
                )
        known['yaw'], known['yaw_std'], known['symmetry'] = yaw, deviation, order
        known['object_pose'], known['object_pose_cov'] = pose, cov

    @staticmethod
    def _object_pose(answers: Answers, place: Array) -> tuple[Array, Array]:
        """Transforms (n, 4, 4) of recognised objects, and their covariance (n, 6, 6)."""
        n = len(place)
        pose, cov = np.zeros((n, 4, 4)), np.zeros((n, 6, 6))
        c, s = np.cos(answers.pose[:, 2]), np.sin(answers.pose[:, 2])
        pose[:, 0, 0], pose[:, 0, 1], pose[:, 1, 0], pose[:, 1, 1] = c, -s, s, c
        pose[:, 2, 2] = pose[:, 3, 3] = 1.0
        pose[:, :3, 3] = place
        cov[:, 2, 2] = DEEP**2
        index = np.array([0, 1, 5])
        cov[:, index[:, None], index] = answers.cov[:, :3, :3]
        nobody = np.isnan(answers.pose[:, 2]) | np.isnan(place).any(axis=1)
        pose[nobody], cov[nobody] = np.nan, np.nan
        return pose, cov

    def enrol(self, signals: Signals, label: str) -> None:
        """Learn a class from the presses in conditioned frames; see `enrolment`.

        Raises
        ------
        ValueError
            If nothing was fitted, the name is taken, or a press is of no use.
        """
        if self.recogniser_ is None:
            msg = f'enrol of {label!r} must follow a fit of a road by presses; none was made'
            raise ValueError(msg)
        if label in self.label_names and label not in self.names_:
            msg = f'label of enrol must be new; {label!r} is known from the fit'
            raise ValueError(msg)
        names = self.names_ if label in self.names_ else (*self.names_, label)
        number = self.first_new_ + names.index(label)
        old = self.recogniser_
        new = enrolled(old, signals, self.config.window, number, label)
        tried = old.with_enrolled(old.enrolled_.joined(new))
        stated = costs(tried, new, number)
        # all of it, or nothing where judging fails
        self.recogniser_, self.names_ = tried, names
        self.press_report_ = {**self.press_report_, f'enrolled {label}': stated}

    def forget(self, label: str) -> None:
        """Undo the enrolment of a class; those enrolled after it move up.

        Raises
        ------
        ValueError
            If it was never enrolled.
        """
        if label not in self.names_ or self.recogniser_ is None:
            msg = f'label of forget must be enrolled, one of {self.names_}; received {label!r}'
            raise ValueError(msg)
        number = self.first_new_ + self.names_.index(label)
        self.recogniser_.enrolled_ = self.recogniser_.enrolled_.without(number)
        self.names_ = tuple(name for name in self.names_ if name != label)
        self.press_report_ = {
            k: v for k, v in self.press_report_.items() if k != f'enrolled {label}'
        }
