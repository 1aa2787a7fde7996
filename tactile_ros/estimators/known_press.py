"""A known press on a multipole skin, beside what a model of the skin makes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.estimators.skin_model import SkinModel
    from tactile_ros.types import Array, Outline

PRESS_MISSED = 0.015  # of what a chip sees of a press: what no parameter of a skin explains
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


class PressMisfit:
    """What models of one skin make of known presses.

    Parameters
    ----------
    noise : float
        Of a pattern (T).
    """

    def __init__(self, noise: float) -> None:
        self.noise = noise
        self._loads: dict[int, tuple[Array, Array]] = {}

    def dent(self, model: SkinModel, press: KnownPress) -> tuple[Array, Array]:
        """Movements and turns of the sheet and its body (g, 3) per depth."""
        key = id(press.outline)
        if key not in self._loads:
            self._loads[key] = model.dents.loads(press.outline)
        images = model.dents.images(*self._loads[key], press.pose)
        flat = model.dents.on_sheet(model.sheet, images).T
        turned = np.zeros((len(flat), 3))
        turned[:, :2] = flat[:, 3:]
        return flat[:, :3], turned

    def series(self, model: SkinModel, dent: tuple[Array, Array]) -> Array:
        """Changes of field by bands for powers 1 to 3 of the depth, shape (3, b, t, 3)."""
        depths = 0.2 * model.body * np.array([1 / 3, 2 / 3, 1.0])
        found = [
            model.sheet.band_changes(model.chips, a * dent[0], a * model.turning * dent[1])
            for a in depths
        ]
        inverse = np.linalg.inv(depths[:, None] ** np.arange(1, 4))
        return np.tensordot(inverse, np.stack(found), axes=1)

    def depth(self, model: SkinModel, press: KnownPress, series: Array) -> tuple[float, Array]:
        """Depth (m) and modelled pattern by bands (b, t, 3) of a press."""
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

    def miss(self, model: SkinModel, press: KnownPress) -> tuple[Array, float, float]:
        """Misfit of a press (t 3,), weighted cost, and share that is missed."""
        series = self.series(model, self.dent(model, press))
        _, bands = self.depth(model, press, series)
        field = np.tensordot(model.strengths, bands, axes=1)
        miss = press.pattern - np.einsum('tij,tj->ti', model.responses, field).ravel()
        basis = np.linalg.qr(model.common)[0]
        own = miss - basis @ (basis.T @ miss)
        sigma = self.sigma(press)
        size = np.square(sigma) - self.noise**2
        share = float(np.sqrt(max(np.square(own).mean() - self.noise**2, 0.0) / size.mean()))
        return miss, float(np.square(own / sigma).sum()), PRESS_MISSED * share

    def sigma(self, press: KnownPress) -> Array:
        """Deviation of a press's pattern."""
        chips = press.pattern.reshape(-1, 3)
        here = np.square(chips).mean(axis=1)
        share = PRESS_MISSED**2 * (here + 0.05 * here.max())
        return np.repeat(np.sqrt(self.noise**2 + share), 3)

    def made(self, model: SkinModel, outline: Outline, pose: Array) -> KnownPress:
        """A press of usual depth (m) as a model has it."""
        one = KnownPress(outline, pose, np.zeros(model.chips.size), np.ones(3))
        raised = (DEPTH * model.body) ** np.arange(1, 4)
        bands = np.tensordot(raised, self.series(model, self.dent(model, one)), axes=1)
        field = np.tensordot(model.strengths, bands, axes=1)
        return replace(one, pattern=np.einsum('tij,tj->ti', model.responses, field).ravel())
