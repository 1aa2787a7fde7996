# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A taxel array of its own: pressures on fine cells, no polynomial law, a skin that creeps.

Coverage is counted in cells of 0.1 mm, each in the taxel that its polar or square place names. The
skin conducts by a power of the load that levels off, remembers by three fading branches and by
play (hysteresis), and is read in 10 bits. Nothing of it is shared with the package's own models.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from tactile_ros.sensors import load_sensor
from tactile_ros.types import Outline, Recording

CELL = 1e-4
ASKEW = 0.11  # turn of rings (rad): no edge of a sector runs along rows or diagonals of cells
SPEC = load_sensor('taxel_array')


@dataclass
class Array:
    """Which taxel (-1 none) every cell of a square raster belongs to."""

    positions: np.ndarray
    areas: np.ndarray
    outlines: tuple[Outline, ...] | None
    owner: np.ndarray
    x: np.ndarray
    y: np.ndarray
    _kept: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._kept = self.owner >= 0
        self.x, self.y, self.owner = (a[self._kept] for a in (self.x, self.y, self.owner))

    def forces(self, pressure: np.ndarray) -> np.ndarray:
        """Load (t,) of every taxel under pressures (n,) of cells (N)."""
        return np.bincount(self.owner, pressure, len(self.positions)) * CELL**2


def raster(reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells of a square."""
    line = np.arange(-reach, reach, CELL) + CELL / 2
    x, y = np.meshgrid(line, line)
    return x.reshape(-1), y.reshape(-1)


def radial(rings: tuple[float, ...], counts: tuple[int, ...]) -> Array:
    """Rings of sectors; `rings` are the radii between them."""
    x, y = raster(rings[-1] + 1e-3)
    radius, angle = np.hypot(x, y), np.mod(np.arctan2(y, x) - ASKEW, 2 * np.pi)
    owner, first = np.full(len(x), -1), 0
    outlines, centres, areas = [], [], []
    for low, high, count in zip(rings[:-1], rings[1:], counts, strict=True):
        there = (radius >= low) & (radius < high)
        owner[there] = first + np.floor(angle[there] * count / (2 * np.pi)).astype(int)
        for i in range(count):
            turn = ASKEW + 2 * np.pi * (i + np.linspace(0, 1, 17)) / count
            arc = np.column_stack([np.cos(turn), np.sin(turn)])
            outlines.append(
                Outline(f't{first + i}', (np.concatenate([high * arc, low * arc[::-1]]),))
            )
            mine = owner == first + i
            centres.append([x[mine].mean(), y[mine].mean(), 0.0])
            areas.append(np.pi * (high**2 - low**2) / count)
        first += count
    return Array(np.array(centres), np.array(areas), tuple(outlines), owner, x, y)


def matrix(rows: int, columns: int, pitch: float) -> Array:
    """Squares of `pitch`, row by row from -y."""
    x, y = raster(0.5 * pitch * max(rows, columns))
    column = np.floor(x / pitch + columns / 2).astype(int)
    row = np.floor(y / pitch + rows / 2).astype(int)
    there = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    owner = np.where(there, row * columns + column, -1)
    i, j = np.divmod(np.arange(rows * columns), columns)
    plane = pitch * np.column_stack([j + 0.5 - columns / 2, i + 0.5 - rows / 2])
    positions = np.column_stack([plane, np.zeros(rows * columns)])
    return Array(positions, np.full(rows * columns, pitch**2), None, owner, x, y)


def washer(name: str, outer: float, inner: float) -> Outline:
    """Two circles."""
    turn = 2 * np.pi * np.arange(120) / 120
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    return Outline(name, (outer * rim, inner * rim[::-1]))


def on_washer(x: np.ndarray, y: np.ndarray, outer: float, inner: float) -> np.ndarray:
    """1 on the ring, with edges as soft as a cell."""
    radius = np.hypot(x, y)
    return np.clip((outer - radius) / CELL + 0.5, 0, 1) * np.clip(
        (radius - inner) / CELL + 0.5, 0, 1
    )


def on_polygon(x: np.ndarray, y: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Part of each cell inside a polygon: by the winding number, and at edges by their distance.

    Cells that are in or out as a whole would move an edge by hundredths of a taxel.
    """
    winding, away = np.zeros(len(x), int), np.full(len(x), np.inf)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        left = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
        winding += ((y0 <= y) & (y1 > y) & (left > 0)).astype(int)
        winding -= ((y0 > y) & (y1 <= y) & (left < 0)).astype(int)
        squared = (x1 - x0) ** 2 + (y1 - y0) ** 2
        along = np.clip(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / squared, 0, 1)
        gap = np.hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0))
        away = np.minimum(away, gap)
    return np.clip(0.5 + np.where(winding != 0, away, -away) / CELL, 0.0, 1.0)


