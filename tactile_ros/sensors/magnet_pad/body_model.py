"""Field of the pad under touches: nominal body, fitted response, and its residual.

Gaussian bumps over the unrolled surface, times the load and its square (and its tangential parts,
where touches lean), with a prior whose width and size the evidence chooses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

from tactile_ros.estimators.kernel_ridge import gaussian
from tactile_ros.estimators.smooth_fields import Moments
from tactile_ros.physics.elastomer import disc_press
from tactile_ros.physics.fidelity import (
    BLOCK_COST,
    DIPOLE_COST,
    Choice,
    Model,
    Term,
    Worth,
    choose,
    region,
    worth,
)
from tactile_ros.physics.magnetics import EXACT, Blocks, in_chip_axes
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from tactile_ros.physics.fidelity import Choice
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig

EDGES = (1, 2, 3, 4)


def blocks_of(config: MagnetPadConfig, edge_nodes: int) -> Blocks:
    """Magnets of a pad as so many dipoles along an edge."""
    return Blocks.along(
        config.magnet_positions,
        config.magnet_axes,
        config.magnet_size,
        config.remanence,
        edge_nodes,
    )


def block_field(config: MagnetPadConfig, edge_nodes: int) -> Model:
    """Change of the readings (s, n) from states (s, 6 m) of m magnets: shifts (m), turns (rad)."""
    blocks, count = blocks_of(config, edge_nodes), len(config.magnet_positions)
    still = np.zeros((1, count, 3))
    level = blocks.field(config.positions, still, still)

    def readings(states: Array) -> Array:
        moved, turned = states.reshape(len(states), 2, count, 3).transpose(1, 0, 2, 3)
        change = blocks.field(config.positions, moved, turned) - level
        return in_chip_axes(change, config.rotations).reshape(len(states), -1)

    dipoles = edge_nodes**3
    cost = BLOCK_COST if edge_nodes == EXACT else DIPOLE_COST * dipoles
    named = {EXACT: 'exact blocks', 1: 'dipole a block'}
    name = named.get(edge_nodes, f'{dipoles} dipoles a block')
    pairs = count * len(config.positions)
    return Model(name, readings, cost * pairs, size=(edge_nodes,))


def block_model(
    config: MagnetPadConfig, noise: float, moved: Array, turned: Array, *, every: bool = False
) -> Choice:
    """The cheapest model of the blocks; its size is the dipoles along an edge.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.
    noise : float
        Of a reading (T).
    moved, turned : ndarray, shape (s, m, 3)
        Shifts (m) and turns (rad) of the magnets in the scene; some hundreds.
    every : bool
        Measure all models.

    Returns
    -------
    Choice
        `choice.size[0]` is what `Blocks` takes as `edge_nodes`.
    """
    states = np.stack([moved, turned], axis=1).reshape(len(moved), -1)
    models = [block_field(config, n) for n in EDGES]
    return choose(models, block_field(config, EXACT), states, noise, every=every)


SEED = 20191112
LOADS = (0.01, 0.6)  # of shear modulus times the square of the radius
TIPS = (0.05, 0.7)  # radius of a tip over that of the cylinder
LEAN = 0.5  # rad, largest of a leaning touch
UPRIGHT = 0.75  # share of touches that do not lean
BLOCK = 2048
MEASURED = 200  # touches by which a model of the blocks is chosen
NOISE, LEAST_NOISE = 4e-6, 1e-7  # T, where nothing tells it; below it nothing is gained


@dataclass(frozen=True)
class Presses:
    """Touches of the half cylinder."""

    # (s,) place along the axis (m), and angle from y (rad)
    along: Array
    around: Array
    force: Array  # (s, 3) what the skin exerts on the object (N)
    # (s,) radius of the contact (m); share of the base's image
    tip: Array
    bond: Array

    @property
    def normals(self) -> Array:
        """Outward normals, shape (s, 3)."""
        zero = np.zeros_like(self.around)
        return np.column_stack([zero, np.cos(self.around), np.sin(self.around)])

    @property
    def size(self) -> Array:
        """Of the force, shape (s,) (N)."""
        return np.asarray(np.linalg.norm(self.force, axis=1))

    def rows(self, part: slice) -> Presses:
        """Some of them."""
        return Presses(
            self.along[part], self.around[part], self.force[part], self.tip[part], self.bond[part]
        )

    def turned(self, angle: float) -> Presses:
        """The same a little further around (rad), forces with their places."""
        cosine, sine = np.cos(angle), np.sin(angle)
        force = self.force.copy()
        force[:, 1] = cosine * self.force[:, 1] - sine * self.force[:, 2]
        force[:, 2] = sine * self.force[:, 1] + cosine * self.force[:, 2]
        return replace(self, around=self.around + angle, force=force)

    def places(self, radius: float) -> Array:
        """Contacts on a cylinder of `radius`, shape (s, 3) (m)."""
        places = radius * self.normals
        places[:, 0] = self.along
        return places


def uniform_response(config: MagnetPadConfig) -> Array:
    """What a uniform field adds to the readings (3 t, 3), in sensor axes."""
    turns = config.rotations
    turned = np.tile(np.eye(3), (len(config.positions), 1, 1)) if turns is None else turns
    return np.concatenate([turn.T for turn in turned])


def spread_presses(config: MagnetPadConfig, count: int, seed: int = SEED) -> Presses:
    """Touches of all kinds over the whole pad, the same for the same config and seed."""
    rng = np.random.default_rng(seed)
    along = config.length * (rng.uniform(size=count) - 0.5)
    across = rng.uniform(-1, 1, count)
    around = np.arccos(0.98 * across)
    low, high = np.log(LOADS)
    size = np.exp(rng.uniform(low, high, count)) * config.shear_modulus * config.radius**2
    lean = LEAN * rng.uniform(size=count) * (rng.uniform(size=count) > UPRIGHT)
    turn = rng.uniform(0, 2 * np.pi, count)
    zero = np.zeros(count)
    normal = np.column_stack([zero, np.cos(around), np.sin(around)])
    tangent = np.column_stack([zero, -np.sin(around), np.cos(around)])
    sideways = np.cos(turn)[:, None] * np.eye(3)[0] + np.sin(turn)[:, None] * tangent
    direction = np.cos(lean)[:, None] * normal + np.sin(lean)[:, None] * sideways
    tip = config.radius * rng.uniform(*TIPS, count)
    bond = np.clip(rng.uniform(-0.8, 1.6, count), 0.0, 1.0)
    return Presses(along, around, size[:, None] * direction, tip, bond)


def change_of_field(config: MagnetPadConfig, presses: Presses, edge_nodes: int = 2) -> Array:
    """Change of the readings (s, t, 3) (T) in chip axes, from rest to touched."""
    blocks = blocks_of(config, edge_nodes)
    rest = np.zeros((1, len(config.magnet_positions), 3))
    level = blocks.field(config.positions, rest, rest)
    parts = []
    for i in range(0, len(presses.along), BLOCK):
        moved, turned = movement(config, presses.rows(slice(i, i + BLOCK)))
        parts.append(blocks.field(config.positions, moved, turned) - level)
    return in_chip_axes(np.concatenate(parts), config.rotations)


def field_choice(config: MagnetPadConfig, presses: Presses, noise: float) -> Choice:
    """Model of the blocks that touches need at a noise (T), by some of them."""
    some = slice(0, None, max(len(presses.along) // MEASURED, 1))
    moved, turned = movement(config, presses.rows(some))
    return block_model(config, max(noise, LEAST_NOISE), moved, turned)


def nominal_choice(config: MagnetPadConfig) -> Choice:
    """Model of the blocks that the nominal touches need at the config's noise."""
    noise = NOISE if config.noise is None else float(np.min(config.noise))
    return field_choice(config, spread_presses(config, MEASURED), noise)


