# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Conditions 1 and 2 of [2], the least force in every cell, remedies, and the fewest parts.

The mechanics are the nominal ones, half held by the base; cells are those of the config. The
search spaces magnets and chips evenly along the axis and looks for the stiffness at which the
least force is felt in every cell and the largest one saturates no chip. Both conditions are
necessary, not sufficient: the bound of a place says whether readings tell where it is.

example:
  tactile design magnet_pad --force 0.5
  tactile design magnet_pad --tip 1 --magnets 5 --chips 3 --json
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from tactile_ros.sensors.magnet_pad.body_model import (
    NOISE,
    change_of_field,
    rest_field,
    touches_at,
)
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.types import Array, Integers, Table

LOADS = np.geomspace(0.02, 30.0, 28)  # N


@dataclass(frozen=True)
class Requirements:
    """Requirements of a pad.

    Condition 1: at rest every chip reads more than it can measure at least and less than it
    saturates at, and under the largest force none saturates ([2] asks it of one chip; a saturated
    chip says nothing). Condition 2: in every cell the least force changes the field at one chip at
    least, in norm, by more than it resolves.
    """

    # least and largest force along the normal (N)
    force: float = 1.5
    largest: float = 10.0
    tip: float = 3e-3  # radius of what touches (m)
    # least field that a chip measures, and least change that it resolves (T)
    least_field: float = 10e-6
    resolution: float = 20e-6


def changes(config: MagnetPadConfig, required: Requirements, loads: Array) -> Array:
    """Change of the readings (n, l, t, 3) (T) in every cell under loads (l,) (N)."""
    normal = config.cells * np.array([0.0, 1.0, 1.0]) / config.radius
    force = (normal[:, None] * loads[:, None]).reshape(-1, 3)
    touches = touches_at(np.repeat(config.cells, len(loads), axis=0), force)
    seen = change_of_field(config, touches, required.tip / config.radius)
    return seen.reshape(len(config.cells), len(loads), *seen.shape[1:])


def least_forces(config: MagnetPadConfig, required: Requirements) -> Array:
    """Least force (n,) (N) in each cell that some chip resolves; inf: none up to 30 N."""
    size = np.linalg.norm(changes(config, required, LOADS), axis=3).max(axis=2)
    size = np.maximum.accumulate(size, axis=1)
    found = np.full(len(size), np.inf)
    for i, row in enumerate(size):
        if row[-1] > required.resolution:
            rising = np.log(np.maximum(row, 1e-15)) + 1e-12 * np.arange(len(row))
            found[i] = np.exp(np.interp(np.log(required.resolution), rising, np.log(LOADS)))
    return found


def loudest(config: MagnetPadConfig, required: Requirements) -> tuple[Array, Array]:
    """Largest reading (t, 3) (T), at rest or under the largest force, and the range (3,)."""
    loads = required.largest * np.array([0.0, 0.5, 1.0])
    most = np.abs(rest_field(config) + changes(config, required, loads)).max(axis=(0, 1))
    limit = np.inf if config.saturation is None else np.asarray(config.saturation, float)
    return most, np.broadcast_to(limit, (3,))


def quiet_enough(config: MagnetPadConfig, required: Requirements) -> Array:
    """Chips (t,) for which condition 1 holds."""
    most, limit = loudest(config, required)
    rest = np.linalg.norm(rest_field(config), axis=1)
    return np.asarray((rest > required.least_field) & (most < limit).all(axis=1))


