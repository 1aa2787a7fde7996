# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Calibration of a magnetised sheet over chips: bundle adjustment of rest and presses with priors.

Parameters are the places, tilts and gains of the chips, the remanence of the sheet (of all, band
by band, and uneven along them), where its bands lie, and the share of the body's rotation that
the magnets follow. The pose, depth and tilt of each press and a uniform field are states of their
own with priors (a label gives a place, a turn may be unknown), which are eliminated press by
press by the Schur complement. What the readings do not determine stays at its prior.

Source: B. Triggs et al., Bundle adjustment, a modern synthesis (2000), sec. 6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from tactile_ros.estimators.few_shot import share_of
from tactile_ros.physics.elastomer import Layer, PunchDents, punch_pressure
from tactile_ros.physics.magnet_sheet import Sheet
from tactile_ros.types import Array, Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array, Integers

NODES = 13  # of the unevenness of the sheet along each side
USUAL = {
    'place': 0.15e-3,  # m, of a chip
    'tilt': 0.02,  # rad
    'gain': 0.03,
    'uneven': 0.07,  # of remanence, at a node
    'band': 0.07,  # of remanence, band by band
    'common': 0.4,  # of remanence, all of it
    'shift': 0.4e-3,  # m, of all bands
    'gap': 0.2e-3,  # m, of all chips
    'stray': 5e-5,  # T, field of the Earth and offsets
    'turning': 0.3,  # share of the body's rotation that magnets follow
}
MANY = ('place', 'tilt', 'gain', 'uneven', 'band')  # their usual size is estimated with them
WORKSHOP = 10.0  # members, as which the usual size counts
REST_ERROR = 4e-3  # of the resting field: what no parameter explains
EXPLAINED = 0.85  # of the resting field, below which the drawing is of another skin
ERRORS = (0.012, 0.2)  # of a press: what no parameter explains, at least and at most
ROUNDS, PRESS_ROUNDS = 4, 3  # of rest, and of presses
STATES = 9  # place, turn, depth, two tilts, uniform field
PLACE_SIGMA, TURN_SIGMA, OPEN_TURN = 1e-4, 0.01, 0.3  # of labels (m, rad), and without a label
TILT_SIGMA = 0.02  # rad, of a pressing head
STEPS = np.array([5e-5, 5e-5, 5e-3, 2e-5, 2e-3, 2e-3])  # m, m, rad, m, rad, rad
CHIP_STEP, SHARE_STEP = 2e-5, 0.05  # m and share
LEAST = 0.01  # of the largest movement: dipoles that move less are left out
DEPTH = 0.1  # of the body, from which the search for a depth starts
# places (of the sheet) and turns of presses that are made up
MADE = ((0.0, 0.0, 0.0), (0.25, 0.1, 0.5), (-0.1, 0.25, 1.0), (-0.25, -0.1, 1.5))


@dataclass(frozen=True)
class SkinModel:
    """Everything that the answer of a multipole skin to a flat head depends on."""

    size: Array  # (2,) of the sheet (m)
    # soft layer under the sheet, and the sheet (m); the base is at z = 0
    layer: float
    thickness: float
    # width of a band (m); 'M1' to 'M4'
    pole_pitch: float
    magnetisation: str
    # of the body (Pa, 1)
    youngs: float
    poisson: float
    strengths: Array  # (b,) remanence of the bands (T)
    uneven: Array  # (NODES, NODES) relative deviation of the remanence over the sheet
    shift: float  # of the bands along y (m)
    chips: Array  # (t, 3) Hall elements (m)
    responses: Array  # (t, 3, 3) field in sensor axes -> reading
    turning: float  # share of the body's rotation that the magnets follow

    @property
    def body(self) -> float:
        """Height of layer and sheet (m)."""
        return self.layer + self.thickness

    @cached_property
    def sheet(self) -> Sheet:
        """The sheet at rest."""
        plain = Sheet(
            self.size, self.layer, self.thickness, self.pole_pitch, self.magnetisation,
            self.strengths, self.shift,
        )  # fmt: skip
        x, y = hats(plain)
        return replace(plain, uneven=x @ self.uneven @ y.T) if self.uneven.any() else plain

    @cached_property
    def dents(self) -> PunchDents:
        """Dents of the body."""
        shear_modulus = self.youngs / (2 * (1 + self.poisson))
        return PunchDents(self.sheet, Layer(self.body, shear_modulus, self.poisson))

    @property
    def common(self) -> Array:
        """Readings of a uniform field, shape (t 3, 3)."""
        return self.responses.reshape(-1, 3)

    def rest(self) -> Array:
        """Readings at rest (T), shape (t, 3)."""
        return np.asarray(np.einsum('tij,tj->ti', self.responses, self.sheet.field(self.chips)))