def movement(config: MagnetPadConfig, presses: Presses) -> tuple[Array, Array]:
    """Shifts (m) and turns (rad) of the magnets under touches, shape (s, m, 3) both."""
    places, normals = presses.places(config.radius), presses.normals

    def displacement(points: Array) -> Array:
        wide = np.broadcast_to(points, (len(places), *points.shape))
        return disc_press(
            wide, places, normals, -presses.force, presses.tip, config.shear_modulus, presses.bond
        )

    return blocks_of(config, 1).carried(displacement)


SCENE_LOADS, TIP, BOND = (0.06, 0.4), 0.3, 0.5
ALONG, AROUND = 0.45, 0.5  # of the length; rad from the base
STRAY = 0.3e-3  # T, of one component of stray fields in a scene that has them
WARM = 5.0  # degrees from the temperature of the tare
COUNT = 60


def touches_of(config: MagnetPadConfig, count: int = COUNT) -> Array:
    """Touches of the scene: along (m), around (rad), force (N), shape (s, 3)."""
    reach, stiff = ALONG * config.length, config.shear_modulus * config.radius**2
    low = np.array([-reach, AROUND, SCENE_LOADS[0] * stiff])
    return region(low, np.array([reach, np.pi - AROUND, SCENE_LOADS[1] * stiff]), count)


