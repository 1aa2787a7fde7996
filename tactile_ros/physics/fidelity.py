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
