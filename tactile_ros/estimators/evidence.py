# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Influence of references on a calibration: held-out errors, and the noise that is most probable.

After `model_inversion.calibrate` the residual of a reference over what it drew to itself is what
it would have been without it (one step of Newton's method, exact where models are linear). The
evidence gives the noise of references and the widths of priors by the same shares.

Sources: R. Cook and S. Weisberg, Residuals and Influence in Regression (1982), sec. 2.2;
D. MacKay, Bayesian interpolation (1992), sec. 4.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.model_inversion import HUBER, Equations

if TYPE_CHECKING:
    from tactile_ros.estimators.model_inversion import Calibration, Frames, ModelPrior
    from tactile_ros.types import Array, Integers

UNKNOWN = 1e12  # variance of a missing reference over that of a given one
HYPER = 0.05  # log evidence by which a width of a prior is as it was
FACTORS = np.geomspace(0.05, 20.0, 121)  # of widths, at once


class Influence:
    """Residuals of references after a calibration, and how far each drew the answer to itself."""

    def __init__(self, model: ModelPrior, fit: Calibration, frames: Frames, f: Array) -> None:
        references = np.array(f, np.float64, order='C')
        equations = Equations(model, frames, references, fit.states, fit.parameters)
        (count, wide), (n, k) = references.shape, (fit.states.shape[1], len(fit.parameters))
        out, by_state = np.empty((count, wide)), np.zeros((count, wide, n))
        self.slopes = np.zeros((count, wide, k))
        for s in range(count):
            model.answers(
                fit.states[s], fit.parameters, model.data, out[s], by_state[s], self.slopes[s]
            )
        # references less answers, and their variance by the robust loss (s, l)
        self.error = np.nan_to_num(references - out)
        usual = np.broadcast_to(model.answer_noise**2, out.shape)
        robust = usual * np.maximum(np.abs(self.error) / model.answer_noise / HUBER, 1.0)
        self.known = np.isfinite(references)
        self.variance = np.where(self.known, robust, UNKNOWN * usual)
        size = 1 / np.sqrt(np.diagonal(equations.a, axis1=1, axis2=2))
        scale = size[:, :, None] * size[:, None]
        inverse = np.linalg.inv(equations.a * scale) * scale
        shift = -inverse @ equations.b
        by_state = by_state[:, :, frames.free]
        # (s, l, l) covariance of answers that the frame's own state leaves
        self.own = by_state @ inverse @ by_state.transpose(0, 2, 1)
        self.slopes += by_state @ shift
        self.root = fit.root
        spread = shift @ fit.root
        self.state_variance = np.zeros((count, n))
        own = np.einsum('sii->si', inverse) + (spread**2).sum(axis=2)
        self.state_variance[:, frames.free] = own

    @property
    def drawn(self) -> Array:
        """Share (s, l) by which each reference determined the answer itself."""
        spread = self.slopes @ self.root
        found = np.einsum('sii->si', self.own) + (spread**2).sum(axis=2)
        return np.asarray(found / self.variance)

    def held_out(self, groups: Integers) -> tuple[Array, Array]:
        """Errors (s, l) of answers less references, and their covariance (s, l, l).

        References of a row's group were taken from the calibration, by a step of Newton's; the
        covariance is that of the error, with the noise of the reference. NaN where there is none.
        """
        count, wide = self.error.shape
        error, covariance = np.empty((count, wide)), np.empty((count, wide, wide))
        for name in np.unique(groups):
            rows = np.flatnonzero(groups == name)
            inverse = self._left_out(rows)
            variance = self.variance[rows].ravel()
            error[rows] = -(variance * (inverse @ self.error[rows].ravel())).reshape(-1, wide)
            sigma = np.sqrt(variance)
            unit = sigma[:, None] * inverse * sigma
            for i, row in enumerate(rows):
                part = slice(i * wide, (i + 1) * wide)
                # at least the noise of the reference: large groups leave little to a Newton step
                size, ways = np.linalg.eigh(unit[part, part])
                root = sigma[part, None] * ways * np.sqrt(np.maximum(size, 1.0))
                covariance[row] = root @ root.T
        error[~self.known] = np.nan
        return error, covariance

    def _left_out(self, rows: Integers) -> Array:
        """Inverse covariance of residuals of the references of these rows, if left out."""
        wide, k = self.error.shape[1], len(self.root)
        block = self.variance[rows][:, :, None] * np.eye(wide) - self.own[rows]
        spread = self.slopes[rows] @ self.root
        each = [slice(i * wide, (i + 1) * wide) for i in range(len(rows))]
        if len(rows) * wide <= k:
            flat = spread.reshape(-1, k)
            whole = -flat @ flat.T
            for part, own in zip(each, block, strict=True):
                whole[part, part] += own
            return np.asarray(np.linalg.inv(whole))
        block = np.asarray(np.linalg.inv(block), np.float64)
        seen = block @ spread
        inner = np.eye(k) - np.einsum('sik,sil->kl', spread, seen, optimize=True)
        flat = seen.reshape(-1, k)
        whole = flat @ np.linalg.solve(inner, flat.T)
        for part, own in zip(each, block, strict=True):
            whole[part, part] += own
        return np.asarray(whole)


def learn_noise(
    model: ModelPrior, fit: Calibration, influence: Influence, states: Integers, groups: Integers
) -> ModelPrior:
    """Take the noise of references and widths of priors that make a recording most probable.

    Widths of `states`, and of parameters of one number in `groups` (k,) together (-1: as it is),
    are those of largest evidence beside everything else; noise takes a step of MacKay's fixed
    point, squares over what is left of their number.
    """
    trust = model.answer_noise**2 / influence.variance
    left = (trust * (1 - influence.drawn)).sum(axis=0)
    noise = np.sqrt((trust * influence.error**2).sum(axis=0) / np.maximum(left, 1.0))
    sigma, width = model.state_sigma.copy(), model.parameter_sigma.copy()
    rows = influence.known.any(axis=1)
    for state in states:
        off = (fit.states - model.state)[rows, state] / sigma[state]
        variance = influence.state_variance[rows, state] / sigma[state] ** 2
        sigma[state] *= _widening(off, variance)
    for name in range(int(groups.max()) + 1):
        own = np.flatnonzero((groups == name) & (width > 0))
        if len(own):
            off = (fit.parameters - model.parameters)[own] / width[own]
            covariance = fit.covariance[np.ix_(own, own)] / np.outer(width[own], width[own])
            size, ways = np.linalg.eigh(covariance)
            width[own] *= _widening(ways.T @ off, size)
    return replace(model, answer_noise=noise, state_sigma=sigma, parameter_sigma=width)


def _widening(off: Array, variance: Array) -> float:
    """Factor of a prior's sigma with most evidence; independent values, in units of the prior."""
    size = np.clip(variance, 1e-12, 1.0)[:, None]
    info = 1 / size - 1  # information of what is beside this prior
    square = (off[:, None] / size) ** 2
    wide = FACTORS**2
    evidence = 0.5 * (square * wide / (1 + info * wide) - np.log1p(info * wide)).sum(axis=0)
    return float(FACTORS[np.argmax(evidence - HYPER * np.log(FACTORS) ** 2)])
