"""How the pad answers a touch: the nominal model fitted to a recording, and what it lacks.

The change of field of a touch is a polynomial of its load whose coefficients lie in a table over
the surface. The table is that of the nominal model (`nominal`) with height, remanence, stiffness,
hold of the base and width of the tip fitted to touches with truth; what recorded touches still
differ by is a smooth function of the place, linear and square in the load, found by the evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

from tactile_ros.sensors.magnet_pad.nominal import Presses, change_of_field, field_choice
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from tactile_ros.physics.fidelity import Choice
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.sensors.magnet_pad.lacks import Lacks

STEPS = (41, 27)  # along and around
EDGE = 0.98  # largest |y| of a touch, in radii
FITTED = ('height', 'along', 'remanence', 'shear_modulus', 'bond', 'tip', 'stiffening')
# of their logarithms, along in radii
UNSURE = np.array([0.05, 0.02, 0.1, 0.5, 0.5, 0.7, 0.2])
ROWS, ROUNDS = 240, 6


@dataclass(frozen=True)
class PadTouches:
    """Touches in the coordinates of the surface.

    Attributes
    ----------
    along, around : ndarray, shape (s,)
        Place along the axis (m), and angle from y (rad).
    load : ndarray, shape (s,)
        Normal force (N).
    lean : ndarray, shape (s, 2)
        Tangential force along the axis and around it, over the normal one.
    """

    along: Array
    around: Array
    load: Array
    lean: Array

    @classmethod
    def told(cls, place: Array, force: Array) -> PadTouches:
        """From places (s, 3) (m) and forces (s, 3) (N)."""
        around = np.arctan2(place[:, 2], place[:, 1])
        cosine, sine = np.cos(around), np.sin(around)
        load = np.maximum(cosine * force[:, 1] + sine * force[:, 2], 1e-9)
        turned = cosine * force[:, 2] - sine * force[:, 1]
        return cls(
            place[:, 0], around, load, np.column_stack([force[:, 0], turned]) / load[:, None]
        )

    def take(self, rows: Integers) -> PadTouches:
        """Some of them."""
        return PadTouches(self.along[rows], self.around[rows], self.load[rows], self.lean[rows])

    def presses(self, tip: float, bond: float) -> Presses:
        """As the nominal model takes them, all by tips of a radius (m) on one kind of base."""
        cosine, sine = np.cos(self.around), np.sin(self.around)
        force = np.column_stack([self.lean[:, 0], cosine, sine])
        force[:, 1] -= sine * self.lean[:, 1]
        force[:, 2] += cosine * self.lean[:, 1]
        same = np.ones(len(self.load))
        return Presses(
            self.along, self.around, self.load[:, None] * force, tip * same, bond * same
        )


def terms(load: Array, lean: Array, wide: bool) -> Array:
    """Monomials (s, j) of a load in units of the largest; beside shear, `wide`, with leanings."""
    parts = [load, load**2, load**3, load**4]
    if wide:
        a, b = lean.T
        square = load**2
        parts += [load * a, load * b, square * a, square * b]
        parts += [square * a * a, square * b * b, square * a * b]
    return np.stack(parts, axis=-1)


class PadResponse:
    """Change of field of touches, fitted to a recording.

    Parameters
    ----------
    config : MagnetPadConfig
        Where the fit starts.
    leaning : bool
        Whether touches lean.
    live : ndarray of bool, shape (d,)
        Channels that are alive, which are the features.

    Attributes
    ----------
    choice_ : Choice
        Model of the blocks that the touches need.
    found_ : ndarray, shape (7,)
        What was found of `FITTED`, in units of `UNSURE`.
    full_ : float
        Load that counts as 1 (N).
    table_ : ndarray, shape (j, d, 41, 27)
        Coefficients over the surface (T).
    doubt_ : ndarray, shape (3, 41, 27)
        Their variance (T2); see `Lacks.doubt`.
    """

    choice_: Choice
    found_: Array
    full_: float
    table_: Array
    doubt_: Array

    def __init__(self, config: MagnetPadConfig, live: Bools, *, leaning: bool) -> None:
        self.config = config
        self.live = live
        self.leaning = leaning
        self.along = np.linspace(-0.5, 0.5, STEPS[0]) * config.length
        least = float(np.arccos(EDGE))
        self.around = np.linspace(least, np.pi - least, STEPS[1])

    @property
    def report(self) -> dict[str, float]:
        """What was found beside the config: factors, the base's hold (1) and the tip (m).

        Of the stiffening, the logarithm by which the largest load moves less than its share.
        """
        value = self.found_ * UNSURE
        return {
            'height': float(np.exp(value[0])),
            'along': float(self.config.radius * value[1]),
            'remanence': float(np.exp(value[2])),
            'shear_modulus': float(np.exp(value[3])),
            'bond': self._bond(self.found_),
            'tip': self._tip(self.found_),
            'stiffening': float(value[6]),
        }

    def _bond(self, found: Array) -> float:
        return float(np.clip(0.5 + UNSURE[4] * found[4], -0.5, 1.5))

    def _tip(self, found: Array) -> float:
        return float(0.3 * self.config.radius * np.exp(np.clip(UNSURE[5] * found[5], -2, 1)))

    def _model(self, touches: PadTouches, found: Array) -> Array:
        """Change of field (s, d) (T) of the nominal model."""
        config, value = self.config, found * UNSURE
        magnets = config.magnet_positions * np.array([1, 1, np.exp(value[0])])
        magnets = magnets + np.array([config.radius * value[1], 0, 0])
        config = replace(
            config,
            magnet_positions=magnets,
            remanence=min(config.remanence * float(np.exp(value[2])), 2.0),
            shear_modulus=config.shear_modulus * float(np.exp(value[3])),
        )
        # to the first order, whatever makes the body stiffer under load
        eased = touches.load * np.exp(-value[6] * touches.load / self.full_)
        presses = replace(touches, load=eased).presses(self._tip(found), self._bond(found))
        field = change_of_field(config, presses, self.choice_.size[0])
        return field.reshape(len(touches.load), -1)[:, self.live]

    def fit(self, touches: PadTouches, x: Array, noise: float) -> PadResponse:
        """Fit the model to readings x (s, d) (T) of touches, and tabulate it."""
        self.full_ = float(touches.load.max())
        still = np.zeros(len(UNSURE))
        presses = touches.presses(self._tip(still), self._bond(still))
        self.choice_ = field_choice(self.config, presses, noise)
        some = np.unique(np.linspace(0, len(x) - 1, min(len(x), ROWS)).astype(int))
        self.found_ = self._descend(touches.take(some), x[some], noise)
        self.table_ = self._tabulate()
        return self

    def _descend(self, touches: PadTouches, x: Array, noise: float) -> Array:
        """Damped Gauss-Newton steps on `FITTED`, with their prior."""
        found, least, damping = np.zeros(len(UNSURE)), np.inf, 1e-2
        trial = found
        # a model without all that moves the pad is right to some per cent
        sigma = np.sqrt(noise**2 + 0.03**2 * (x * x).mean())
        for _ in range(ROUNDS):
            error = (x - self._model(touches, trial)) / sigma
            cost = float((error**2).sum() + trial @ trial)
            if cost < least:
                found, least, damping = trial, cost, 0.2 * damping
                slopes = np.stack(
                    [
                        (self._model(touches, found + step) - x) / sigma + error
                        for step in 0.02 * np.eye(len(found))
                    ]
                ) / 0.02  # fmt: skip
                flat = slopes.reshape(len(found), -1)
                normal, pull = flat @ flat.T + np.eye(len(found)), flat @ error.ravel() - found
            else:
                damping *= 10
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull)
            trial = np.clip(found + step, -3.0, 3.0)
        return found

    def _tabulate(self) -> Array:
        """Coefficients of the loads' monomials over the surface."""
        share = np.linspace(0.1, 1.4, 6)
        lean = np.zeros((len(share), 2))
        if self.leaning:
            angle = np.arange(6) * np.pi / 3
            ring = np.column_stack([np.cos(angle), np.sin(angle)])
            share = np.concatenate([share, np.repeat([0.4, 1.0], 6), np.repeat(0.7, 6)])
            lean = np.concatenate([lean, 0.5 * ring, 1.0 * ring, 1.0 * ring[:, ::-1]])
        grid = np.stack(np.meshgrid(self.along, self.around, indexing='ij'), axis=-1)
        place = np.repeat(grid.reshape(-1, 2), len(share), axis=0)
        count = len(place) // len(share)
        touches = PadTouches(
            place[:, 0], place[:, 1], self.full_ * np.tile(share, count), np.tile(lean, (count, 1))
        )
        seen = self._model(touches, self.found_).reshape(count, len(share), -1)
        solve = np.linalg.pinv(terms(share, lean, self.leaning))
        table = np.einsum('js,gsd->jdg', solve, seen)
        return np.ascontiguousarray(table.reshape(*table.shape[:2], *STEPS))

    def learn(self, rows: Bools, lacks: Lacks) -> PadResponse:
        """The same with what some rows of a recording say that the model lacks."""
        grid = np.stack(np.meshgrid(self.along, self.around, indexing='ij'), axis=-1)
        added = lacks.solve(rows) @ lacks.bumps(grid.reshape(-1, 2)).T
        richer = PadResponse(self.config, self.live, leaning=self.leaning)
        richer.choice_ = self.choice_
        richer.found_, richer.full_ = self.found_, self.full_
        richer.table_ = self.table_.copy()
        richer.doubt_ = lacks.doubt(grid.reshape(-1, 2)).reshape(3, *STEPS)
        for part, into in zip(added, lacks.into, strict=True):
            richer.table_[into] += part.reshape(-1, *STEPS)
        return richer

    def __call__(self, touches: PadTouches) -> Array:
        """Change of field (s, d) (T)."""
        return self.near(touches, slopes=False)[0]

    def doubt(self, touches: PadTouches) -> Array:
        """Variance (s,) (T2) of a reading, by how few touches told what the model lacks."""
        x = np.clip(touches.along, self.along[0], self.along[-1])
        y = np.clip(touches.around, self.around[0], self.around[-1])
        one, two, both = (
            RectBivariateSpline(self.along, self.around, part, kx=1, ky=1).ev(x, y)
            for part in self.doubt_
        )
        load = touches.load / self.full_
        return np.asarray(np.maximum(load**2 * (one + load * (both + load * two)), 0.0))

    def near(self, touches: PadTouches, *, slopes: bool = True) -> tuple[Array, Array]:
        """Change of field (s, d) (T), and how it changes.

        Returns
        -------
        readings : ndarray, shape (s, d)
            (T).
        slopes : ndarray, shape (s, d, 3 or 5)
            Along the axis (T / m), around it (T / rad), with the logarithm of the load (T), and
            with the leanings (T) where touches lean.
        """
        load, lean = touches.load / self.full_, touches.lean
        own = terms(load, lean, self.leaning)
        table = self._spread(touches, 0, 0)
        readings = np.einsum('sj,sjd->sd', own, table)
        if not slopes:
            return readings, np.empty((len(load), 0, 0))
        parts = [
            np.einsum('sj,sjd->sd', own, self._spread(touches, *order))
            for order in ((1, 0), (0, 1))
        ]
        harder = np.array([1, 2, 3, 4, 1, 1, 2, 2, 2, 2, 2])[: own.shape[1]]
        parts.append(np.einsum('sj,sjd->sd', own * harder, table))
        if self.leaning:
            for i in range(2):
                step = np.zeros(2)
                step[i] = 1e-4
                shift = terms(load, lean + step, True) - terms(load, lean - step, True)
                parts.append(np.einsum('sj,sjd->sd', shift / 2e-4, table))
        return readings, np.stack(parts, axis=-1)

    def _spread(self, touches: PadTouches, dx: int, dy: int) -> Array:
        """Coefficients (s, j, d) at touches, or their derivatives."""
        x = np.clip(touches.along, self.along[0], self.along[-1])
        y = np.clip(touches.around, self.around[0], self.around[-1])
        flat = self.table_.reshape(-1, *STEPS)
        found = np.empty((len(x), len(flat)))
        for i, surface in enumerate(flat):
            found[:, i] = RectBivariateSpline(self.along, self.around, surface).ev(x, y, dx, dy)
        return found.reshape(len(x), *self.table_.shape[:2])
