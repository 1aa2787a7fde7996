"""What of a static force is creep: shares of fading means of its past.

The film creeps: under a held force its conductance keeps growing. What a static curve takes for
force is then the force and fading means of its past, whose shares are learned where stamps tell
the past. A film may keep what it has crept while the load goes, or lose it with the load: which
serves held-out places better is taken.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.types import Array, Bools, Integers

TIME_CONSTANTS = (0.3, 1.0, 4.0, 16.0, 64.0)
PENALTY = 1e-4
FOLDS = 5
WORTH = 0.97  # of the static error; creep that takes off less is none
DOUBT = 0.15  # of what is taken off: a hold may last longer than any that was learned from
MOST = 0.5  # of a static force that its past can hold


class Creep:
    """Force from a static force and fading means of it.

    Attributes
    ----------
    shares_ : ndarray, shape (m + 1,)
        Of the means, and of the static force itself; 0 where creep is none.
    forgets_ : bool
        Whether a mean never counts for more than the force now.
    error_ : float
        Root mean square error (N) at places that were not learned from.
    """

    shares_: Array
    forgets_: bool
    error_: float

    def fit(self, static: Array, means: Array, told: Array, groups: Integers) -> Creep:
        """Learn shares.

        Parameters
        ----------
        static : ndarray, shape (s,)
            Forces of a static curve (N).
        means : ndarray, shape (s, m)
            Their fading means (N).
        told : ndarray, shape (s,)
            True forces (N).
        groups : ndarray of int, shape (s,)
            What a split keeps together.

        Returns
        -------
        Creep
            Itself.
        """
        error = static - told
        fold = np.unique(groups, return_inverse=True)[1].reshape(-1) % FOLDS
        self.error_, self.forgets_ = WORTH * float(np.sqrt((error**2).mean())), False
        self.shares_ = np.zeros(means.shape[1] + 1)
        for forgets in (False, True):
            terms = _terms(static, means, forgets)
            left = np.empty(len(error))
            for part in range(FOLDS):
                held = fold == part
                seen = ~held if (~held).any() else held
                left[held] = error[held] - terms[held] @ _solve(terms[seen], error[seen])
            size = float(np.sqrt((left**2).mean()))
            if size < self.error_:
                self.error_, self.forgets_ = size, forgets
                self.shares_ = _solve(terms, error)
        return self

    @property
    def is_any(self) -> bool:
        """Whether there is creep to take off."""
        return bool(self.shares_.any())

    @property
    def most(self) -> float:
        """Share of a static force that a hold without end adds, and a release leaves."""
        return 0.0 if self.forgets_ else float(self.shares_[:-1].sum())

    def past(self, static: Array, means: Array) -> Array:
        """What of a static force (s,) is of its past (N), from its fading means (s, m)."""
        terms = _terms(static, means, self.forgets_)
        # no product of matrices: its sums run otherwise for one frame than for many
        return np.asarray(np.einsum('sm,m->s', terms, self.shares_))

    def bounded_past(self, static: Array, means: Array) -> Array:
        """The same, never more than half of the static force (N)."""
        return np.clip(self.past(static, means), -MOST * static, MOST * static)


def remember(static: Array, stamp_ns: Integers, restart: Bools, memory: History) -> Array:
    """Fading means (s, m) of a static force (s,), NaN where unusable; the memory moves on."""
    if len(static) == 1:
        if restart[0]:
            memory.reset()
        return memory.step(static, int(stamp_ns[0])).T.copy()
    return np.asarray(memory(static[:, None], stamp_ns, restart)[:, :, 0])


def _terms(static: Array, means: Array, forgets: bool) -> Array:
    """What shares are of (s, m + 1): fading means, and the static force itself."""
    terms = np.empty((len(means), means.shape[1] + 1))
    terms[:, :-1] = np.minimum(means, static[:, None]) if forgets else means
    terms[:, -1] = static
    return terms


def _solve(terms: Array, error: Array) -> Array:
    """Ridge solution, with a penalty that knows the size of the terms."""
    gram = terms.T @ terms
    gram[np.diag_indices_from(gram)] += PENALTY * (np.trace(gram) / len(gram) + 1e-12)
    return np.asarray(np.linalg.solve(gram, terms.T @ error))
