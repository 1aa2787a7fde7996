# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Objects of which no outline is stated: pressure fields learned from frames with known poses.

The forces of a frame are linear in the fields: y_t = sum_k a_k A_t(pose) T_k. Fields T_k, which
are smooth, and the amounts a_k of every frame are solved in turn; the first is the mean contact,
the others what depth changes. A field is free on a grid, or that of an angle tube: a profile over
the distance to the nearer of two axes, whose directions are fitted too. Held-out frames choose.
The pose of another frame follows by `estimators/object_pose.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import solve
from scipy.optimize import least_squares

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.object_pose import Found, ObjectPose, TaxelPoints
from tactile_ros.physics.coverage import LearnedFields
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
from tactile_ros.types import Array, Bools, Columns

FEWEST = 30  # frames
SIDE, TUBE_SIDE = 31, 91  # nodes of the grid's side, of free fields and of a tube's
POINTS = 2304  # of all taxels together, about
MODES, ROUNDS = 3, 3
TUBE_ROUNDS = 10  # few unknowns: rounds cost little
SMOOTH = (1e-3, 1e-2)  # strengths of the prior of free fields that are tried
KNOTS = (13, 21, 31)  # of a profile up to the end of the grid
STIFF, SLIGHT = 1e-5, 1e-9  # strengths of its priors: no curvature, nothing
DIRECTIONS = 24  # of an axis that are tried
HELD_OUT = 4  # one frame of so many is held out


@dataclass
class Frames:
    """Frames with known poses: forces, weights (s, t), and the parts of nodes in them."""

    force: Array
    weight: Array
    design: sparse.csr_matrix  # (s * t, k)

    def some(self, rows: Bools) -> Frames:
        """Frames of some rows (s,)."""
        entries = np.repeat(rows, self.force.shape[1])
        return Frames(self.force[rows], self.weight[rows], self.design[entries])

    def over(self, basis: Array) -> Frames:
        """The same frames with amounts of a basis (n, k) in place of nodes."""
        return Frames(self.force, self.weight, sparse.csr_matrix(self.design @ basis))

    def amounts(self, fields: Array) -> tuple[Array, Array]:
        """Amounts (s, m) of fields (m, k) by least squares, and what they leave (s, t)."""
        shape = (*self.force.shape, len(fields))
        terms = np.asarray(self.design @ fields.T).reshape(shape) * self.weight[..., None]
        wanted = self.weight * self.force
        gram = np.einsum('stm,stn->smn', terms, terms)
        pull = np.einsum('stm,st->sm', terms, wanted)
        first = np.maximum(pull[:, 0] / np.maximum(gram[:, 0, 0], 1e-300), 1e-12)
        gram[:, 1:, 1:] += np.eye(len(fields) - 1) / (4.0 * first[:, None, None]) ** 2
        found = np.linalg.solve(gram, pull[..., None])[..., 0]
        return found, wanted - np.einsum('stm,sm->st', terms, found)

    def fields(self, amounts: Array, rough: Array) -> Array:
        """Fields (m, k) of given amounts (s, m), with a prior on their roughness (k, k)."""
        modes, nodes = amounts.shape[1], self.design.shape[1]
        weight, taxels = self.weight.reshape(-1), self.weight.shape[1]
        wide = sparse.hstack(
            [sparse.diags(weight * np.repeat(part, taxels)) @ self.design for part in amounts.T]
        ).tocsr()
        normal = (wide.T @ wide).toarray()
        unit = np.trace(normal[:nodes, :nodes]) / nodes
        normal += np.kron(np.eye(modes), unit * rough)
        pull = wide.T @ (weight * self.force.reshape(-1))
        return np.asarray(solve(normal, pull, assume_a='pos').reshape(modes, nodes))

    def solve(self, rough: Array, rounds: int) -> tuple[Array, Array]:
        """Fields (m, k) and amounts (s, m) in turn; modes have mean 0 and unit covariance."""
        load = self.force.sum(axis=1)
        depth = load / load.mean() - 1.0
        depth /= max(float(depth.std()), 1e-9)
        amounts = load[:, None] * np.stack([depth**k for k in range(MODES)], axis=1)
        for _ in range(rounds):
            fields = self.fields(amounts, rough)
            amounts = self.amounts(fields)[0]
            part = amounts[:, 1:] / amounts[:, :1]
            fields[0] += part.mean(axis=0) @ fields[1:]
            part -= part.mean(axis=0)
            factor = np.linalg.cholesky(part.T @ part / len(part) + 1e-12 * np.eye(MODES - 1))
            fields[1:] = factor.T @ fields[1:]
            amounts[:, 1:] = amounts[:, :1] * np.linalg.solve(factor, part.T).T
        return fields, amounts


class LearnedObject:
    """One object on one array."""

    fields_: LearnedFields  # in the object's frame
    covariance_: CovarianceModel  # of x, y (m) and yaw (rad), from held-out frames
    misfit_: float  # scale of the misfit of held-out frames at their poses, at least 1
    report_: dict[str, float]  # errors of held-out frames

    def __init__(self, config: TaxelArrayConfig) -> None:
        self.config = config

    def fit(self, force: Array, sigma: Array, poses: Array, usable: Bools) -> LearnedObject:
        """Learn from forces (s, t) with their sigmas (N) at poses (s, 3): x, y (m), yaw (rad)."""
        config = self.config
        count = max(POINTS // len(config.positions), 4)
        points = TaxelPoints(config.positions, config.areas, config.taxel_outlines, count)
        away = points.points[None] - poses[:, None, :2]
        self.half = float(np.quantile(np.abs(away).max(axis=(1, 2)), 0.9)) * 1.1
        load, weight = np.nan_to_num(force), np.isfinite(force) * usable / sigma
        held = np.arange(len(poses)) % HELD_OUT == HELD_OUT - 1
        tried, errors = [], []
        for frames, rough, basis, rounds in self._structures(points, poses, load, weight, ~held):
            fields = frames.some(~held).solve(rough, rounds)[0]
            tried.append((frames, rough, basis, rounds, fields))
            errors.append(float(np.mean(np.square(frames.some(held).amounts(fields)[1]))))
        frames, rough, basis, rounds, fields = tried[int(np.argmin(errors))]
        taxels = max(int(np.count_nonzero(usable)), MODES + 4)
        self.misfit_ = max(float(np.sqrt(min(errors) * taxels / (taxels - MODES))), 1.0)
        self._expand(fields, basis)
        found = [self._one(force[i], sigma[i], usable) for i in np.flatnonzero(held)]
        cov = np.array([one.cov for one in found])
        miss = np.array([one.pose for one in found]) - poses[held]
        miss[:, 2] = (miss[:, 2] + np.pi) % (2 * np.pi) - np.pi
        self.covariance_ = CovarianceModel().fit(miss, cov, np.arange(len(miss)), 0 * miss[:, :1])
        self.report_ = {
            'held_out_rmse_yaw': float(np.sqrt(np.nanmean(np.square(miss[:, 2])))),
            'held_out_rmse_place': float(np.sqrt(np.nanmean(np.square(miss[:, :2]).sum(axis=1)))),
            'located': float(np.isfinite(miss[:, 2]).mean()),
        }
        self._expand(frames.solve(rough, rounds)[0], basis)
        return self

    def _structures(
        self, points: TaxelPoints, poses: Array, force: Array, weight: Array, rows: Bools
    ) -> Iterator[tuple[Frames, Array, Array, int]]:
        """Frames, priors (k, k), bases (n, k) and rounds of every structure of the fields."""
        frames, finer = (
            Frames(force, weight, self._sampled(points, poses, side)) for side in (SIDE, TUBE_SIDE)
        )
        difference = np.diff(np.eye(SIDE), axis=0)
        along, still = difference.T @ difference, np.eye(SIDE)
        smooth = np.asarray(np.kron(still, along) + np.kron(along, still), np.float64)
        smooth += 0.01 * np.eye(SIDE**2)
        for strength in SMOOTH:
            yield frames, strength * smooth, np.eye(SIDE**2), ROUNDS
        fields = frames.some(rows).solve(SMOOTH[0] * smooth, 1)[0]
        axes = self._axes(finer.some(rows), fields[0])
        for knots in KNOTS:
            basis = profile_basis(axes, self.half, TUBE_SIDE, knots)
            curved = np.diff(np.eye(basis.shape[1]), 2, axis=0)
            stiff = STIFF * (curved.T @ curved) + SLIGHT * np.eye(basis.shape[1])
            yield finer.over(basis), stiff, basis, TUBE_ROUNDS

    def _sampled(self, points: TaxelPoints, poses: Array, side: int) -> sparse.csr_matrix:
        """Part of each node in the force of each taxel at every pose, shape (s * t, n)."""
        taxels = len(points.areas)
        away = points.points - poses[:, None, :2]
        cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        u = (cos * away[..., 0] + sin * away[..., 1] + self.half) / (2 * self.half) * (side - 1)
        v = (cos * away[..., 1] - sin * away[..., 0] + self.half) / (2 * self.half) * (side - 1)
        inside = (u >= 0) & (v >= 0) & (u < side - 1) & (v < side - 1)
        counts = np.diff(points.first)
        taxel = np.repeat(np.arange(taxels), counts)
        row = (taxels * np.arange(len(poses))[:, None] + taxel)[inside]
        part = np.broadcast_to((points.areas / counts)[taxel], inside.shape)[inside]
        i, j = u[inside].astype(int), v[inside].astype(int)
        a, b = u[inside] - i, v[inside] - j
        node = j * side + i
        entries = [part * (1 - a) * (1 - b), part * a * (1 - b), part * (1 - a) * b, part * a * b]
        nodes = np.concatenate([node, node + 1, node + side, node + side + 1])
        return sparse.csr_matrix(
            (np.concatenate(entries), (np.tile(row, 4), nodes)),
            shape=(taxels * len(poses), side**2),
        )

    def _axes(self, frames: Frames, field: Array) -> Array:
        """Directions of two axes (rad) and the place of their bend (m), shape (4,)."""
        turns = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        pairs = [np.array([a, b, 0.0, 0.0]) for a in turns for b in turns if a < b]
        left = []
        for pair in pairs:
            basis = profile_basis(pair, self.half, SIDE, KNOTS[0])
            left.append(np.square(field - basis @ np.linalg.lstsq(basis, field)[0]).sum())
        axes, unit = pairs[int(np.argmin(left))], np.array([1.0, 1.0, self.half, self.half])

        def along(axes: Array) -> Frames:
            return frames.over(profile_basis(axes, self.half, TUBE_SIDE, KNOTS[-1]))

        rough = SLIGHT * np.eye(along(axes).design.shape[1])
        for _ in range(2):
            amounts = along(axes).solve(rough, TUBE_ROUNDS)[1]

            def misfit(axes: Array, amounts: Array = amounts) -> Array:
                some = along(axes)
                return some.amounts(some.fields(amounts, rough))[1].reshape(-1)

            axes = least_squares(misfit, axes, x_scale=unit, xtol=1e-4, max_nfev=6).x
        return np.asarray(axes)

    def _expand(self, fields: Array, basis: Array) -> None:
        """Set the fields of amounts (m, k) of a basis (n, k)."""
        pictures = (fields @ basis.T).reshape(MODES, round(np.sqrt(len(basis))), -1)
        pictures = pictures / np.abs(pictures[0]).max()
        self.fields_ = LearnedFields(pictures, self.half, np.ones(MODES))
        vars(self).pop('objects', None)

    @cached_property
    def objects(self) -> ObjectPose:
        """The object on its array."""
        config = self.config
        return ObjectPose(config.positions, config.areas, config.taxel_outlines, (self.fields_,))

    def _one(self, force: Array, sigma: Array, usable: Bools) -> Found:
        """The object under one frame."""
        y, able = np.nan_to_num(force), usable & np.isfinite(force)
        sigma = self.misfit_ * sigma
        spread = sigma / np.maximum(y, 1e-9)
        return self.objects.locate(y, np.full(len(y), sigma.min()), able, spread)

    def add(
        self, columns: Columns, force: Array, sigma: Array, asked: Bools, usable: Bools
    ) -> None:
        """Add yaw and place of asked rows (s,) to `columns`; see `fit`."""
        columns['yaw'], columns['yaw_std'] = np.full((2, len(force)), np.nan)
        columns['position'] = np.full((len(force), 3), np.nan)
        columns['position_cov'] = np.full((len(force), 3, 3), np.nan)
        for i in np.flatnonzero(asked):
            found = self._one(force[i], sigma[i], usable)
            if found.label < 0:
                continue
            cov = self.covariance_.predict(found.cov[None], np.zeros((1, 1)))[0][0]
            columns['yaw'][i], columns['yaw_std'][i] = found.pose[2], np.sqrt(cov[2, 2])
            columns['position'][i, :2] = found.pose[:2]
            columns['position_cov'][i, :2, :2] = cov[:2, :2]


def profile_basis(axes: Array, half: float, side: int, knots: int) -> Array:
    """B-splines (n, k) of the distance of grid nodes to the nearer of two axes from one bend.

    `axes` (4,) holds their directions (rad) and the place of the bend (m), where each cylinder
    ends round.
    """
    line = np.linspace(-half, half, side)
    u, v = line[None, :] - axes[2], line[:, None] - axes[3]
    away = np.full((side, side), np.inf)
    for turn in axes[:2]:
        along = np.cos(turn) * u + np.sin(turn) * v
        across = np.cos(turn) * v - np.sin(turn) * u
        away = np.minimum(away, np.hypot(across, np.minimum(along, 0.0)))
    ends = np.concatenate([np.zeros(3), np.linspace(0.0, half, knots), np.full(3, half)])
    inside = np.minimum(away, half * (1 - 1e-9)).reshape(-1)
    return np.asarray(BSpline.design_matrix(inside, ends, 3).toarray())
