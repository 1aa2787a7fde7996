"""What of a static force is creep: shares of fading means of its past.

The film creeps: under a held force its conductance keeps growing. What a static curve takes for
force is then the force and fading means of its past, whose shares are learned where stamps tell
the past. A film may keep what it has crept while the load goes, or lose it with the load,
whichever serves held-out places better; and it creeps where it is pressed, or as a whole.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from tactile_ros.sensors.five_wire_skin.film_memory import FilmMemory
from tactile_ros.types import Array, Integers

TIME_CONSTANTS = (0.3, 1.0, 4.0, 16.0, 64.0)
PENALTY = 1e-4
FOLDS = 5
WORTH = 0.97  # of the static error; creep that takes off less is none
DOUBT = 0.15  # of what is taken off: no two places of a film creep alike
MOST = 0.5  # of a static force that its past can hold


class Creep:
    """Force from a static force and fading means of it.

    Attributes
    ----------
    shares_ : ndarray, shape (m + 1,)
        Of the means, and of the static force itself; 0 where creep is none.
    root_ : ndarray, shape (m + 1, m + 1)
        Square root of the covariance of the shares, from places that were left out.
    edge : float
        Of a touch (m), where the past counts by place; infinite: wherever it was.
    forgets_ : bool
        Whether a mean never counts for more than the force now.
    error_ : float
        Root mean square error (N) at places that were not learned from.
    left_ : float
        That of the rows learned from.
    """

    shares_: Array
    root_: Array
    forgets_: bool
    error_: float
    left_: float

    def __init__(self, edge: float = np.inf) -> None:
        self.edge = edge

    def start(self) -> FilmMemory:
        """Fresh memory of a stream."""
        return FilmMemory(np.array(TIME_CONSTANTS), self.edge)

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
        terms = _terms(static, means, self.forgets_)
        self.left_ = float(np.sqrt(((error - terms @ self.shares_) ** 2).mean()))
        self.root_ = _jackknife(terms, error, groups) if self.is_any else np.zeros_like(terms[:1])
        return self

    @property
    def is_any(self) -> bool:
        """Whether there is creep to take off."""
        return bool(self.shares_.any())

    @property
    def most(self) -> float:
        """Share of a static force that a hold without end adds, and a release leaves."""
        return 0.0 if self.forgets_ else float(self.shares_[:-1].sum())

    def past(self, static: Array, means: Array) -> tuple[Array, Array]:
        """What of a static force (s,) is of its past (N), from its fading means; its variance."""
        terms = _terms(static, means, self.forgets_)
        # no product of matrices: its sums run otherwise for one frame than for many
        past = np.asarray(np.einsum('sm,m->s', terms, self.shares_))
        off = np.einsum('sm,km->sk', terms, self.root_)
        return past, (DOUBT * past) ** 2 + np.einsum('sk,sk->s', off, off)

    def bounded_past(self, static: Array, means: Array) -> Array:
        """The same, never more than half of the static force (N)."""
        return np.clip(self.past(static, means)[0], -MOST * static, MOST * static)


def _terms(static: Array, means: Array, forgets: bool) -> Array:
    """What shares are of (s, m + 1): fading means, and the static force itself."""
    terms = np.empty((len(means), means.shape[1] + 1))
    terms[:, :-1] = np.minimum(means, static[:, None]) if forgets else means
    terms[:, -1] = static
    return terms


def _solve(terms: Array, error: Array) -> Array:
    """Ridge solution, with a penalty that knows the size of the terms; no past takes off."""
    return _shares(terms.T @ terms, terms.T @ error)


def _jackknife(terms: Array, error: Array, groups: Integers) -> Array:
    """Root (n, m) of the covariance of shares, from fits without each group."""
    gram, cross = terms.T @ terms, terms.T @ error
    found = []
    for group in np.unique(groups):
        own = terms[groups == group]
        found.append(_shares(gram - own.T @ own, cross - own.T @ error[groups == group]))
    apart = np.array(found) - np.mean(found, axis=0)
    return np.asarray(np.linalg.qr(apart, mode='r'))


def _shares(gram: Array, cross: Array) -> Array:
    """Shares (m,) from sums of products (m, m) of terms, and of terms and errors (m,)."""
    gram = gram.copy()
    gram[np.diag_indices_from(gram)] += PENALTY * (np.trace(gram) / len(gram) + 1e-12)
    root = np.linalg.cholesky(gram)
    wanted = np.linalg.solve(root, cross)
    both = np.column_stack([root.T, -root.T[:, -1]])
    found = nnls(both, wanted)[0]
    return np.asarray(np.append(found[:-2], found[-2] - found[-1]))
