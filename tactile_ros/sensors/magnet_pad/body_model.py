# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Field of the pad under touches: body, magnets and chips of a config, specimens, fitted response.

A touch is a row of five: place along the axis (m), angle around it from y (rad), logarithm of the
normal force (N), and the tangential force along and around the axis over the normal one. The body
is an incompressible half-space whose base holds it in part (`physics.elastomer`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import least_squares
from scipy.sparse import csr_array

from tactile_ros.estimators.evidence_regression import Moments
from tactile_ros.estimators.model_selection import spread_rows
from tactile_ros.estimators.regression import gaussian
from tactile_ros.physics.elastomer import disc_press
from tactile_ros.physics.fidelity import (
    BLOCK_COST,
    DIPOLE_COST,
    Choice,
    Model,
    Term,
    TermGain,
    choose,
    region,
    term_gains,
)
from tactile_ros.physics.magnetics import EXACT, Blocks, in_chip_axes
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.types import Array, Bools

NOISE, LEAST_NOISE = 4e-6, 1e-7  # T, where nothing states it; below it nothing is gained
LEAST_LOAD = 1e-9  # N
EDGES = (1, 2, 3, 4)  # dipoles along the edge of a block
TIP, BOND = 0.3, 0.5  # radius of a tip over that of the cylinder; share of the base's image
STRAY, WARM = 0.3e-3, 5.0  # T, a component of a stray field in a scene; degrees since the tare
SCENE_LOADS = (0.06, 0.4)  # of shear modulus times the square of the radius
BLOCK = 2048  # touches computed at once
MEASURED = 200  # touches by which a model of the blocks is chosen


def touches_at(place: Array, force: Array) -> Array:
    """Touches (s, 5) at places (s, 3) (m) with forces (s, 3) of the skin on the object (N)."""
    around = np.arctan2(place[:, 2], place[:, 1])
    cosine, sine = np.cos(around), np.sin(around)
    load = np.maximum(cosine * force[:, 1] + sine * force[:, 2], LEAST_LOAD)
    turned = cosine * force[:, 2] - sine * force[:, 1]
    return np.column_stack([place[:, 0], around, np.log(load), force[:, 0] / load, turned / load])


def places_and_forces(touches: Array, radius: float) -> Array:
    """Places (m) and forces (N), shape (s, 6), of touches (s, 5) on a cylinder of `radius`."""
    along, around, load, a, b = touches.T
    cosine, sine, load = np.cos(around), np.sin(around), np.exp(load)
    return np.column_stack([
        along, radius * cosine, radius * sine,
        load * a, load * (cosine - b * sine), load * (sine + b * cosine),
    ])  # fmt: skip


def blocks_of(config: MagnetPadConfig, edge_nodes: int) -> Blocks:
    """Magnets of a pad as so many dipoles along an edge."""
    return Blocks.along(
        config.magnet_positions, config.magnet_axes, config.magnet_size, config.remanence,
        edge_nodes,
    )  # fmt: skip


def movement(
    config: MagnetPadConfig, touches: Array, tip: float | Array = TIP, bond: float | Array = BOND
) -> tuple[Array, Array]:
    """Shifts (m) and turns (rad) of the magnets under touches, shape (s, m, 3) both.

    Tips have a radius `tip` over that of the cylinder, `bond` is the share of the base's image.
    """
    both, every = places_and_forces(touches, config.radius), np.ones(len(touches))
    place, force = both[:, :3], both[:, 3:]
    normal = place * np.array([0.0, 1.0, 1.0]) / config.radius

    def displacement(points: Array) -> Array:
        wide = np.broadcast_to(points, (len(place), *points.shape))
        return disc_press(
            wide, place, normal, -force, tip * config.radius * every, config.shear_modulus,
            bond * every,
        )  # fmt: skip

    return blocks_of(config, 1).carried(displacement)


def change_of_field(
    config: MagnetPadConfig, touches: Array, tip: float | Array = TIP, bond: float | Array = BOND,
    edge_nodes: int = 2,
) -> Array:  # fmt: skip
    """Change of the readings (s, t, 3) (T) in chip axes, from rest to touched."""
    blocks = blocks_of(config, edge_nodes)
    still = np.zeros((1, len(config.magnet_positions), 3))
    level, parts = blocks.field(config.positions, still, still), []
    tips, bonds = (np.broadcast_to(one, len(touches)) for one in (tip, bond))
    for i in range(0, len(touches), BLOCK):
        part = slice(i, i + BLOCK)
        moved, turned = movement(config, touches[part], tips[part], bonds[part])
        parts.append(blocks.field(config.positions, moved, turned) - level)
    return in_chip_axes(np.concatenate(parts), config.rotations)


def uniform_response(config: MagnetPadConfig) -> Array:
    """Change of the readings (3 t, 3) with a uniform field in sensor axes."""
    turns = config.rotations
    turns = np.tile(np.eye(3), (len(config.positions), 1, 1)) if turns is None else turns
    return np.concatenate([turn.T for turn in turns])


# -- fidelity ------------------------------------------------------------------------------------


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
    name = {EXACT: 'exact blocks', 1: 'dipole a block'}.get(
        edge_nodes, f'{dipoles} dipoles a block'
    )
    return Model(name, readings, cost * count * len(config.positions), size=(edge_nodes,))


def field_choice(config: MagnetPadConfig, touches: Array, noise: float) -> Choice:
    """Choose the cheapest model of the blocks that touches need at a noise (T), by some of them.

    Its size is the dipoles along an edge.
    """
    some = touches[:: max(len(touches) // MEASURED, 1)]
    states = np.stack(movement(config, some), axis=1).reshape(len(some), -1)
    models = [block_field(config, n) for n in EDGES]
    return choose(models, block_field(config, EXACT), states, max(noise, LEAST_NOISE))


def scene_touches(config: MagnetPadConfig, count: int = 60) -> Array:
    """Touches along the normal of a usual scene: its corners, then `count` random ones."""
    along, stiff = 0.45 * config.length, config.shear_modulus * config.radius**2
    low = np.array([-along, 0.5, np.log(SCENE_LOADS[0] * stiff), 0.0, 0.0])
    high = np.array([along, np.pi - 0.5, np.log(SCENE_LOADS[1] * stiff), 0.0, 0.0])
    corners = region(low[:3], high[:3], count)
    return np.column_stack([corners, np.zeros((len(corners), 2))])


def terms(config: MagnetPadConfig, noise: float, count: int = 60) -> tuple[TermGain, ...]:
    """Weigh a stray field and the magnets' temperature as unknowns, in place (m)."""
    touches = scene_touches(config, count)[2**3 :]

    def readings(shift: Array) -> Array:
        return change_of_field(config, touches + shift).reshape(len(touches), -1)

    step, radius = 1e-4, config.radius
    # around counts as an arc, so that both coordinates of the place are lengths
    slopes = [
        (readings(step * unit) - readings(-step * unit)) / (2 * step * scale)
        for unit, scale in zip(
            np.diag([radius, 1.0, 1.0, 0.0, 0.0])[:3], (radius, radius, 1.0), strict=True
        )
    ]
    uniform = np.broadcast_to(
        uniform_response(config), (len(touches), 3 * len(config.positions), 3)
    )
    warm = REMANENCE_SLOPE * (rest_field(config).reshape(1, -1) + readings(np.zeros(5)))
    found = (
        Term('uniform stray field', uniform, STRAY),
        Term('temperature of the magnets', warm[..., None], WARM),
    )
    return term_gains(np.stack(slopes, axis=-1), max(noise, LEAST_NOISE), found, wanted=2)


def rest_field(config: MagnetPadConfig) -> Array:
    """Field of the magnets at rest (t, 3) (T) in chip axes."""
    still = np.zeros((1, len(config.magnet_positions), 3))
    field = blocks_of(config, EXACT).field(config.positions, still, still)
    return np.asarray(in_chip_axes(field, config.rotations)[0])


# -- specimens -----------------------------------------------------------------------------------


class Specimens:
    """Readings of pads that differ from a config, by parameters in units of their prior sigma.

    Of all magnets height and remanence; of each its place, axis and remanence; of each chip gains
    and crossed axes; of the body stiffness, stiffening under load (as a whole at `full` (N)), the
    base's hold and the radius of tips. A parameter of 0 is the config's.
    """

    COMMON = ('height', 'remanence', 'shear_modulus', 'stiffening', 'bond', 'tip')
    # logarithms of factors, but of the bond
    SIGMA = np.array([0.05, 0.1, 0.5, 0.3, 0.5, 0.7])
    PLACE, AXIS, STRENGTH = 0.01, 0.03, 0.03  # radii; shares

    def __init__(self, config: MagnetPadConfig, full: float) -> None:
        self.config, self.full, magnets = config, full, len(config.magnet_positions)
        gains = 9 * len(config.positions)
        self.sizes = (len(self.COMMON), 3 * magnets, 3 * magnets, magnets, gains)
        self.count = sum(self.sizes)

    def common(self, parameters: Array) -> dict[str, float]:
        """Factors over the config, logarithm of the stiffening, the base's hold, a tip (radii)."""
        value = dict(zip(self.COMMON, self.SIGMA * parameters[: len(self.COMMON)], strict=True))
        return {
            **{name: float(np.exp(value[name])) for name in self.COMMON[:3]},
            'stiffening': float(value['stiffening']),
            'bond': float(np.clip(BOND + value['bond'], -0.5, 1.5)),
            'tip': TIP * float(np.exp(np.clip(value['tip'], -2.0, 1.0))),
        }

    def __call__(self, touches: Array, parameters: Array, edge_nodes: int = 2) -> Array:
        """Change of the readings (s, 3 t) (T) of a specimen."""
        config, ours = self.config, self.common(parameters)
        _, place, axis, strength, gain = np.split(parameters, np.cumsum(self.sizes[:-1]))
        centres = config.magnet_positions * np.array([1.0, 1.0, ours['height']])
        centres = centres + self.PLACE * config.radius * place.reshape(-1, 3)
        axes = config.magnet_axes / np.linalg.norm(config.magnet_axes, axis=1, keepdims=True)
        axes = axes + self.AXIS * axis.reshape(-1, 3)
        eased, stiff = touches.copy(), config.shear_modulus * ours['shear_modulus']
        eased[:, 2] -= ours['stiffening'] * np.exp(touches[:, 2]) / self.full
        field = np.zeros((len(touches), len(config.positions), 3))
        for centre, own, share in zip(centres, axes, self.STRENGTH * strength, strict=True):
            one = replace(
                config, magnet_positions=centre[None], magnet_axes=own[None], shear_modulus=stiff
            )
            part = change_of_field(one, eased, ours['tip'], ours['bond'], edge_nodes)
            field += ours['remanence'] * np.exp(share) * part
        gains = np.eye(3) + config.gain_spread * gain.reshape(-1, 3, 3)
        seen = np.einsum('tij,stj->sti', gains, field)
        return np.asarray(seen.reshape(len(touches), -1))


# -- response ------------------------------------------------------------------------------------

STEPS = (41, 27)  # nodes along and around
EDGE = 0.99  # largest |y| of a touch, in radii
ROWS, ROUNDS = 240, 6  # touches and steps by which parameters are fitted
RIGHT = 0.02  # of a reading: residual of a specimen's model
LOADS = np.linspace(0.1, 1.4, 6)  # of the largest load, at which the response is tabulated
CENTRES = (20, 14)  # of the residual's kernel
LENGTHS = (0.25, 0.4, 0.7)  # of the residual's kernel, in radii
AMPLITUDES = 10.0 ** np.arange(-0.5, 3.5, 0.5)  # of the residual over the noise
SQUARE = 0.4  # amplitude of the residual's part that is square in the load
LEAST_SHARE = 1e-9  # of the largest eigenvalue


def load_terms(touches: Array, full: float, leaning: bool) -> Array:
    """Monomials (s, j) of loads over `full` (N) and, beside shear, of leanings."""
    load = np.exp(touches[:, 2]) / full
    square = load * load
    parts = [load, square, square * load, square * square]
    if leaning:
        a, b = touches[:, 3:].T
        parts += [load * a, load * b, square * a, square * b]
        parts += [square * a * a, square * b * b, square * a * b]
    return np.stack(parts, axis=-1)


class PadResponse:
    """Change of field of touches, fitted to a recording: a specimen and a smooth residual.

    The specimen (`Specimens`) is the most probable one; what it leaves is a Gaussian process over
    the surface, times the load, its square and leanings, whose length and amplitude have the most
    evidence (Rasmussen and Williams, Gaussian Processes, 2006, ch. 5). Both are tabulated over the
    surface as polynomials of load and leaning.
    """

    def __init__(self, config: MagnetPadConfig, live: Bools, *, leaning: bool) -> None:
        self.config, self.live, self.leaning = config, live, leaning
        least = float(np.arccos(EDGE))
        ends = ((-0.51 * config.length, 0.51 * config.length), (least, np.pi - least))
        self.axes = [np.linspace(*end, n) for end, n in zip(ends, STEPS, strict=True)]
        self.grid = np.stack(np.meshgrid(*self.axes, indexing='ij'), axis=-1).reshape(-1, 2)

    @property
    def report(self) -> dict[str, float]:
        """Parameters that all magnets and all of the body share; see `Specimens.common`."""
        return Specimens(self.config, self.full_).common(self.parameters_)

    def fit(
        self, touches: Array, x: Array, noise: float, start: Array | None = None,
        rounds: int = ROUNDS,
    ) -> PadResponse:  # fmt: skip
        """Fit the specimen to readings x (s, d) (T) of touches, and tabulate it."""
        self.full_ = float(np.exp(touches[:, 2].max()))
        choice = field_choice(self.config, touches, noise)
        self.nodes_, self.choice_ = choice.size[0], choice.report
        pad = Specimens(self.config, self.full_)
        some = spread_rows(np.arange(len(x)), ROWS)
        known, wanted = touches[some], x[some]
        sigma = np.sqrt(noise**2 + RIGHT**2 * (wanted * wanted).mean(axis=1, keepdims=True))

        def residual(parameters: Array) -> Array:
            error = (pad(known, parameters, self.nodes_)[:, self.live] - wanted) / sigma
            return np.concatenate([error.ravel(), parameters])

        start = np.zeros(pad.count) if start is None else start
        self.parameters_ = least_squares(residual, start, max_nfev=rounds, ftol=1e-4).x
        self._tabulate(pad)
        return self

    def _tabulate(self, pad: Specimens) -> None:
        """Coefficients of the loads' monomials over the surface."""
        share, lean = LOADS, np.zeros((len(LOADS), 2))
        if self.leaning:
            angle = np.arange(6) * np.pi / 3
            ring = np.column_stack([np.cos(angle), np.sin(angle)])
            share = np.concatenate([share, np.repeat([0.4, 1.0], 6), np.repeat(0.7, 6)])
            lean = np.concatenate([lean, 0.5 * ring, 1.0 * ring, 1.0 * ring[:, ::-1]])
        kinds = np.column_stack([np.log(self.full_ * share), lean])
        touches = np.column_stack([
            np.repeat(self.grid, len(kinds), axis=0), np.tile(kinds, (len(self.grid), 1)),
        ])  # fmt: skip
        field = pad(touches, self.parameters_, self.nodes_)[:, self.live]
        own = load_terms(touches[: len(kinds)], self.full_, self.leaning)
        field = field.reshape(len(self.grid), len(kinds), -1)
        self.table_ = self._splines(np.einsum('jk,gkd->gjd', np.linalg.pinv(own), field))

    def _splines(self, values: Array) -> Array:
        """Coefficients (g, j, d) of cubic splines through values (g, j, d) on the grid."""
        wide = make_interp_spline(self.axes[0], values.reshape(*STEPS, -1)).c
        wide = make_interp_spline(self.axes[1], wide.swapaxes(0, 1)).c.swapaxes(0, 1)
        return np.ascontiguousarray(wide.reshape(values.shape))

    def _weights(self, place: Array) -> csr_array:
        """Weights (s, g) of the splines' coefficients at places (s, 2), held to the surface."""
        parts = []
        for axis, at in zip(self.axes, place.T, strict=True):
            knots = make_interp_spline(axis, axis).t
            one = BSpline.design_matrix(np.clip(at, axis[0], axis[-1]), knots, 3)
            parts.append((one.indices.reshape(-1, 4), one.data.reshape(-1, 4)))
        (i, u), (j, v) = parts
        index = (i[:, :, None] * STEPS[1] + j[:, None]).reshape(-1)
        ends = 16 * np.arange(len(place) + 1)
        weight = (u[:, :, None] * v[:, None]).reshape(-1)
        return csr_array((weight, index, ends), shape=(len(place), len(self.grid)))

    def __call__(self, touches: Array) -> Array:
        """Change of field (s, d) (T) of touches (s, 5)."""
        own = load_terms(touches, self.full_, self.leaning)
        table = self._weights(touches[:, :2]) @ self.table_.reshape(len(self.grid), -1)
        return np.asarray(np.einsum('sj,sjd->sd', own, table.reshape(*own.shape, -1)))

    def learned(self, residual: ResponseResidual) -> PadResponse:
        """Add the residual of a recording to the table."""
        bumps = residual.bumps(self.grid)
        parts = residual.solve().reshape(len(residual.into), bumps.shape[1], -1)
        added = np.zeros((len(self.grid), *self.table_.shape[1:]))
        for j, part in zip(residual.into, parts, strict=True):
            added[:, j] = bumps @ part
        self.table_ = self.table_ + self._splines(added)
        return self


class ResponseResidual:
    """Readings less a response: a smooth function of the place times parts of the load.

    Touches (s, 5) have readings x (s, d) (T), whose channels have a noise (T).
    """

    def __init__(self, response: PadResponse, touches: Array, x: Array, noise: float) -> None:
        self.response = response
        ends = [np.linspace(a[0], a[-1], n) for a, n in zip(response.axes, CENTRES, strict=True)]
        self.centres = np.stack(np.meshgrid(*ends, indexing='ij'), axis=-1).reshape(-1, 2)
        self.into = (0, 1, 4, 5) if response.leaning else (0, 1)
        self.sizes = np.where(np.array(self.into) == 1, SQUARE, 1.0)
        own = load_terms(touches, response.full_, response.leaning)[:, self.into] * self.sizes
        self.error = x - response(touches)
        # what differs from touch to touch grows with their readings
        share = np.sqrt((self.error**2).mean() / max(float((x**2).mean()), 1e-300))
        self.weight = noise**2 / (noise**2 + (0.1 * share) ** 2 * (x * x).mean(axis=1))
        best = -np.inf
        for length in LENGTHS:
            mixing = self._mixing(length)
            bumps = self._kernel(touches[:, :2], length) @ mixing
            terms = (own[:, :, None] * bumps[:, None]).reshape(len(x), -1)
            moments = Moments.of(terms, self.error, self.weight)
            for amplitude in AMPLITUDES.tolist():
                spread = np.full(terms.shape[1], amplitude)
                likely = moments.evidence(spread)[0]
                if likely > best:
                    best, self.length, self.mixing = likely, length, mixing
                    self.moments, self.spread = moments, spread

    def _kernel(self, place: Array, length: float) -> Array:
        """Kernel (s, n) of places (s, 2) (m, rad) and centres over the surface."""
        unit = np.array([1 / self.response.config.radius, 1.0]) / length
        return gaussian(place * unit, self.centres * unit)

    def _mixing(self, length: float) -> Array:
        """Combinations (n, p) of the kernel's bumps that are independent a priori."""
        value, vector = np.linalg.eigh(self._kernel(self.centres, length))
        kept = value > LEAST_SHARE * value[-1]
        return np.asarray(vector[:, kept] / np.sqrt(value[kept]))

    def bumps(self, place: Array) -> Array:
        """Smooth functions (s, p) of places (s, 2) (m, rad), independent a priori."""
        return np.asarray(self._kernel(place, self.length) @ self.mixing)

    def solve(self) -> Array:
        """Most probable coefficients (p, d)."""
        weights = self.moments.solve(self.spread)[0]
        sizes = np.repeat(self.sizes, len(weights) // len(self.sizes))
        return np.asarray(sizes[:, None] * weights)
