"""What resting readings and known presses tell of a multipole skin beyond its drawing.

Chips lie and point a little aside and differ in gain, the sheet is uneven and its bands are not
quite where they should be. All of it is found at once by least squares with what is usual in
workshops as prior: the resting field alone, of millitesla that change within millimetres, tells
most; a few presses of one known head tell the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.skin_model import SkinModel
    from tactile_ros.types import Array, Outline

USUAL = {
    'place': 0.2e-3,  # m, of a chip
    'tilt': 0.03,  # rad
    'gain': 0.04,
    'band': 0.07,  # of remanence, band by band
    'common': 0.4,  # of remanence, all bands
    'shift': 0.4e-3,  # m, of all bands
    'gap': 0.2e-3,  # m, of all chips
    'stray': 5e-5,  # T, field of the Earth and offsets
}
MISSED = 4e-3  # of the resting field: what no parameter explains
PRESS_MISSED = 0.015  # of what a chip sees of a press
STEP = 2e-5  # m, over which fields are differentiated
ROUNDS = 4
MOST_PRESSES = 30
EXPLAINED = 0.85  # of the resting field, below which the drawing is of another skin
DEPTH = 0.1  # of the body, from which the search for a depth starts


@dataclass(frozen=True)
class KnownPress:
    """A press of a known head at a known place.

    Attributes
    ----------
    outline : Outline
        Of the head.
    pose : ndarray, shape (3,)
        Place (m) and turn (rad).
    pattern, powers : ndarray, shape (t 3,) and (3,)
        As in `PressVectors`.
    """

    outline: Outline
    pose: Array
    pattern: Array
    powers: Array


class SkinFit:
    """Parameters of one skin, from its drawing on.

    Parameters
    ----------
    drawn : SkinModel
        From the config.
    noise : float
        Of a resting reading that many frames gave (T).

    Attributes
    ----------
    found : SkinModel
        With the parameters of the last fit.
    missed : float
        Share of known presses that is not explained, as a chip sees it; NaN without presses.
    """

    def __init__(self, drawn: SkinModel, noise: float) -> None:
        self.drawn, self.noise = drawn, noise
        t, b = len(drawn.chips), len(drawn.strengths)
        sizes = [
            ('place', 3 * t), ('tilt', 3 * t), ('gain', 3 * t), ('band', b), ('common', 1),
            ('shift', 1), ('gap', 1), ('stray', 3),
        ]  # fmt: skip
        ends = np.cumsum([0] + [n for _, n in sizes])
        self.parts = {name: slice(ends[i], ends[i + 1]) for i, (name, _) in enumerate(sizes)}
        self.prior = np.concatenate([np.full(n, USUAL[name]) for name, n in sizes])
        self.theta = np.zeros(len(self.prior))
        self.found, self.missed = drawn, float('nan')
        self._loads: dict[int, tuple[Array, Array]] = {}

    def fit_rest(self, rest: Array) -> bool:
        """Fit resting readings (t, 3); False and nothing found if they are of another skin."""
        self._iterate(rest, [])
        missed = self._readings(self.found, rest)
        explained = 1 - float(np.square(missed).sum() / np.square(rest).sum())
        usual = self.theta / self.prior
        if explained < EXPLAINED or np.abs(usual).max() > 6:
            self.theta, self.found = np.zeros(len(self.prior)), self.drawn
            return False
        return True

    def fit_presses(self, rest: Array | None, presses: Sequence[KnownPress]) -> None:
        """Fit known presses together with resting readings (t, 3), or without."""
        rows = np.unique(np.linspace(0, len(presses) - 1, MOST_PRESSES).astype(int))
        chosen = [presses[i] for i in rows]
        costs = {}
        for turning in (0.0, 1.0):
            self.found = replace(self.found, turning=turning)
            costs[turning] = sum(self._miss(one)[1] for one in chosen[:: len(chosen) // 12 + 1])
        best = min(costs, key=lambda turning: costs[turning])
        self.drawn = replace(self.drawn, turning=best)
        self.found = replace(self.found, turning=best)
        self._iterate(rest, chosen, rounds=2)
        shares = [self._miss(one)[2] for one in chosen]
        self.missed = float(np.sqrt(np.mean(np.square(shares))))

    def _iterate(
        self, rest: Array | None, presses: Sequence[KnownPress], rounds: int = ROUNDS
    ) -> None:
        """Gauss-Newton with the prior."""
        for _ in range(rounds):
            normal = np.diag(1 / self.prior**2)
            gradient = -self.theta / self.prior**2
            blocks = [self._rest_block(rest)] if rest is not None else []
            blocks += [self._press_block(one) for one in presses]
            for miss, slopes, sigma in blocks:
                j = slopes / sigma
                normal += j @ j.T
                gradient += j @ (miss / sigma)
            scale = np.sqrt(np.diag(normal))
            step = np.linalg.solve(normal / np.outer(scale, scale), gradient / scale) / scale
            self.theta = self.theta + step
            self.found = self._model()

    def _model(self) -> SkinModel:
        """Skin with the parameters of now."""
        drawn, theta, parts = self.drawn, self.theta, self.parts
        chips = drawn.chips + theta[parts['place']].reshape(-1, 3)
        chips[:, 2] += theta[parts['gap']]
        tilt = theta[parts['tilt']].reshape(-1, 3)
        turned = np.eye(3) + np.cross(tilt[:, None], np.eye(3)[None])
        gain = 1 + theta[parts['gain']].reshape(-1, 3, 1)
        strengths = drawn.strengths * (1 + theta[parts['band']]) * (1 + theta[parts['common']])
        return replace(
            drawn, chips=chips, strengths=strengths,
            responses=gain * np.matmul(drawn.responses, turned),
            shift=float(drawn.shift + theta[parts['shift']][0]),
        )  # fmt: skip

    def _readings(self, model: SkinModel, rest: Array) -> Array:
        """What resting readings differ by from a model's, with the stray field of now."""
        stray = self.theta[self.parts['stray']]
        return np.asarray(rest - model.rest() - np.einsum('tij,j->ti', model.responses, stray))

    def _rest_block(self, rest: Array) -> tuple[Array, Array, Array]:
        """Misfit (t 3,), its slopes (parameters, t 3) and deviation at rest."""
        model = self.found
        bands = model.sheet.band_fields(model.chips)
        field = np.tensordot(model.strengths, bands, axes=1)
        stray = self.theta[self.parts['stray']]
        along = [
            (model.sheet.field(model.chips + STEP * e) - model.sheet.field(model.chips)) / STEP
            for e in np.eye(3)
        ]
        moved = replace(model, shift=model.shift + STEP)
        shift = (moved.sheet.field(model.chips) - field) / STEP
        slopes = self._slopes(model, field + stray, bands, along, shift)
        slopes[self.parts['stray']] = model.responses.reshape(-1, 3).T
        size = np.linalg.norm(field, axis=1).max()
        sigma = np.hypot(self.noise, MISSED * size)
        return self._readings(model, rest).ravel(), slopes, np.full(rest.size, sigma)

    def _slopes(
        self, model: SkinModel, field: Array, bands: Array, along: list[Array], shift: Array
    ) -> Array:
        """Slopes (parameters, t 3) of readings of a field (t, 3) with known derivatives."""
        t = len(model.chips)
        slopes = np.zeros((len(self.prior), t, 3))
        read = model.responses
        chip = np.arange(t)
        for i, unit in enumerate(np.eye(3)):
            place = np.einsum('tij,tj->ti', read, along[i])
            slopes[self.parts['place']].reshape(t, 3, t, 3)[chip, i, chip] = place
            tilt = np.einsum('tij,tj->ti', read, np.cross(field, unit))
            slopes[self.parts['tilt']].reshape(t, 3, t, 3)[chip, i, chip] = tilt
            one = np.einsum('tj,tj->t', read[:, i], field)
            slopes[self.parts['gain']].reshape(t, 3, t, 3)[chip, i, chip, i] = one
            if i == 2:
                slopes[self.parts['gap']] = place
        each = np.einsum('tij,btj->bti', read, bands * model.strengths[:, None, None])
        slopes[self.parts['band']] = each
        slopes[self.parts['common']] = each.sum(axis=0)
        slopes[self.parts['shift']] = np.einsum('tij,tj->ti', read, shift)
        return slopes.reshape(len(self.prior), -1)

    def _dent(self, press: KnownPress) -> tuple[Array, Array]:
        """Movements and turns of the sheet's dipoles (g, 3) per depth."""
        model = self.found
        key = id(press.outline)
        if key not in self._loads:
            self._loads[key] = model.dents.loads(press.outline)
        images = model.dents.images(*self._loads[key], press.pose)
        flat = model.dents.on_sheet(model.sheet, images).T
        turned = np.zeros((len(flat), 3))
        turned[:, :2] = model.turning * flat[:, 3:]
        return flat[:, :3], turned

    def _series(self, press: KnownPress, dent: tuple[Array, Array]) -> Array:
        """Changes of field by bands for powers 1 to 3 of the depth, shape (3, b, t, 3)."""
        model = self.found
        depths = 0.2 * model.body * np.array([1 / 3, 2 / 3, 1.0])
        found = [model.sheet.band_changes(model.chips, a * dent[0], a * dent[1]) for a in depths]
        inverse = np.linalg.inv(depths[:, None] ** np.arange(1, 4))
        return np.tensordot(inverse, np.stack(found), axes=1)

    def _depth(self, press: KnownPress, series: Array) -> tuple[float, Array]:
        """Depth (m) and modelled pattern by bands (b, t, 3) of a press."""
        model = self.found
        whole = np.tensordot(model.strengths, np.moveaxis(series, 1, 0), axes=1)
        read = np.einsum('tij,ptj->pti', model.responses, whole).reshape(3, -1)
        basis = np.linalg.qr(model.common)[0]
        read = read - (read @ basis) @ basis.T
        wanted = press.pattern - (press.pattern @ basis) @ basis.T
        a = DEPTH * model.body
        for _ in range(8):
            raised = press.powers * a ** np.arange(1, 4)
            slope = (press.powers * np.arange(1, 4) * a ** np.arange(3)) @ read
            step = slope @ (wanted - raised @ read) / (slope @ slope)
            a = float(np.clip(a + step, 0.3 * a, 3 * a))
            a = min(a, model.body)
        raised = press.powers * a ** np.arange(1, 4)
        return a, np.tensordot(raised, series, axes=1)

    def _miss(self, press: KnownPress) -> tuple[Array, float, float]:
        """Misfit of a press (t 3,), weighted cost, and share that is missed."""
        _, bands = self._depth(press, self._series(press, self._dent(press)))
        model = self.found
        field = np.tensordot(model.strengths, bands, axes=1)
        miss = press.pattern - np.einsum('tij,tj->ti', model.responses, field).ravel()
        basis = np.linalg.qr(model.common)[0]
        own = miss - basis @ (basis.T @ miss)
        sigma = self._sigma(press)
        size = np.square(sigma) - self.noise**2
        share = float(np.sqrt(max(np.square(own).mean() - self.noise**2, 0.0) / size.mean()))
        return miss, float(np.square(own / sigma).sum()), PRESS_MISSED * share

    def _sigma(self, press: KnownPress) -> Array:
        """Deviation of a press's pattern."""
        chips = press.pattern.reshape(-1, 3)
        here = np.square(chips).mean(axis=1)
        share = PRESS_MISSED**2 * (here + 0.05 * here.max())
        return np.repeat(np.sqrt(self.noise**2 + share), 3)

    def _press_block(self, press: KnownPress) -> tuple[Array, Array, Array]:
        """Misfit, slopes and deviation of a press; depth and uniform field are free."""
        model, dent = self.found, self._dent(press)
        depth, bands = self._depth(press, self._series(press, dent))
        field = np.tensordot(model.strengths, bands, axes=1)
        moved, turned = depth * dent[0], depth * dent[1]

        def change(sheet_model: SkinModel, chips: Array) -> Array:
            found = sheet_model.sheet.band_changes(chips, moved, turned)
            return np.asarray(np.tensordot(model.strengths, found, axes=1))

        now = change(model, model.chips)
        along = [(change(model, model.chips + STEP * e) - now) / STEP for e in np.eye(3)]
        shift = (change(replace(model, shift=model.shift + STEP), model.chips) - now) / STEP
        slopes = self._slopes(model, field, bands, along, shift)
        read = np.einsum('tij,tj->ti', model.responses, field).ravel()
        sigma = self._sigma(press)
        # depth and a uniform field are not known: what they do is taken out
        free = np.column_stack([read, model.common]) / sigma[:, None]
        basis = np.linalg.qr(free)[0]
        miss = (press.pattern - read) / sigma
        slopes = slopes / sigma
        slopes = slopes - (slopes @ basis) @ basis.T
        return miss - basis @ (basis.T @ miss), slopes, np.ones(len(sigma))