def hats(sheet: Sheet) -> tuple[Array, Array]:
    """Weights of the nodes of an uneven remanence at cells, shapes (x, NODES) and (y, NODES)."""
    found = []
    for line, size in zip(sheet.lines, sheet.size, strict=True):
        away = (line / size + 0.5) * (NODES - 1)
        found.append(np.maximum(1 - np.abs(away[:, None] - np.arange(NODES)), 0.0))
    return found[0], found[1]


@dataclass(frozen=True)
class LabelledPress:
    """A press of a described head at a labelled place."""

    outline: Outline
    pose: Array  # (3,) place (m) and turn (rad)
    turn_known: bool  # the turn is a label, not a first guess
    # (t 3,) change of field (T), and variance by noise (T2)
    pattern: Array
    variance: Array


class SheetCalibration:
    """Parameters of one skin, from its drawing on; `noise` is of a resting reading (T).

    Attributes
    ----------
    model : SkinModel
        The skin as far as it is estimated.
    error : float
        Share of a press that the model does not explain.
    """

    def __init__(self, drawn: SkinModel, noise: float) -> None:
        self.drawn = self.model = drawn
        self.noise, self.error = noise, 0.02
        t, self.parts = len(drawn.chips), {}
        counts = {'place': 3 * t, 'tilt': 3 * t, 'gain': 3 * t, 'uneven': NODES**2,
                  'band': len(drawn.strengths), 'stray': 3}  # fmt: skip
        start = 0
        for name in USUAL:
            self.parts[name] = slice(start, start + counts.get(name, 1))
            start = self.parts[name].stop
        self.prior = np.concatenate(
            [np.full(part.stop - part.start, USUAL[name]) for name, part in self.parts.items()]
        )
        self.theta = np.zeros(start)
        self._loads: dict[int, tuple[Outline, Array, Array]] = {}
        self._poses: list[Array] = []
        x, y = hats(drawn.sheet)
        self._hats = sparse.csr_array(sparse.kron(sparse.kron(x, y), np.ones((2, 1))))
        self._system: tuple[Array, Array, list[tuple[Array, Array]]]

    def fit_rest(self, rest: Array) -> bool:
        """Fit resting readings (t, 3); False: they are of another skin, nothing is changed."""
        self._iterate(rest, [], ROUNDS)
        left = self._rest_residual(rest)
        if np.linalg.norm(left) <= (1 - EXPLAINED) * np.linalg.norm(rest):
            return True
        self.theta, self.model = np.zeros_like(self.theta), self.drawn
        return False

    def fit_presses(self, rest: Array | None, presses: Sequence[LabelledPress]) -> None:
        """Fit labelled presses together with resting readings (t, 3), or without."""
        self._poses = [self._first_state(press) for press in presses]
        self._iterate(rest, presses, PRESS_ROUNDS)

    def held_out(self, presses: Sequence[LabelledPress], fold: Integers) -> tuple[Array, float]:
        """Presses that differ from this skin as fitted ones do from a skin fitted without them.

        Those of the last `fit_presses` (n); of each fold (n,) the last round is made again
        without. Patterns (n, t 3) (T), and the share that the other skins do not explain.
        """
        patterns = np.array([press.pattern for press in presses])
        left = np.empty_like(patterns)
        *system, parts = self._system
        fitted = self._residuals(presses)
        self.error = _share(np.array(fitted), presses)
        for one in np.unique(fold):
            rows = np.flatnonzero(fold == one).tolist()
            rest = (whole - sum(parts[i][k] for i in rows) for k, whole in enumerate(system))
            model = self._model(self._before + _solved(*rest))
            for i in rows:
                state = self._poses[i] + self._eliminated(presses[i], self._poses[i], model)[1][0]
                left[i] = self._residual(model, presses[i], state)
        patterns += left - fitted
        return patterns, _share(left, presses)

    def expected(self, outlines: Sequence[Outline]) -> float:
        """Usual share of presses elsewhere that errors of the parameters leave unexplained."""
        normal = self._system[0]
        scale = np.sqrt(np.diag(normal))
        covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
        part = self.parts['turning']  # chosen by presses; rest says nothing of it
        if not self._poses:
            covariance[part] = covariance[:, part] = 0.0
        shares = []
        for i, (x, y, turn) in enumerate(MADE):
            state = np.zeros(STATES)
            state[:4] = [*(np.array([x, y]) * self.model.size), turn, DEPTH * self.model.body]
            nothing = np.zeros(self.model.chips.size)
            press = LabelledPress(outlines[i % len(outlines)], state[:3], True, nothing, nothing)
            residual, slopes, by_state = self._press_slopes(self.model, press, state)
            free = np.linalg.qr(by_state[[0, 1, 2, 3, 6, 7, 8]].T)[0]
            slopes = slopes - (slopes @ free) @ free.T
            variance = np.einsum('pd,pq,qd->d', slopes, covariance, slopes)
            shares.append(variance.sum() / share_of(residual, 1.0).sum())
        return float(np.clip(np.sqrt(np.median(shares) + self.error**2), *ERRORS))

    def _first_state(self, press: LabelledPress) -> Array:
        """State of a press at its labels, at the depth that fits."""
        state = np.array([*press.pose, DEPTH * self.model.body, 0, 0, 0, 0, 0.0])
        basis = np.linalg.qr(self.model.common)[0]
        wanted = press.pattern - basis @ (basis.T @ press.pattern)
        for _ in range(3):
            made = self._read(self.model, press, state)
            made = made - basis @ (basis.T @ made)
            ratio = np.clip(wanted @ made / (made @ made), 0.3, 3.0)
            state[3] = min(state[3] * ratio, 0.45 * self.model.body)
        return state

    def _iterate(self, rest: Array | None, presses: Sequence[LabelledPress], rounds: int) -> None:
        """Gauss-Newton with priors; states of presses are eliminated."""
        for number in range(rounds):
            normal, gradient = np.diag(1 / self.prior**2), -self.theta / self.prior**2
            if rest is not None:
                slopes, sigma = self._rest_slopes()
                residual = self._rest_residual(rest).ravel() / sigma
                normal += slopes @ slopes.T / sigma**2
                gradient += slopes @ residual / sigma
            parts, backs = [], []
            if number and presses:
                self.error = _share(np.array(self._residuals(presses)), presses)
            for press, state in zip(presses, self._poses, strict=True):
                part, back = self._eliminated(press, state)
                parts.append(part)
                backs.append(back)
                normal += part[0]
                gradient += part[1]
            self._before, self._system = self.theta, (normal, gradient, parts)
            change = _solved(normal, gradient)
            self.theta = self.theta + change
            self.model = self._model(self.theta)
            if presses:
                pairs = zip(self._poses, backs, strict=True)
                self._poses = [state + own - shared @ change for state, (own, shared) in pairs]
            self._scale_priors(normal)

    def _scale_priors(self, normal: Array) -> None:
        """Estimate how far parameters of one kind usually are off (expectation, maximisation)."""
        scale = np.sqrt(np.diag(normal))
        variance = np.diag(np.linalg.inv(normal / np.outer(scale, scale))) / scale**2
        for name in MANY:
            part, usual = self.parts[name], USUAL[name] ** 2
            square = (np.square(self.theta[part]) + variance[part]).sum()
            found = (square + WORKSHOP * usual) / (part.stop - part.start + WORKSHOP)
            self.prior[part] = np.sqrt(found)

    def _model(self, theta: Array) -> SkinModel:
        """Skin with some parameters."""
        drawn, parts = self.drawn, self.parts
        chips = drawn.chips + theta[parts['place']].reshape(-1, 3)
        chips[:, 2] += theta[parts['gap']]
        tilt = theta[parts['tilt']].reshape(-1, 3)
        turned = np.eye(3) + np.cross(tilt[:, None], np.eye(3)[None])
        gain = 1 + theta[parts['gain']].reshape(-1, 3, 1)
        strengths = drawn.strengths * (1 + theta[parts['band']]) * (1 + theta[parts['common']])
        return replace(
            drawn, chips=chips, strengths=strengths,
            uneven=theta[parts['uneven']].reshape(NODES, NODES),
            responses=gain * np.matmul(drawn.responses, turned),
            shift=float(drawn.shift + theta[parts['shift']][0]),
            turning=float(np.clip(drawn.turning + theta[parts['turning']][0], 0.0, 1.2)),
        )  # fmt: skip

    # -- rest ----------------------------------------------------------------------------------

    def _rest_residual(self, rest: Array) -> Array:
        """Difference (t, 3) of resting readings from the model's, with the stray field of now."""
        stray = self.theta[self.parts['stray']]
        made = self.model.rest() + np.einsum('tij,j->ti', self.model.responses, stray)
        return np.asarray(rest - made)

    def _rest_slopes(self) -> tuple[Array, float]:
        """Slopes (parameters, t 3) of resting readings, and their deviation."""
        model, sheet = self.model, self.model.sheet
        field = sheet.field(model.chips)
        along = [(sheet.field(model.chips + CHIP_STEP * e) - field) / CHIP_STEP for e in np.eye(3)]
        moved = replace(model, shift=model.shift + CHIP_STEP)
        every = np.arange(len(sheet.each_moment))
        slopes = self._slopes(
            field + self.theta[self.parts['stray']], along,
            (moved.sheet.field(model.chips) - field) / CHIP_STEP,
            sheet.cell_fields(model.chips, every), every, sheet.band_fields(model.chips),
        )  # fmt: skip
        slopes[self.parts['stray']] = model.common.T
        size = np.linalg.norm(field, axis=1).max()
        return slopes, float(np.hypot(self.noise, REST_ERROR * size))

    def _slopes(
        self, field: Array, along: Sequence[Array], shift: Array, cells: Array, rows: Integers,
        bands: Array,
    ) -> Array:  # fmt: skip
        """Slopes (parameters, t 3) of readings of a field (t, 3) with its derivatives."""
        model, parts = self.model, self.parts
        read, t = model.responses, len(model.chips)
        slopes = np.zeros((len(self.prior), t, 3))
        chip = np.arange(t)
        for i, unit in enumerate(np.eye(3)):
            place = np.einsum('tij,tj->ti', read, along[i])
            slopes[parts['place']].reshape(t, 3, t, 3)[chip, i, chip] = place
            tilt = np.einsum('tij,tj->ti', read, np.cross(field, unit))
            slopes[parts['tilt']].reshape(t, 3, t, 3)[chip, i, chip] = tilt
            one = np.einsum('tj,tj->t', read[:, i], field)
            slopes[parts['gain']].reshape(t, 3, t, 3)[chip, i, chip, i] = one
            if i == 2:
                slopes[parts['gap']] = place
        each = np.einsum('tij,btj->bti', read, bands * model.strengths[:, None, None])
        slopes[parts['band']] = each
        slopes[parts['common']] = each.sum(axis=0)
        slopes[parts['shift']] = np.einsum('tij,tj->ti', read, shift)
        wide = cells * (model.sheet.band_moments[rows] @ model.strengths)
        nodes = self._hats[rows].T @ wide.reshape(3 * t, -1).T
        slopes[parts['uneven']] = np.einsum('tij,ktj->kti', read, nodes.reshape(-1, t, 3))
        return slopes.reshape(len(self.prior), -1)

    # -- presses -------------------------------------------------------------------------------

    def _dent(self, model: SkinModel, press: LabelledPress, state: Array) -> tuple[Array, Array]:
        """Movements (m) and rotations (rad), (g, 3) each, of the dipoles under a press."""
        if id(press.outline) not in self._loads:
            self._loads[id(press.outline)] = (
                press.outline,
                *punch_pressure(press.outline.loops, model.dents.body, tilted=True),
            )
        _, points, loads = self._loads[id(press.outline)]
        images = model.dents.images(points, state[3:6] @ loads, state[:3])
        flat = model.dents.on_sheet(model.sheet, images).T
        return flat[:, :3], np.column_stack([flat[:, 3:], np.zeros(len(flat))])

    @staticmethod
    def _cells(model: SkinModel, chips: Array, dent: tuple[Array, Array], rows: Integers) -> Array:
        """Change of the field (t, 3, n) by dipoles of moment one that move."""
        return model.sheet.cell_changes(chips, rows, dent[0], model.turning * dent[1])

    @staticmethod
    def _moving(dent: tuple[Array, Array]) -> Integers:
        """Dipoles that move."""
        size = np.abs(dent[0]).max(axis=1)
        return np.flatnonzero(size > LEAST * size.max())

    def _read(self, model: SkinModel, press: LabelledPress, state: Array) -> Array:
        """Readings (t 3,) of a press in some state."""
        dent = self._dent(model, press, state)
        rows = self._moving(dent)
        field = self._cells(model, model.chips, dent, rows) @ model.sheet.each_moment[rows]
        return np.asarray(np.einsum('tij,tj->ti', model.responses, field + state[6:]).ravel())

    def _residual(self, model: SkinModel, press: LabelledPress, state: Array) -> Array:
        """Difference (t 3,) of a press from the model's."""
        return press.pattern - self._read(model, press, state)

    def _residuals(self, presses: Sequence[LabelledPress]) -> list[Array]:
        """Differences of fitted presses from the model's."""
        pairs = zip(presses, self._poses, strict=True)
        return [self._residual(self.model, *pair) for pair in pairs]

    def _press_slopes(
        self, model: SkinModel, press: LabelledPress, state: Array
    ) -> tuple[Array, Array, Array]:
        """Residual (t 3,) and its slopes with the parameters and with the state, negated."""
        sheet, dent = model.sheet, self._dent(model, press, state)
        rows = self._moving(dent)
        moments = sheet.each_moment[rows]
        cells = self._cells(model, model.chips, dent, rows)
        field = cells @ moments
        along = [
            (self._cells(model, model.chips + CHIP_STEP * e, dent, rows) @ moments - field)
            / CHIP_STEP
            for e in np.eye(3)
        ]
        shifted = replace(model, shift=model.shift + CHIP_STEP).sheet
        shift = cells @ ((shifted.each_moment[rows] - moments) / CHIP_STEP)
        bands = np.moveaxis(cells @ sheet.band_moments[rows], 2, 0)
        slopes = self._slopes(field, along, shift, cells, rows, bands)
        more = replace(model, turning=model.turning + SHARE_STEP)
        turned = (self._cells(more, model.chips, dent, rows) @ moments - field) / SHARE_STEP
        slopes[self.parts['turning']] = np.einsum('tij,tj->ti', model.responses, turned).ravel()
        by_state = np.empty((STATES, slopes.shape[1]))
        for i, step in enumerate(STEPS):
            moved = state.copy()
            moved[i] += step
            other = self._dent(model, press, moved)
            change = (self._cells(model, model.chips, other, rows) @ moments - field) / step
            by_state[i] = np.einsum('tij,tj->ti', model.responses, change).ravel()
        by_state[6:] = model.common.T
        read = np.einsum('tij,tj->ti', model.responses, field + state[6:]).ravel()
        return press.pattern - read, slopes, by_state

    def _eliminated(
        self, press: LabelledPress, state: Array, model: SkinModel | None = None
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Normal equations of a press without its state, and how the state follows."""
        model = self.model if model is None else model
        residual, slopes, by_state = self._press_slopes(model, press, state)
        sigma = np.sqrt(press.variance + share_of(press.pattern, self.error))
        residual, slopes, by_state = residual / sigma, slopes / sigma, by_state / sigma
        turn = TURN_SIGMA if press.turn_known else OPEN_TURN
        prior = np.array([PLACE_SIGMA, PLACE_SIGMA, turn, np.inf, TILT_SIGMA, TILT_SIGMA,
                          *np.full(3, np.inf)])  # fmt: skip
        middle = np.array([*press.pose, *np.zeros(6)])
        own = by_state @ by_state.T + np.diag(prior**-2.0)
        pull = by_state @ residual + (middle - state) / prior**2
        cross = slopes @ by_state.T
        solved = _solved(own, np.column_stack([pull, cross.T]))
        part = slopes @ slopes.T - cross @ solved[:, 1:]
        return (part, slopes @ residual - cross @ solved[:, 0]), (solved[:, 0], solved[:, 1:])


def _share(left: Array, presses: Sequence[LabelledPress]) -> float:
    """Usual share of presses that is left (n, d), beside noise."""
    whole = np.array([press.pattern for press in presses])
    noise = np.array([press.variance for press in presses])
    square = np.maximum((np.square(left) - noise).sum(axis=1), 0.0)
    size = share_of(whole, 1.0).sum(axis=1)
    return float(np.clip(np.sqrt(np.median(square / size)), *ERRORS))


def _solved(normal: Array, right: Array) -> Array:
    """Solution of normal equations whose parameters have unlike units."""
    scale = np.sqrt(np.diag(normal))
    wide = scale if right.ndim == 1 else scale[:, None]
    return np.asarray(np.linalg.solve(normal / np.outer(scale, scale), right / wide) / wide)


def bands_of(size: Array, pole_pitch: float, magnetisation: str) -> int:
    """Count the bands of a sheet."""
    if magnetisation == 'M4':
        return int(np.ceil(float(size[1]) / pole_pitch - 1e-9)) + 1
    return 2 if magnetisation == 'M3' else 1