def place_bound(config: MagnetPadConfig, required: Requirements, noise: float) -> float:
    """Mean standard deviation (m) of a place at the geometric mean of the loads.

    Cramer and Rao with place and load unknown; infinite where readings do not tell them.
    """
    load, step = np.sqrt(required.force * required.largest), 1e-3
    normal = config.cells * np.array([0.0, 1.0, 1.0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    level = touches_at(config.cells, load * normal)
    tip = required.tip / config.radius
    start = change_of_field(config, level, tip)
    slopes = np.stack([
        (change_of_field(config, level + step * unit, tip) - start) / step
        for unit in np.diag([config.radius, 1.0, 1.0, 0.0, 0.0])[:3]
    ], axis=-1).reshape(len(level), -1, 3) / noise  # fmt: skip
    inner = np.matmul(slopes.transpose(0, 2, 1), slopes)
    if not (np.linalg.cond(inner) < 1e16).all():
        return np.inf
    cov = np.linalg.inv(inner)
    return config.radius * float(np.sqrt(cov[:, 0, 0] + cov[:, 1, 1]).mean())


MOST = 0.5  # share of the cells that feel too little, from which the body is too stiff
BLOCK = 3  # adjacent cells that make a block
MARGIN = 0.95


@dataclass(frozen=True)
class Remedy:
    """A change of the pad.

    Where most cells feel too little, the body is too stiff; a few cells of their own need a magnet
    near them; a block of adjacent cells needs a chip near it.
    """

    # which of the three, what it answers to, and what is changed
    what: str
    why: str
    change: str
    config: MagnetPadConfig  # the pad with it


def stiffest(config: MagnetPadConfig, required: Requirements) -> float:
    """Largest shear modulus (Pa) at which every cell feels the least force; 0: none.

    Displacements depend on force over modulus alone, so that the least force grows with it.
    """
    most = float(least_forces(config, required).max())
    return MARGIN * config.shear_modulus * required.force / most if np.isfinite(most) else 0.0


def blocks(cells: Array, weak: Integers) -> list[Integers]:
    """Sets of adjacent cells among the weak ones, centres (n, 3) (m), largest first."""
    if not len(weak):
        return []
    plan = cells[:, :2]
    x, y = (np.diff(np.unique(np.round(axis, 6))) for axis in plan.T)
    step = np.array([x.min() if len(x) else 1.0, y.min() if len(y) else 1.0])
    near = cdist(plan[weak] / step, plan[weak] / step, 'chebyshev') < 1.5
    count, label = connected_components(near, directed=False)
    parts = [weak[label == i] for i in range(count)]
    return sorted(parts, key=lambda part: (-len(part), int(part[0])))


def remedies(config: MagnetPadConfig, required: Requirements, force: Array) -> list[Remedy]:
    """Changes of the pad where forces (n,) (N) that are felt exceed the least one."""
    weak = np.flatnonzero(force > required.force)
    if not len(weak):
        return []
    found = []
    modulus = stiffest(config, required)
    if modulus > 0:
        why = 'most cells' if len(weak) > MOST * len(force) else 'max(F_min) is high'
        change = f'shear modulus {1e-6 * modulus:.3g} MPa for {1e-6 * config.shear_modulus:.3g}'
        found.append(Remedy('softer body', why, change, replace(config, shear_modulus=modulus)))
    return found + [_added(config, part) for part in blocks(config.cells, weak)]


def _added(config: MagnetPadConfig, cells: Integers) -> Remedy:
    """A chip under a block of adjacent cells; else a magnet half way up under a few of them."""
    words = 'cells ' + ', '.join(str(cell) for cell in cells.tolist())
    at = config.cells[cells].mean(axis=0)
    x, y = 1e3 * at[:2]
    if len(cells) < BLOCK:
        at[2] *= 0.6
        added = replace(
            config, magnet_positions=np.vstack([config.magnet_positions, at]),
            magnet_axes=np.vstack([config.magnet_axes, config.magnet_axes[:1]]),
        )  # fmt: skip
        change = f'a magnet at {x:.3g}, {y:.3g}, {1e3 * at[2]:.3g} mm'
        return Remedy('more magnets', f'a few: {words}', change, added)
    at[2], turns = config.positions[:, 2].mean(), config.rotations
    added = replace(
        config, positions=np.vstack([config.positions, at]),
        rotations=None if turns is None else np.concatenate([turns, np.eye(3)[None]]),
    )  # fmt: skip
    return Remedy('extra chip', f'a block: {words}', f'a chip at {x:.3g}, {y:.3g} mm', added)


SOFTEST, ROUNDS = 0.02, 7


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile design magnet_pad`."""
    for name, default, what in (
        ('force', 1.5, 'least force to be felt (N)'), ('largest', 10.0, 'largest force (N)'),
        ('tip', 3.0, 'radius of what touches (mm)'),
        ('least-field', 10.0, 'least field of a chip (uT)'),
        ('resolution', None, 'least change that counts (uT); 5 sigma of the noise'),
    ):  # fmt: skip
        parser.add_argument(f'--{name}', type=float, default=default, help=what)
    parser.add_argument('--magnets', type=int, default=4, help='most magnets of the search')
    parser.add_argument('--chips', type=int, default=3, help='most chips of the search')


def tables(config: MagnetPadConfig, options: argparse.Namespace) -> list[Table]:
    """Conditions, map, remedies and search."""
    positive = (options.force, options.largest, options.tip, options.magnets, options.chips)
    if min(positive) <= 0 or options.force > options.largest:
        msg = 'forces, tip, magnets and chips of design must be above 0, and force below largest'
        raise ValueError(msg)
    noise = NOISE if config.noise is None else float(np.max(config.noise))
    resolution = 5 * noise if options.resolution is None else 1e-6 * options.resolution
    required = Requirements(
        options.force, options.largest, 1e-3 * options.tip, 1e-6 * options.least_field, resolution
    )
    force = least_forces(config, required)
    return [
        _first(config, required),
        _map(config, required, force),
        _remedies(config, required, force),
        _search(config, required, noise, options.magnets, options.chips),
    ]


def _first(config: MagnetPadConfig, required: Requirements) -> Table:
    """Condition 1."""
    rest, (most, limit) = np.linalg.norm(rest_field(config), axis=1), loudest(config, required)
    holds = quiet_enough(config, required)
    share = (most / limit).max(axis=1)
    rows = tuple(
        (i + 1, 1e3 * rest[i], *(1e3 * most[i]), 100 * share[i], 'yes' if holds[i] else 'no')
        for i in range(len(rest))
    )
    note = (
        f'Condition 1 {_says(bool(holds.all()))}: at rest more than '
        f'{1e6 * required.least_field:g} uT, and no chip saturates up to {required.largest:g} N.'
    )
    columns = (
        'chip', 'at rest (mT)', 'most x (mT)', 'most y (mT)', 'most z (mT)', 'of its range (%)',
        'holds',
    )  # fmt: skip
    return Table('condition 1: every chip', columns, rows, (note,))


def _says(holds: bool) -> str:
    return 'holds' if holds else 'does not hold'


def _map(config: MagnetPadConfig, required: Requirements, force: Array) -> Table:
    """Condition 2: least force in every cell, as seen from above."""
    x, y = (np.unique(np.round(config.cells[:, i], 6)) for i in range(2))
    rows = []
    for b in y[::-1]:
        row: list[float | None] = [float(1e3 * b)]
        for a in x:
            near = np.abs(config.cells[:, :2] - (a, b)).max(axis=1)
            i = int(near.argmin())
            row.append(float(force[i]) if near[i] < 1e-5 and np.isfinite(force[i]) else None)
        rows.append(tuple(row))
    most = float(force.max())
    note = (
        f'Condition 2 {_says(most <= required.force)} for {required.force:g} N: the largest of '
        f'the map is {most:.3g} N, with changes above {1e6 * required.resolution:g} uT and a '
        f'tip of {1e3 * required.tip:g} mm.'
    )
    columns = ('y (mm)', *(f'x = {1e3 * a:.4g} (N)' for a in x))
    return Table('F_min: least force that is felt in each cell', columns, tuple(rows), (note,))


def _remedies(config: MagnetPadConfig, required: Requirements, force: Array) -> Table:
    """Remedies of [2] where condition 2 fails, and their gain."""
    rows = []
    for one in (Remedy('none', 'as it is', '-', config), *remedies(config, required, force)):
        after, quiet = least_forces(one.config, required), quiet_enough(one.config, required)
        felt = int((after <= required.force).sum())
        says = 'yes' if quiet.all() else 'no'
        rows.append((one.what, one.why, one.change, float(after.max()), felt, says))
    notes = () if rows[1:] else ('Nothing to mend: every cell feels the least force.',)
    columns = (
        'remedy of [2]', 'why', 'change', 'largest F_min (N)', 'cells that feel it', 'condition 1',
    )  # fmt: skip
    return Table('remedies', columns, tuple(rows), notes)


def _search(
    config: MagnetPadConfig, required: Requirements, noise: float, magnets: int, chips: int
) -> Table:
    """The stiffness that serves every number of magnets and chips; the fewest parts first."""
    rows = []
    for count in sorted(np.ndindex(magnets, chips), key=lambda n: (sum(n), n[1])):
        one = evenly(config, count[0] + 1, count[1] + 1)
        hard = stiffest(one, required)
        soft = softest(one, required, hard)
        serves = 0 < soft <= hard
        best = float(np.sqrt(soft * hard)) if serves else np.nan
        place = np.nan
        if serves:
            place = 1e3 * place_bound(replace(one, shear_modulus=best), required, noise)
        rows.append((
            count[0] + 1, count[1] + 1, 1e-6 * soft if serves else None,
            1e-6 * hard if hard > 0 else None, 1e-6 * best if serves else None,
            place if np.isfinite(place) else None, 'yes' if serves else 'no',
        ))  # fmt: skip
    known = [row for row in rows if row[-1] == 'yes']
    fewest = (
        f'Fewest parts: {known[0][0]} magnets and {known[0][1]} chips at a shear modulus of '
        f'{known[0][4]:.3g} MPa.'
        if known
        else 'No number of magnets and chips in this range satisfies both conditions.'
    )
    columns = (
        'magnets', 'chips', 'softest G (MPa)', 'stiffest G (MPa)', 'optimum G (MPa)',
        'place bound (mm)', 'both conditions',
    )  # fmt: skip
    notes = (
        fewest,
        'Softer, the largest force saturates a chip or moves magnets by more than a third of '
        'their height; stiffer, the least force is not felt in every cell; the optimum keeps the '
        'same factor from both.',
    )
    return Table('search: fewest magnets and chips', columns, tuple(rows), notes)


def evenly(config: MagnetPadConfig, magnets: int, chips: int) -> MagnetPadConfig:
    """The pad with so many magnets and chips, spaced evenly along the axis."""
    height = float(config.magnet_positions[:, 2].mean())
    along = config.length * ((np.arange(magnets) + 0.5) / magnets - 0.5) * 0.75
    places = np.column_stack([along, 0 * along, np.full(magnets, height)])
    under = config.length * ((np.arange(chips) + 0.5) / chips - 0.5)
    return replace(
        config, magnet_positions=places, magnet_axes=np.tile(config.magnet_axes[:1], (magnets, 1)),
        positions=np.column_stack([under, 0 * under, 0 * under]), rotations=None,
    )  # fmt: skip


def softest(config: MagnetPadConfig, required: Requirements, hard: float) -> float:
    """Least shear modulus (Pa) at which condition 1 holds under the largest force; nan: none."""
    if not hard > 0 or not quiet_enough(replace(config, shear_modulus=1e9), required).all():
        return float('nan')
    if not _bears(config, required, hard):
        return float('inf')
    low, high = SOFTEST * hard, hard
    for _ in range(ROUNDS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if _bears(config, required, middle) else (middle, high)
    return high


def _bears(config: MagnetPadConfig, required: Requirements, modulus: float) -> bool:
    """True if the largest force leaves the chips clear and the magnets in their place."""
    strained = required.largest / (4 * np.pi * modulus * config.radius)
    height = float(config.magnet_positions[:, 2].min())
    softened = replace(config, shear_modulus=modulus)
    return bool(2 * strained < height / 3 and quiet_enough(softened, required).all())
