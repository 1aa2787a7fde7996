"""What a term of a model costs and buys: precision against bias.

A term (an outside field, a temperature) that readings must tell beside what is wanted takes
precision from it; left out, it becomes a bias. The Cramer-Rao bound and the bias of least squares
say which is larger, before anything is built (Kay, Fundamentals of Statistical Signal Processing,
1993, ch. 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array

BOUNDED = 1e3  # spreads: what an unknown that is not told by readings is held to

SOLVABLE = 1e-12


@dataclass(frozen=True)
class Term:
    """Something outside of what is wanted that changes readings.

    Attributes
    ----------
    name : str
        As reports name it.
    columns : ndarray, shape (s, n, q)
        Change of the readings with each of its q unknowns.
    spread : float
        Standard deviation of the unknowns in the scene.
    """

    name: str
    columns: Array
    spread: float


@dataclass(frozen=True)
class Worth:
    """A term beside a model that has none.

    Attributes
    ----------
    name : str
        Of the term.
    unknowns : int
        That it adds.
    reads : float
        Change of a reading by it (rms; unit of the noise).
    without, within : float
        Rms error of what is wanted when it is left out, and when it is estimated.
    alone : float
        Rms error of what is wanted in a scene that has no such thing.
    """

    name: str
    unknowns: int
    reads: float
    without: float
    within: float
    alone: float

    @property
    def report(self) -> dict[str, dict[str, float]]:
        """As calibrations and reports name it."""
        figures = {'costs': self.cost, 'buys': self.buys, 'unknowns': float(self.unknowns)}
        return {f'term: {self.name}': figures}

    @property
    def pays(self) -> bool:
        """Whether the scene is estimated better with the term."""
        return self.within < self.without

    @property
    def cost(self) -> float:
        """Error in a scene without such a thing, over that of a model without the term."""
        return self.within / self.alone

    @property
    def buys(self) -> float:
        """Error of a model without the term, over that with it, in a scene that has it."""
        return self.without / self.within


def worth(
    slopes: Array, noise: float, terms: Sequence[Term], wanted: int | None = None
) -> tuple[Worth, ...]:
    """Weigh each term by itself.

    Parameters
    ----------
    slopes : ndarray, shape (s, n, p)
        Change of n readings with what is unknown anyway, in s states of a scene.
    noise : float
        Of a reading.
    terms : sequence of Term
        To be weighed.
    wanted : int or None
        The first so many of the p unknowns count, in one unit; None: all.

    Returns
    -------
    tuple of Worth
        In the order of the terms.

    Examples
    --------
    >>> two = np.array([[[1.0], [0.0]]])
    >>> both = Term('offset of both', np.array([[[1.0], [1.0]]]), 3.0)
    >>> (found,) = worth(two, 1.0, [both])
    >>> round(found.without, 3), round(found.within, 3), round(found.alone, 3)
    (3.162, 1.414, 1.0)
    """
    count = slopes.shape[2] if wanted is None else wanted
    own = np.linalg.pinv(slopes)[:, :count]
    alone = noise**2 * (own**2).sum(axis=(1, 2))
    found = []
    for term in terms:
        bias = term.spread**2 * ((own @ term.columns) ** 2).sum(axis=(1, 2))
        within = noise**2 * _bound(slopes, term, noise, count)
        reads = term.spread * np.sqrt((term.columns**2).sum(axis=2).mean())
        found.append(
            Worth(
                term.name,
                term.columns.shape[2],
                float(reads),
                float(np.sqrt((alone + bias).mean())),
                float(np.sqrt(within.mean())),
                float(np.sqrt(alone.mean())),
            )
        )
    return tuple(found)


def _bound(slopes: Array, term: Term, noise: float, wanted: int) -> Array:
    """Variance (s,) of what is wanted over that of the noise, when a term is unknown."""
    both = np.concatenate([slopes, term.columns], axis=2)
    normal = np.swapaxes(both, 1, 2) @ both
    held = np.arange(slopes.shape[2], both.shape[2])
    normal[:, held, held] += (noise / (BOUNDED * term.spread)) ** 2
    # in units of their own size columns stay solvable; one that no reading sees counts for nothing
    own = np.diagonal(normal, axis1=1, axis2=2)
    size = np.where(own > 0, 1 / np.sqrt(np.where(own > 0, own, 1.0)), 0.0)
    normal = normal * size[:, :, None] * size[:, None] + SOLVABLE * np.eye(both.shape[2])
    variance = size**2 * np.diagonal(np.linalg.inv(normal), axis1=1, axis2=2)
    return np.asarray(variance[:, :wanted].sum(axis=1))
