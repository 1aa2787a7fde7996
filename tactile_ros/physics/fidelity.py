# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fidelity that a scene needs: the cheapest model, and the terms that pay.

Each model is compared with the exact one over the states that a scene may visit, and serves if
its worst error there is below a third of the noise. Costs are counts of operations, so that a
choice is the same on every machine.

A term (a stray field, a temperature) that is estimated from the same readings takes precision from
what is wanted; left out, it becomes a bias. The Cramer-Rao bound and the bias of least squares say
which is larger (Kay, Fundamentals of Statistical Signal Processing, 1993, ch. 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array

SHARE = 1 / 3  # of the noise
# Operations at one point, counted in the code, a root or quotient as four.
DIPOLE_COST = 40.0
LINEAR_COST, CUBIC_COST = 60.0, 150.0  # two components over two axes
DISC_COST, BLOCK_COST = 700.0, 1000.0  # closed forms
BOUNDED = 1e3  # sigmas of a term within which an unobservable unknown is held
SOLVABLE = 1e-12


@dataclass(frozen=True)
class Model:
    """One way to compute readings (s, n) of states (s, d), in the unit of the noise."""

    name: str  # in reports
    readings: Callable[[Array], Array]
    operations: float  # for one state
    numbers: int = 0  # that a table holds
    size: tuple[int, ...] = ()  # nodes of a table, or dipoles; what builds the model again


@dataclass(frozen=True)
class Rated:
    """Errors of a model beside the exact one over a scene (unit of the noise)."""

    name: str
    operations: float
    numbers: int
    size: tuple[int, ...]
    rms: float
    worst: float
    share: float  # worst error over the noise of its channel


@dataclass(frozen=True)
class Choice:
    """Model that a scene needs, least noise of a channel, and the models measured, by cost."""

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
        """Choice as calibrations and reports name it."""
        chosen = self.chosen
        figures = {'worst_error': chosen.worst, 'rms_error': chosen.rms, 'noise': self.noise}
        return {f'model: {self.name}': {**figures, 'operations': chosen.operations}}


def region(low: Array, high: Array, count: int, seed: int = 0) -> Array:
    """States (2^d + n, d) of a box `low`, `high` (d,): its corners, then n random ones.

    Examples
    --------
    >>> region(np.zeros(2), np.ones(2), 10).shape
    (14, 2)
    """
    corners = np.array(list(np.ndindex(*[2] * len(low))), float)
    inside = np.random.default_rng(seed).uniform(size=(count, len(low)))
    return np.asarray(low + np.concatenate([corners, inside]) * (high - low))


def choose(models: Sequence[Model], exact: Model, states: Array, noise: float | Array) -> Choice:
    """Cheapest model whose worst error over states (s, d) is below a third of the noise (n,).

    The exact one serves where no cheaper one does. Raises ValueError if a noise is not above 0.

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
    truth, rated = exact.readings(states), []
    cheaper = [model for model in models if model.operations < exact.operations]
    for chosen in [*sorted(cheaper, key=lambda m: (m.operations, m.numbers)), exact]:
        rated.append(rate(chosen, truth, states, sigma))
        if rated[-1].share <= SHARE:
            break
    return Choice(chosen.name, chosen.size, float(sigma.min()), tuple(rated))


def rate(model: Model, truth: Array, states: Array, noise: Array) -> Rated:
    """Errors of a model against true readings (s, n) of states (s, d)."""
    error = np.abs(model.readings(states) - truth)
    rms, worst = float(np.sqrt((error**2).mean())), float(error.max())
    share = float((error / noise).max())
    return Rated(model.name, model.operations, model.numbers, model.size, rms, worst, share)


@dataclass(frozen=True)
class Term:
    """Disturbance of readings by q unknowns."""

    name: str  # in reports
    columns: Array  # (s, n, q) change of the readings with each unknown
    spread: float  # standard deviation of the unknowns in the scene


@dataclass(frozen=True)
class TermGain:
    """Gain of estimating a term: rms errors of what is wanted."""

    name: str
    unknowns: int  # that it adds
    without: float  # error where it is left out
    within: float  # error where it is estimated
    alone: float  # error in a scene that has no such disturbance

    @property
    def report(self) -> dict[str, dict[str, float]]:
        """Gain as calibrations and reports name it."""
        figures = {'costs': self.cost, 'buys': self.buys, 'unknowns': float(self.unknowns)}
        return {f'term: {self.name}': figures}

    @property
    def cost(self) -> float:
        """Error in a scene without the disturbance, over that of a model without the term."""
        return self.within / self.alone

    @property
    def buys(self) -> float:
        """Error of a model without the term over that with it, in a scene that has it."""
        return self.without / self.within


def term_gains(
    slopes: Array, noise: float, terms: Sequence[Term], wanted: int | None = None
) -> tuple[TermGain, ...]:
    """Gain of each term by itself.

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

    Examples
    --------
    >>> two = np.array([[[1.0], [0.0]]])
    >>> both = Term('offset of both', np.array([[[1.0], [1.0]]]), 3.0)
    >>> (found,) = term_gains(two, 1.0, [both])
    >>> round(found.without, 3), round(found.within, 3), round(found.alone, 3)
    (3.162, 1.414, 1.0)
    """
    count = slopes.shape[2] if wanted is None else wanted
    own = np.linalg.pinv(slopes)[:, :count]
    alone = noise**2 * (own**2).sum(axis=(1, 2))
    weighed = []
    for term in terms:
        bias = term.spread**2 * ((own @ term.columns) ** 2).sum(axis=(1, 2))
        squares = alone + bias, noise**2 * _bound(slopes, term, noise, count), alone
        errors = [float(np.sqrt(square.mean())) for square in squares]
        weighed.append(TermGain(term.name, term.columns.shape[2], *errors))
    return tuple(weighed)


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