def on_tube(
    x: np.ndarray, y: np.ndarray, radius: float, bend: float, half: float, profile: str = 'round'
) -> np.ndarray:
    """Pressure, 1 at most, of two cylinders that sink in until the contact is 2 `half` wide."""
    best = np.zeros(len(x))
    for turn in (0.0, bend):
        along = np.cos(turn) * x + np.sin(turn) * y
        across = np.cos(turn) * y - np.sin(turn) * x
        if profile == 'round':  # a circle less its chord
            chord = np.sqrt(radius**2 - half**2)
            depth = np.sqrt(np.maximum(radius**2 - across**2, 0)) - chord
            depth = np.maximum(depth, 0) / (radius - chord)
        elif profile == 'hertz':
            depth = np.sqrt(np.maximum(1 - (across / half) ** 2, 0))
        else:
            depth = np.clip((half - np.abs(across)) / CELL + 0.5, 0, 1)
        best = np.maximum(best, depth * (along > 0))
    return best


@dataclass
class Skin:
    """How t taxels answer to their loads over time."""

    seed: int
    taxels: int
    half_load: float
    spread: float = 0.55
    power: float = 0.85
    creep: tuple[float, ...] = ()
    tau: tuple[float, ...] = (0.7, 6.0, 45.0)
    play: float = 0.0
    noise: float = 3e-4
    bits: int = 10
    law: str = 'divider'

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.gain = 0.95 / (1 + self.spread * rng.uniform(size=self.taxels))
        self.half = self.half_load * (1 + 0.25 * rng.uniform(-1, 1, self.taxels))
        self.steep = self.power * (1 + 0.04 * rng.uniform(-1, 1, self.taxels))

    def settled(self, load: np.ndarray) -> np.ndarray:
        """Outputs (s, t) without memory or noise."""
        size = (np.maximum(load, 0) / self.half) ** self.steep
        if self.law == 'exponential':
            return self.gain * -np.expm1(-0.7 * size)
        if self.law == 'logarithm':
            return np.minimum(0.3 * self.gain * np.log1p(3 * size), 0.999)
        return self.gain * size / (1 + size)

    def crept(self, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Loads (s, t) as the skin feels them; linear between the times (s,)."""
        felt = load.copy()
        for share, tau in zip(self.creep, self.tau, strict=False):
            state = np.zeros(load.shape[1])
            for i in range(1, len(time)):
                for part in np.linspace(0, 1, 9)[1:]:  # small exact steps, not one
                    fade = np.exp(-(time[i] - time[i - 1]) / 8 / tau)
                    between = load[i - 1] + (part - 1 / 16) * (load[i] - load[i - 1])
                    state = fade * state + (1 - fade) * between
                felt[i] += share * state
        return felt

    def played(self, load: np.ndarray) -> np.ndarray:
        """Hysteresis: what follows a load with play of a part of the largest one."""
        follower, slack, out = load[0].copy(), self.play * load.max(axis=0), np.empty_like(load)
        for i, now in enumerate(load):
            follower = np.clip(follower, now - slack, now + slack)
            out[i] = 0.5 * (now + np.maximum(follower, 0.0)) * (now > 0)
        return out

    def read(
        self, load: np.ndarray, rng: np.random.Generator, time: np.ndarray | None = None
    ) -> np.ndarray:
        """Readings (s, t, 1)."""
        felt = load if time is None or not self.creep else self.crept(load, time)
        if self.play:
            felt = self.played(felt)
        output = self.settled(felt) + self.noise * rng.normal(size=load.shape)
        full = 2**self.bits - 1
        return np.round(np.clip(output, 0, 1) * full)[..., None] / full


def config(array: Array, objects: tuple[Outline, ...] = (), top: float = 5.0) -> object:
    """Of an array; `top` is the largest load of a taxel (N)."""
    return replace(  # type: ignore[type-var]
        SPEC.config(), positions=array.positions, areas=array.areas,
        taxel_outlines=array.outlines, force_range=(0.0, top), objects=objects,
    )  # fmt: skip


def even_loads(
    array: Array, settings: object, skin: Skin, top: float, seed: int, count: int = 150
) -> Recording:
    """The whole array pressed evenly by a bladder, as for equilibration; each row by itself."""
    rng = np.random.default_rng(seed)
    pressure = rng.uniform(0.01, 1, (count, 1)) * top
    pressure[: count // 10] = 0
    force = pressure * array.areas / array.areas.mean()
    truth = {'taxel_force': force, 'in_contact': (pressure[:, 0] > 0).astype(np.int8)}
    return Recording.from_arrays(SPEC.layout(settings), skin.read(force, rng), truth=truth)
