# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes by the mean features of their few presses: prototypes, [1] eq. (2) and (3).

Eq. (3) is printed with +d, which picks the farthest class; -d is meant. As distances are sums of
hundreds of squares, exp underflows: probabilities stay logarithms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_softmax

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers


class Prototypes:
    """Nearest class means, [1] Eqs. (2) and (3).

    Examples
    --------
    >>> found = Prototypes().fit(np.array([[0.0], [1.0], [9.0]]), np.array([3, 3, 7]))
    >>> found.predict(np.array([[2.0], [8.0]])).tolist()
    [3, 7]
    """

    classes_: Integers  # (k,) in rising order
    means_: Array  # (k, p) eq. (2), by the shots of each class.

    def fit(self, features: Array, labels: Integers) -> Prototypes:
        """Learn from features (n, p) of presses with labels (n,)."""
        self.classes_ = np.unique(labels)
        self.means_ = np.stack([features[labels == label].mean(axis=0) for label in self.classes_])
        return self

    def log_probability(self, features: Array) -> Array:
        """Logarithm of the probability of every class (n, k), eq. (3) with -d."""
        squared = np.square(features[:, None] - self.means_).sum(axis=2)
        return np.asarray(log_softmax(-squared, axis=1))

    def predict(self, features: Array) -> Integers:
        """Class (n,) of features (n, p); of equally near ones the lowest."""
        return np.asarray(self.classes_[self.log_probability(features).argmax(axis=1)])