def by_tip(config: MagnetPadConfig, place: Array, force: Array) -> Presses:
    """Touches at places (s, 3) (m) on the surface, with forces (s, 3) (N), by the scene's tip."""
    around, same = np.arctan2(place[:, 2], place[:, 1]), np.ones(len(place))
    return Presses(place[:, 0], around, force, TIP * config.radius * same, BOND * same)


def upright(config: MagnetPadConfig, touches: Array) -> Presses:
    """Touches (s, 3) of the scene."""
    along, around, force = touches.T
    normal = np.column_stack([0 * along, np.cos(around), np.sin(around)])
    place = config.radius * normal + along[:, None] * np.eye(3)[0]
    return by_tip(config, place, force[:, None] * normal)


def readings_of(config: MagnetPadConfig, touches: Array) -> Array:
    """Changes (s, n) (T) of touches (s, 3)."""
    return change_of_field(config, upright(config, touches)).reshape(len(touches), -1)


def terms(config: MagnetPadConfig, noise: float, count: int = COUNT) -> tuple[Worth, ...]:
    """What each term costs and buys, in place (m), at a noise (T)."""
    touches = touches_of(config, count)[2**3 :]
    radius, load = config.radius, float(touches[:, 2].mean())
    steps = np.array([1e-4 * radius, 1e-4, 1e-3 * load])
    # around counts as an arc, so that both coordinates of the place are lengths
    units = np.array([1e-4 * radius, 1e-4 * radius, 1e-3])
    slopes = [
        (readings_of(config, touches + step) - readings_of(config, touches - step)) / (2 * unit)
        for step, unit in zip(np.diag(steps), units, strict=True)
    ]
    taxels = len(config.positions)
    turns = np.tile(np.eye(3), (taxels, 1, 1)) if config.rotations is None else config.rotations
    even = np.concatenate([turn.T for turn in turns])
    still = np.zeros((1, len(config.magnet_positions), 3))
    level = blocks_of(config, 2).field(config.positions, still, still)
    level = np.einsum('tji,stj->sti', turns, level).reshape(1, -1)
    warm = REMANENCE_SLOPE * (level + readings_of(config, touches))
    return worth(
        np.stack(slopes, axis=-1),
        max(noise, LEAST_NOISE),
        (
            Term('uniform stray field', np.broadcast_to(even, (len(touches), *even.shape)), STRAY),
            Term('temperature of the magnets', warm[..., None], WARM),
        ),
        wanted=2,
    )


STEPS = (41, 27)  # along and around
EDGE = 0.98  # largest |y| of a touch, in radii
FITTED = ('height', 'along', 'remanence', 'shear_modulus', 'bond', 'tip', 'stiffening')
# of their logarithms, along in radii
UNSURE = np.array([0.05, 0.02, 0.1, 0.5, 0.5, 0.7, 0.2])
ROWS, ROUNDS = 240, 6


@dataclass(frozen=True)
class PadTouches:
    """Touches in the coordinates of the surface."""

    # (s,) place along the axis (m), and angle from y (rad)
    along: Array
    around: Array
    load: Array  # (s,) normal force (N)
    lean: Array  # (s, 2) tangential force along the axis and around it, over the normal one

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


