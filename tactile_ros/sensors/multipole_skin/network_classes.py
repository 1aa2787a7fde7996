"""Classes by the network of [1]: prototypes of its features, one for each class and place.

A prototype of [1] is the mean of a class at the place of the task. Where presses of many places
are known, each place has prototypes of its own, and the nearest one names a press.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.prototypes import Prototypes
from tactile_ros.sensors.multipole_skin.pronet import CHANNELS, FRAMES, TRAINED, can_run, pronet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.embedding import Embedding
    from tactile_ros.types import Array, Bools, Integers

NETWORKS = tuple(f'pronet_{what}' for what in TRAINED)
FOLDS = 5
FEWEST = 3  # presses
BETTER = 1.5
FARTHEST = 2.0  # over the distance that nineteen of twenty held-out presses keep
ENOUGH = 0.95


class NetworkClasses:
    """What one network makes of known presses.

    Parameters
    ----------
    what : str
        Network: one of `pronet.TRAINED`.

    Attributes
    ----------
    prototypes_ : Prototypes
        Numbered one by one; `label_` (m,) says of which class each is.
    right : float
        Share of held-out presses that are named rightly; 0 where none could be held out.
    chance : float
        Share of the commonest class.
    worst_ : float
        Distance beyond which no class fits.
    """

    prototypes_: Prototypes
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
