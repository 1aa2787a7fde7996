"""Which model a scene needs: the cheapest whose error is below a third of the noise.

Models are measured, not believed: each is compared with the exact one over the region of states
that a scene may visit. What counts is the worst error there, in units of the noise. Costs are
counts of operations, so that a choice is the same on every machine; times belong to benches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

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


SHARE = 1 / 3  # of the noise
# Operations at one point, counted in the code, a root or quotient as four.
DIPOLE_COST = 40.0
LINEAR_COST, CUBIC_COST = 60.0, 150.0  # two components over two axes
DISC_COST, BLOCK_COST = 700.0, 1000.0  # closed forms


@dataclass(frozen=True)
class Model:
    """One way to compute the readings of a sensor.

    Attributes
    ----------
    name : str
        As reports name it.
    readings : callable
        States (s, d) -> readings (s, n) (unit of the noise).
    operations : float
        For one state.
    numbers : int
        That a table holds.
    size : tuple of int
        Nodes of a table, or dipoles; what builds the model again.
    """

    name: str
    readings: Callable[[Array], Array]
    operations: float
    numbers: int = 0
    size: tuple[int, ...] = ()


@dataclass(frozen=True)
class Rated:
    """A model beside the exact one.

    Attributes
    ----------
    name, operations, numbers, size : str, float, int and tuple of int
        Of the model.
    rms, worst : float
        Error over the scene (unit of the noise).
    share : float
        Worst error over the noise of its channel.
    """

    name: str
    operations: float
    numbers: int
    size: tuple[int, ...]
    rms: float
    worst: float
    share: float


@dataclass(frozen=True)
class Choice:
    """The model that a scene needs.

    Attributes
    ----------
    name, size : str and tuple of int
        Of the model.
    noise : float
        Of a reading, the least of the channels.
    rated : tuple of Rated
        Every model that was measured, by cost.
    """

    name: str
    size: tuple[int, ...]
    noise: float
    rated: tuple[Rated, ...]

    @property
    def chosen(self) -> Rated:
        """Figures of the model."""
        return next(rated for rated in self.rated if rated.name == self.name)

    @property
    def report(self) -> dict[str, dict[str, float]]:
        """The choice as calibrations and reports name it."""
        found = self.chosen
        return {
            f'model: {self.name}': {
                'worst_error': found.worst,
                'rms_error': found.rms,
                'noise': self.noise,
                'operations': found.operations,
            }
        }


def region(low: Array, high: Array, count: int, seed: int = 0) -> Array:
    """States of a box: its corners and random ones.

    Parameters
    ----------
    low, high : ndarray, shape (d,)
        Of the box.
    count : int
        Random states (n).
    seed : int
        Of the random states.

    Returns
    -------
    ndarray, shape (2^d + n, d)
        Corners first.

    Examples
    --------
    >>> region(np.zeros(2), np.ones(2), 10).shape
    (14, 2)
    """
    corners = np.array(list(np.ndindex(*[2] * len(low))), float)
    inside = np.random.default_rng(seed).uniform(size=(count, len(low)))
    return np.asarray(low + np.concatenate([corners, inside]) * (high - low))


def choose(
    models: Sequence[Model],
    exact: Model,
    states: Array,
    noise: float | Array,
    share: float = SHARE,
    *,
    every: bool = False,
) -> Choice:
    """Cheapest model whose worst error over a scene is below a share of the noise.

    Parameters
    ----------
    models : sequence of Model
        To choose from, in any order.
    exact : Model
        Serves where none of them does, or none that is cheaper.
    states : ndarray, shape (s, d)
        Of the scene; see `region`.
    noise : float or ndarray, shape (n,)
        Of a reading.
    share : float
        Of the noise that an error may reach.
    every : bool
        Measure all models, not only those up to the one that is chosen.

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        If the noise is not above 0.

    Examples
    --------
    >>> rough = Model('0', lambda x: 0 * x, 1)
    >>> line = Model('x', lambda x: x, 2)
    >>> sine = Model('sin x', np.sin, 20)
    >>> states = region(np.array([-0.1]), np.array([0.1]), 20)
    >>> [choose([rough, line], sine, states, noise).name for noise in (1.0, 1e-2, 1e-5)]
    ['0', 'x', 'sin x']
    """
    sigma = np.asarray(noise, float)
    if not (sigma > 0).all():
        msg = f'noise of a scene must be above 0; received {noise}'
        raise ValueError(msg)
    rated: list[Rated] = []
    found, truth = (exact.name, exact.size), exact.readings(states)
    for model in sorted(models, key=lambda m: (m.operations, m.numbers)):
        cheaper = model.operations < exact.operations
        if not (every or (cheaper and found[0] == exact.name)):
            break
        rated.append(rate(model, truth, states, sigma))
        if cheaper and rated[-1].share <= share and found[0] == exact.name:
            found = model.name, model.size
    if every or found[0] == exact.name:
        rated.append(Rated(exact.name, exact.operations, exact.numbers, exact.size, 0.0, 0.0, 0.0))
    return Choice(*found, float(sigma.min()), tuple(rated))


def rate(model: Model, truth: Array, states: Array, noise: Array) -> Rated:
    """Errors of a model against true readings (s, n) of states (s, d)."""
    error = np.abs(model.readings(states) - truth)
    rms, worst = float(np.sqrt((error**2).mean())), float(error.max())
    share = float((error / noise).max())
    return Rated(model.name, model.operations, model.numbers, model.size, rms, worst, share)
