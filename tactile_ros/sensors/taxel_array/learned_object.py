"""Objects of which no outline is stated: pressure fields learned from frames with known poses.

The forces of a frame are linear in the fields: y_t = sum_k a_k A_t(pose) T_k. Fields T_k, which
are smooth, and the amounts a_k of every frame are solved in turn; the first is the mean contact,
the others what depth changes. The pose of another frame follows by `estimators/object_pose.py`.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.linalg import solve

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.object_pose import ObjectPose, TaxelPoints
from tactile_ros.physics.coverage import LearnedFields

if TYPE_CHECKING:
    from tactile_ros.estimators.object_pose import Found
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Bools, Columns

FEWEST = 30  # frames
SIDE = 31  # nodes of the grid's side
POINTS = 2304  # of all taxels together, about
MODES = 3
ROUNDS = 3
SMOOTH = (1e-3, 1e-2)  # strengths of the prior that are tried
HELD_OUT = 4  # one frame of so many is held out


class LearnedObject:
    """One object on one array.

    Attributes
    ----------
    fields_ : LearnedFields
        Fields in the object's frame.
    covariance_ : CovarianceModel
        Of x, y (m) and yaw (rad), from held-out frames.
    misfit_ : float
        Scale of the misfit of held-out frames at their poses, at least 1.
    report_ : dict of str to float
        Errors of held-out frames.
    """

    fields_: LearnedFields
    covariance_: CovarianceModel
    misfit_: float
    report_: dict[str, float]

    def __init__(self, config: TaxelArrayConfig) -> None:
        self.config = config

    def fit(self, force: Array, sigma: Array, poses: Array, usable: Bools) -> LearnedObject:
        """Learn from frames.

        Parameters
        ----------
        force, sigma : ndarray, shape (s, t)
            Of the taxels, and their standard deviations (N).
        poses : ndarray, shape (s, 3)
            x, y (m) and yaw (rad) of the object.
        usable : ndarray, shape (t,)
            False: dead.
        """
        config = self.config
        count = max(POINTS // len(config.positions), 4)
        points = TaxelPoints(config.positions, config.areas, config.taxel_outlines, count)
        away = points.points[None] - poses[:, None, :2]
        self.half = float(np.quantile(np.abs(away).max(axis=(1, 2)), 0.9)) * 1.1
        rows = [self._row(points, pose) for pose in poses]
        held = np.arange(len(poses)) % HELD_OUT == HELD_OUT - 1
        told, weight = np.nan_to_num(force), np.isfinite(force) * usable / sigma
        best, strength = np.inf, SMOOTH[0]
        for one in SMOOTH:
            fields = self._solve([r for r, h in zip(rows, held, strict=True) if not h],
                                 told[~held], weight[~held], one)  # fmt: skip
            wrong = self._misfit(fields, [r for r, h in zip(rows, held, strict=True) if h],
                                 told[held], weight[held])  # fmt: skip
            if wrong < best:
                best, strength, self.fields_ = wrong, one, fields
        taxels = max(int(np.count_nonzero(usable)), MODES + 4)
        self.misfit_ = max(float(np.sqrt(best * taxels / (taxels - MODES))), 1.0)
        found, cov = self._locate(force[held], sigma[held], usable)
        miss = found - poses[held]
        miss[:, 2] = (miss[:, 2] + np.pi) % (2 * np.pi) - np.pi
        self.covariance_ = CovarianceModel().fit(miss, cov, np.arange(len(miss)), 0 * miss[:, :1])
        self.report_ = {
            'held_out_rmse_yaw': float(np.sqrt(np.nanmean(np.square(miss[:, 2])))),
            'held_out_rmse_place': float(np.sqrt(np.nanmean(np.square(miss[:, :2]).sum(axis=1)))),
            'located': float(np.isfinite(miss[:, 2]).mean()),
        }
        self.fields_ = self._solve(rows, told, weight, strength)
        vars(self).pop('objects')
        return self

    def _row(self, points: TaxelPoints, pose: Array) -> sparse.csr_matrix:
        """Part of each node in the force of each taxel at a pose, shape (t, n)."""
        dx, dy = (points.points - pose[:2]).T
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        u = (cos * dx + sin * dy + self.half) / (2 * self.half) * (SIDE - 1)
        v = (cos * dy - sin * dx + self.half) / (2 * self.half) * (SIDE - 1)
        inside = (u >= 0) & (v >= 0) & (u < SIDE - 1) & (v < SIDE - 1)
        taxel = np.repeat(np.arange(len(points.areas)), np.diff(points.first))[inside]
        u, v = u[inside], v[inside]
        i, j = u.astype(int), v.astype(int)
        a, b = u - i, v - j
        part = (points.areas / np.diff(points.first))[taxel]
        entries = [
            (part * (1 - a) * (1 - b), j * SIDE + i), (part * a * (1 - b), j * SIDE + i + 1),
            (part * (1 - a) * b, (j + 1) * SIDE + i), (part * a * b, (j + 1) * SIDE + i + 1),
        ]  # fmt: skip
        return sparse.csr_matrix(
            (np.concatenate([e[0] for e in entries]),
             (np.tile(taxel, 4), np.concatenate([e[1] for e in entries]))),
            shape=(len(points.areas), SIDE * SIDE),
        )  # fmt: skip

    def _solve(
        self, rows: list[sparse.csr_matrix], force: Array, weight: Array, strength: float
    ) -> LearnedFields:
        """Fields and amounts in turn."""
        load = force.sum(axis=1)
        depth = load / load.mean() - 1.0
        depth /= max(float(depth.std()), 1e-9)
        amounts = load[:, None] * np.stack([depth**k for k in range(MODES)], axis=1)
        difference = sparse.diags([-1.0, 1.0], [0, 1], shape=(SIDE - 1, SIDE))
        gradient = sparse.vstack(
            [sparse.kron(sparse.eye(SIDE), difference), sparse.kron(difference, sparse.eye(SIDE))]
        )
        rough = (gradient.T @ gradient + 0.01 * sparse.eye(SIDE * SIDE)).toarray()
        stacked = sparse.vstack(rows).tocsr()
        flat = weight.reshape(-1)
        pictures = np.zeros((MODES, SIDE * SIDE))
        for _ in range(ROUNDS):
            wide = sparse.hstack(
                [sparse.diags(flat * np.repeat(amounts[:, k], weight.shape[1])) @ stacked
                 for k in range(MODES)]
            ).tocsr()  # fmt: skip
            normal = (wide.T @ wide).toarray()
            unit = np.trace(normal[: SIDE**2, : SIDE**2]) / SIDE**2
            normal += np.kron(np.eye(MODES), strength * unit * rough)
            pictures = solve(normal, wide.T @ (flat * force.reshape(-1)), assume_a='pos')
            pictures = pictures.reshape(MODES, -1)
            amounts = self._amounts(pictures, rows, force, weight)
            # modes of mean zero and unit covariance, in parts of the first field's amount
            part = amounts[:, 1:] / amounts[:, :1]
            pictures[0] += part.mean(axis=0) @ pictures[1:]
            part -= part.mean(axis=0)
            factor = np.linalg.cholesky(part.T @ part / len(part) + 1e-12 * np.eye(MODES - 1))
            pictures[1:] = factor.T @ pictures[1:]
            amounts[:, 1:] = amounts[:, :1] * np.linalg.solve(factor, part.T).T
        pictures /= np.abs(pictures[0]).max()
        return LearnedFields(pictures.reshape(MODES, SIDE, SIDE), self.half, np.ones(MODES))

    @staticmethod
    def _amounts(
        pictures: Array, rows: list[sparse.csr_matrix], force: Array, weight: Array
    ) -> Array:
        """Amounts (s, k) of every frame by least squares."""
        found = []
        for row, y, w in zip(rows, force, weight, strict=True):
            terms = (row @ pictures.T) * w[:, None]
            gram = terms.T @ terms
            first = max(float(terms[:, 0] @ (w * y)) / gram[0, 0], 1e-12)
            gram[1:, 1:] += np.eye(MODES - 1) / (4.0 * first) ** 2
            found.append(np.linalg.solve(gram, terms.T @ (w * y)))
        return np.array(found)

    def _misfit(
        self, fields: LearnedFields, rows: list[sparse.csr_matrix], force: Array, weight: Array
    ) -> float:
        """Mean squared misfit of frames at their poses."""
        pictures = fields.pictures.reshape(MODES, -1)
        amounts = self._amounts(pictures, rows, force, weight)
        wrong = [
            np.square(w * (y - row @ (a @ pictures)))
            for row, y, w, a in zip(rows, force, weight, amounts, strict=True)
        ]
        return float(np.mean(wrong))

    @cached_property
    def objects(self) -> ObjectPose:
        """The object on its array."""
        config = self.config
        return ObjectPose(
            config.positions, config.areas, config.taxel_outlines, (self.fields_,)
        )

    def _locate(self, force: Array, sigma: Array, usable: Bools) -> tuple[Array, Array]:
        """Poses (s, 3) of frames and their covariances (s, 3, 3), not yet scaled."""
        vars(self).pop('objects', None)
        found = [self._one(*row, usable) for row in zip(force, sigma, strict=True)]
        return np.array([one.pose for one in found]), np.array([one.cov for one in found])

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