def load_terms(load: Array, lean: Array, wide: bool) -> Array:
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
    """

    choice_: Choice  # model of the blocks that the touches need
    found_: Array  # (7,) what was found of `FITTED`, in units of `UNSURE`
    full_: float  # load that counts as 1 (N)
    table_: Array  # (j, d, 41, 27) coefficients over the surface (T)
    doubt_: Array  # (3, 41, 27) their variance (T2); see `ResponseResidual.doubt`

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
        solve = np.linalg.pinv(load_terms(share, lean, self.leaning))
        table = np.einsum('js,gsd->jdg', solve, seen)
        return np.ascontiguousarray(table.reshape(*table.shape[:2], *STEPS))

    def learn(self, rows: Bools, lacks: ResponseResidual) -> PadResponse:
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
        own = load_terms(load, lean, self.leaning)
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
                shift = load_terms(load, lean + step, True) - load_terms(load, lean - step, True)
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


CENTRES = (14, 10)
REACHES = (0.35, 0.6, 1.0)  # radii
LEAST_SHARE = 1e-9
SQUARE = 0.4  # of the part that is square in the load
AMPLITUDES = tuple(10.0**power for power in np.arange(-0.5, 4.0, 0.5))


class ResponseResidual:
    """What recorded touches differ by from the model: bumps over the surface, times the load.

    Parameters
    ----------
    response : PadResponse
        Of the model.
    touches : PadTouches
        Recorded (s).
    x : ndarray, shape (s, d)
        Their readings (T).
    noise : float
        Of a channel (T).

    Attributes
    ----------
    into : tuple of int
        Monomials of the load that bumps are added to.
    """

    def __init__(self, response: PadResponse, touches: PadTouches, x: Array, noise: float) -> None:
        self.radius = response.config.radius
        ends = [np.linspace(side[0], side[-1], n) for side, n in
                zip((response.along, response.around), CENTRES, strict=True)]  # fmt: skip
        self.centres = np.stack(np.meshgrid(*ends, indexing='ij'), axis=-1).reshape(-1, 2)
        self.into = (0, 1, 4, 5) if response.leaning else (0, 1)
        load = touches.load / response.full_
        loads = [load, SQUARE * load**2]
        if response.leaning:
            loads += [load * lean for lean in touches.lean.T]
        self.error = x - response(touches)
        # what differs from touch to touch grows with them
        spread = np.sqrt((self.error**2).mean() / max(float((x**2).mean()), 1e-300))
        self.weight = noise**2 / (noise**2 + (0.1 * spread) ** 2 * (x * x).mean(axis=1))
        place = np.column_stack([touches.along, touches.around])
        best = -np.inf
        for reach in REACHES:
            mixing = self._mixing(reach)
            bumps = self._kernel(place, reach) @ mixing
            own = np.concatenate([bumps * one[:, None] for one in loads], axis=1)
            moments = Moments.of(own, self.error, self.weight)
            for amplitude in AMPLITUDES:
                found = moments.evidence(np.full(own.shape[1], amplitude))
                if found > best:
                    best, self.reach, self.mixing = found, reach, mixing
                    self.amplitude, self.terms = amplitude, own

    def _kernel(self, place: Array, reach: float) -> Array:
        """Bumps (s, n) around the centres at places (s, 2) (m, rad)."""
        unit = np.array([1 / self.radius, 1.0]) / reach
        return gaussian(place * unit, self.centres * unit)

    def _mixing(self, reach: float) -> Array:
        value, vector = np.linalg.eigh(self._kernel(self.centres, reach))
        kept = value > LEAST_SHARE * value[-1]
        return np.asarray(vector[:, kept] / np.sqrt(value[kept]))

    def bumps(self, place: Array) -> Array:
        """Smooth functions (s, p) of places (s, 2) (m, rad)."""
        return np.asarray(self._kernel(place, self.reach) @ self.mixing)

    def doubt(self, place: Array) -> Array:
        """Variance (3, g) (T2) of what was last solved at places (g, 2) (m, rad).

        Of the parts linear and square in the load, and twice their covariance.
        """
        bumps = self.bumps(place)
        count = bumps.shape[1]
        one = bumps @ self.root[:, :count].T
        two = SQUARE * bumps @ self.root[:, count : 2 * count].T
        return np.stack(
            [(one * one).sum(axis=1), (two * two).sum(axis=1), 2 * (one * two).sum(axis=1)]
        )

    def solve(self, rows: Bools) -> Array:
        """Weights (l, d, p) of the bumps for each monomial, learned from some rows (s,)."""
        moments = Moments.of(self.terms[rows], self.error[rows], self.weight[rows])
        weights, root, noise = moments.solve(np.full(self.terms.shape[1], self.amplitude))
        self.root = noise * root
        split = weights.reshape(len(self.into), -1, weights.shape[1]).transpose(0, 2, 1)
        split = split.copy()
        split[1] *= SQUARE
        return split
