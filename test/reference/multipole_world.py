# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A world of the multipole skin of [1], written apart from the package's own physics.

The bonded body is solved wave by wave with finite elements over its height, the punch by a dense
matrix between its cells, and the field is summed over dipoles of a fine grid that are carried to
where they go. Chips are misplaced, tilted and of unlike gain; the sheet is uneven and its bands
lie aside; the field of the Earth, drift and noise are added.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.config import HEADS, box, nine_heads, regular
from tactile_ros.types import Outline, Recording

__all__ = ['bars', 'box', 'collect', 'new_heads', 'nine_heads', 'regular']
SENSOR = load_sensor('multipole_skin')
Heads = tuple[Outline, ...]
MU0 = 4e-7 * np.pi
GRID = 0.625e-3
SIDE = 192  # cells of the periodic body
LAYERS = 12  # finite elements over the height, of second order
LEVELS = np.array([1 / 6, 1 / 2, 5 / 6])
STORED = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # parts of a press at which the field is summed


@dataclass(frozen=True)
class Flaws:
    """What a real skin has and its config does not say; standard deviations unless said."""

    place: float = 0.15e-3  # of chips (m)
    tilt: float = 0.02  # rad
    gain: float = 0.03
    uneven: float = 0.05  # of remanence, from band to band and along them
    remanence: float = 0.1  # of the whole sheet
    aside: float = 0.2e-3  # of the bands (m)
    gap: float = 0.1e-3  # m
    earth: float = 30e-6  # T
    noise: float = 4e-6  # T
    drift: float = 2e-6  # T from tare to press
    turning: float = 0.0  # share of the body's turns that magnets follow; exact, no deviation


IDEAL = Flaws(0, 0, 0, 0, 0, 0, 0, 0, 4e-6, 0)


def new_heads() -> Heads:
    """The five heads of [1] that were not trained with."""
    return HEADS


def bars() -> tuple[Outline, ...]:
    """Three bars; [1] gives no sizes."""
    return box('bar_30x5', 30e-3, 5e-3), box('bar_25x6', 25e-3, 6e-3), box('bar_35x4', 35e-3, 4e-3)


def stations() -> np.ndarray:
    """Twenty-five places evenly over the skin (m), shape (25, 2)."""
    line = 11e-3 * np.arange(-2, 3)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


@lru_cache(maxsize=4)
def body_waves(height: float, young: float, poisson: float, low: float) -> np.ndarray:
    """Spectra (3 + 1, kx, ky) per level: ux, uy, uz at the sheet's levels, and uz at the face.

    Finite elements of second order over the height, one small system for each wave number.
    """
    k = 2 * np.pi * np.abs(np.fft.fftfreq(SIDE, GRID))
    size = np.hypot(k[:, None], k[None])
    lengths, back = np.unique(np.round(size, 6), return_inverse=True)
    nodes = 2 * LAYERS + 1
    lam = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    mu = young / (2 * (1 + poisson))
    # graded towards the face, where short waves live
    edges = height * (1 - (1 - np.linspace(0, 1, LAYERS + 1)) ** 1.7)
    points, weights = np.polynomial.legendre.leggauss(3)
    full = np.zeros((len(lengths), 2 * nodes, 2 * nodes))
    for e in range(LAYERS):
        h = edges[e + 1] - edges[e]
        for s, w in zip(points, weights, strict=True):
            n = np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2])
            d = np.array([s - 0.5, -2 * s, s + 0.5]) * 2 / h
            # u = (U sin, W cos): strains exx = k U, ezz = W', gxz = U' - k W
            exx = np.zeros((len(lengths), 1, 6))
            ezz, gxz = np.zeros_like(exx), np.zeros_like(exx)
            exx[:, 0, :3] = lengths[:, None] * n
            ezz[:, 0, 3:] = d
            gxz[:, 0, :3] = d
            gxz[:, 0, 3:] = -lengths[:, None] * n
            # selective integration is not needed: second order and a ratio below one half
            stiff = (lam + 2 * mu) * (_outer(exx) + _outer(ezz)) + mu * _outer(gxz)
            stiff += lam * (_outer(exx, ezz) + _outer(ezz, exx))
            rows = np.concatenate([2 * e + np.arange(3), nodes + 2 * e + np.arange(3)])
            full[:, rows[:, None], rows[None]] += w * h / 2 * stiff
    free = np.delete(np.arange(2 * nodes), [0, nodes])
    load = np.zeros((len(lengths), len(free), 1))
    load[:, -1] = -1.0
    held = full[:, free[:, None], free[None]]
    found = np.zeros((len(lengths), 2 * nodes))
    found[:, free] = np.linalg.solve(held, load)[..., 0]
    z = np.empty(nodes)
    z[::2] = edges
    z[1::2] = (edges[1:] + edges[:-1]) / 2
    levels = low + (height - low) * LEVELS
    across = np.stack([_quadratic(z, found[:, :nodes], at) for at in levels])
    up = np.stack([_quadratic(z, found[:, nodes:], at) for at in levels])
    face = found[:, -1]
    shape = (SIDE, SIDE)
    back = np.ravel(back)
    lay = lambda a: a[..., back].reshape(*a.shape[:-1], *shape)  # noqa: E731
    kx = 2 * np.pi * np.fft.fftfreq(SIDE, GRID)
    unit = np.where(size > 0, 1 / np.maximum(size, 1e-9), 0)
    # U sin(k x) for a pressure cos(k x) is -i U exp(i k x)
    ux = -1j * lay(across) * (kx[:, None] * unit)
    uy = -1j * lay(across) * (kx[None] * unit)
    return np.concatenate([ux, uy, lay(up) + 0j, lay(face)[None] + 0j])


def _outer(a: np.ndarray, b: np.ndarray | None = None) -> np.ndarray:
    return np.swapaxes(a, 1, 2) @ (a if b is None else b)


def _quadratic(z: np.ndarray, values: np.ndarray, at: float) -> np.ndarray:
    """Values at a height inside elements of three nodes."""
    e = min(int(np.searchsorted(z[::2], at, side='right')) - 1, LAYERS - 1)
    b, c = z[2 * e + 1 : 2 * e + 3]
    s = (at - b) / (c - b)
    n = np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2])
    return values[:, 2 * e : 2 * e + 3] @ n


def _crossings(loops: tuple[np.ndarray, ...], points: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) lie inside, by winding angles."""
    total = np.zeros(len(points))
    for loop in loops:
        a = loop[None] - points[:, None]
        b = np.roll(loop, -1, axis=0)[None] - points[:, None]
        cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        total += np.arctan2(cross, (a * b).sum(axis=-1)).sum(axis=1)
    return np.abs(total) > np.pi


class World:
    """One skin with its flaws, magnetised as 'M1' to 'M4'."""

    def __init__(self, seed: int, flaws: Flaws | None = None, magnetisation: str = 'M4') -> None:
        rng = np.random.default_rng([7, seed])
        flaws = Flaws() if flaws is None else flaws
        self.flaws, self.rng = flaws, rng
        config = SENSOR.config()
        self.config = config
        self.magnetisation = magnetisation
        n = len(config.positions)
        self.chips = config.positions + flaws.place * rng.normal(size=(n, 3))
        self.chips[:, 2] -= flaws.gap * rng.normal()
        tilt = flaws.tilt * rng.normal(size=(n, 3))
        self.axes = np.eye(3) + np.cross(tilt[:, None], np.eye(3)[None])
        self.gain = 1 + flaws.gain * rng.normal(size=(n, 3))
        self.earth = flaws.earth * rng.normal(size=3)
        self.low, self.top = (
            config.layer_thickness,
            config.layer_thickness + config.sheet_thickness,
        )
        self._lay(rng)
        self.still = self._field(np.zeros_like(self.places))
        self.waves = body_waves(self.top, config.youngs_modulus, config.poisson_ratio, self.low)

    def _lay(self, rng: np.random.Generator) -> None:
        """Places and moments of the sheet's dipoles."""
        config, flaws = self.config, self.flaws
        line = [GRID * (np.arange(round(s / GRID)) + 0.5) - s / 2 for s in config.sheet_size]
        z = self.low + (self.top - self.low) * LEVELS
        self.places = np.stack(np.meshgrid(*line, z, indexing='ij'), axis=-1).reshape(-1, 3)
        self.aside = flaws.aside * rng.normal()
        x, y = self.places[:, 0], self.places[:, 1] - self.aside
        half = config.sheet_size[1] / 2
        bands = np.floor((y + half) / config.pole_pitch + 1e-6).astype(int)
        kind = self.magnetisation
        if kind == 'M4':
            sign = np.where(bands % 2 == 0, 1.0, -1.0)
        else:
            sign = np.where(y > 0, 1.0, -1.0) if kind == 'M3' else np.ones_like(y)
        each = 1 + flaws.uneven * rng.normal(size=12)
        wave = flaws.uneven * np.sin(2 * np.pi * x / 60e-3 + rng.uniform(0, 6))
        strength = config.remanence * (1 + flaws.remanence * rng.normal())
        self.strengths = strength * each[:9]  # of bands; the wave along them is nobody's
        strength = strength * (each[np.clip(bands, 0, 11)] + wave)
        volume = GRID**2 * config.sheet_thickness / len(LEVELS)
        self.moments = np.zeros_like(self.places)
        self.moments[:, 2 if kind == 'M1' else 1] = sign * strength * volume / MU0

    def _field(self, moved: np.ndarray, rows: np.ndarray | None = None,
               moments: np.ndarray | None = None) -> np.ndarray:  # fmt: skip
        """True flux density at the chips (t, 3) of some of the dipoles."""
        rows = np.arange(len(self.places)) if rows is None else rows
        at = self.places[rows] + moved
        m = self.moments[rows] if moments is None else moments
        field = np.zeros((len(self.chips), 3))
        for i, chip in enumerate(self.chips):
            d = chip - at
            r2 = np.einsum('gi,gi->g', d, d)
            inverse = r2**-1.5
            along = 3 * np.einsum('gi,gi->g', m, d) / r2 * inverse
            field[i] = 1e-7 * (along @ d - inverse @ m)
        return field

    def _read(self, field: np.ndarray) -> np.ndarray:
        """What chips say of fields (..., t, 3)."""
        return np.einsum('tij,...tj->...ti', self.axes, field) * self.gain

    def punch(self, outline: Outline, place: np.ndarray, yaw: float) -> tuple[float, np.ndarray]:
        """Loads of a punch on the body's cells per depth, and the movements (3, 3, n, n)."""
        c, s = np.cos(yaw), np.sin(yaw)
        turned = tuple(loop @ np.array([[c, s], [-s, c]]) + place for loop in outline.loops)
        line = GRID * (np.arange(SIDE) - SIDE // 2 + 0.5)
        reach = np.concatenate(turned)
        low, high = reach.min(axis=0) - GRID, reach.max(axis=0) + GRID
        near = [np.flatnonzero((line > low[i]) & (line < high[i])) for i in (0, 1)]
        cells = np.stack(np.meshgrid(*near, indexing='ij'), axis=-1).reshape(-1, 2)
        part = np.linspace(-0.375, 0.375, 4) * GRID
        fine = line[cells][:, None] + np.stack(np.meshgrid(part, part), -1).reshape(-1, 2)[None]
        share = _crossings(turned, fine.reshape(-1, 2)).reshape(len(cells), -1).mean(axis=1)
        cells, share = cells[share > 0.5], share[share > 0.5]
        kernel = np.fft.ifft2(self.waves[-1]).real
        away = (cells[:, None] - cells[None]) % SIDE
        pressure = np.linalg.solve(kernel[away[..., 0], away[..., 1]], -np.ones(len(cells)))
        image = np.zeros((SIDE, SIDE))
        image[cells[:, 0], cells[:, 1]] = pressure
        spectrum = np.fft.fft2(image)
        return pressure.sum() * GRID**2, spectrum

    def changes(
        self, outline: Outline, place: np.ndarray, yaw: float, depth: float
    ) -> tuple[np.ndarray, float]:
        """Change of the field at parts `STORED` of a depth, shape (5, t, 3), and stiffness."""
        stiff, spectrum = self.punch(outline, np.asarray(place, float), yaw)
        moved = np.fft.ifft2(self.waves[:-1] * spectrum).real
        line = GRID * (np.arange(SIDE) - SIDE // 2 + 0.5)
        size = self.config.sheet_size
        inner = [np.flatnonzero(np.abs(line) < s / 2) for s in size]
        u = moved[:, inner[0][:, None], inner[1][None]]
        levels = len(LEVELS)
        u = u.reshape(3, levels, *u.shape[1:])
        turn = self._turns(u) if self.flaws.turning else np.zeros_like(u)
        flat = lambda a: np.moveaxis(a, (0, 1), (3, 2)).reshape(-1, 3)  # noqa: E731
        u, turn = flat(u), flat(turn)
        rows = np.flatnonzero(np.linalg.norm(u, axis=1) > 1e-3 * np.abs(u).max())
        before = self._field(np.zeros((len(rows), 3)), rows)
        found = []
        for part in STORED:
            m = _spun(self.moments[rows], part * depth * self.flaws.turning * turn[rows])
            found.append(self._field(part * depth * u[rows], rows, m) - before)
        return np.stack(found), stiff

    def _turns(self, u: np.ndarray) -> np.ndarray:
        """Half the curl of movements (3, level, x, y), by differences."""
        high = (self.top - self.low) * (LEVELS[1] - LEVELS[0])
        dz, dx, dy = (np.gradient(u, h, axis=a) for h, a in ((high, 1), (GRID, 2), (GRID, 3)))
        return 0.5 * np.stack([dy[2] - dz[1], dz[0] - dx[2], dx[1] - dy[0]])

    def press(
        self, outline: Outline, place: np.ndarray, yaw: float, depths: np.ndarray
    ) -> np.ndarray:
        """Readings (s, t, 3) without noise while a head stands at depths (s,) (m)."""
        most = float(np.max(depths))
        change, self.stiffness = self.changes(outline, place, yaw, most)
        powers = np.vander(STORED[1:], 5, increasing=True)[:, 1:]
        terms = np.linalg.solve(powers, change[1:].reshape(4, -1))
        part = np.asarray(depths) / most
        now = np.stack([part, part**2, part**3, part**4], axis=-1) @ terms
        return self._read(self.still + self.earth + now.reshape(-1, *self.still.shape))

    def stray(self, field: np.ndarray) -> np.ndarray:
        """What chips (t, 3) make of a uniform field (T)."""
        return self._read(np.tile(field, (len(self.chips), 1)))

    def rest(self) -> np.ndarray:
        """Readings at rest (t, 3) without noise."""
        return self._read(self.still + self.earth)


def _spun(moments: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Moments turned by rotation vectors."""
    angle = np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-12)
    axis = turn / angle
    along = axis * (axis * moments).sum(axis=1, keepdims=True)
    side = np.cross(axis, moments)
    return along + np.cos(angle) * (moments - along) + np.sin(angle) * side


TARE, WINDOW = 5, 10


def ramp(rng: np.random.Generator, depth: float) -> np.ndarray:
    """Depths of ten frames: a head comes down at some speed, then holds."""
    rise = rng.uniform(4, 12)
    return depth * np.clip((np.arange(WINDOW) + rng.uniform(0.3, 1.0)) / rise, 0.0, 1.0)


def collect(
    world: World, heads: Heads, labels: np.ndarray, places: np.ndarray, yaws: np.ndarray,
    depths: np.ndarray, seed: int, config: object = None,
) -> Recording:  # fmt: skip
    """Presses (n), one stream of tare rows and a window each, with their truth.

    `seed` is of speeds, drift and noise.
    """
    rng = np.random.default_rng([11, seed])
    rows = TARE + WINDOW
    n = len(labels)
    values = np.empty((n, rows, *world.still.shape))
    force = np.full((n, rows, 3), np.nan)
    for i in range(n):
        course = ramp(rng, depths[i])
        values[i, :TARE] = world.rest()
        values[i, TARE:] = world.press(heads[labels[i]], places[i], yaws[i], course)
        force[i, TARE:] = 0
        force[i, TARE:, 2] = world.stiffness * course
        values[i, TARE:] += world.flaws.drift * rng.normal(size=world.still.shape)
    values += world.flaws.noise * rng.normal(size=values.shape)
    pressed = np.tile(np.arange(rows) >= TARE, n)
    each = lambda a, blank: np.where(  # noqa: E731
        pressed.reshape(-1, *[1] * (np.ndim(a) - 1)), np.repeat(a, rows, axis=0), blank
    )
    z = np.full(n, world.top)
    truth = {
        'label': each(np.asarray(labels), -1),
        'position': each(np.column_stack([places, z]), np.nan),
        'yaw': each(np.asarray(yaws, float), np.nan),
        'force': force.reshape(-1, 3),
        'in_contact': pressed.astype(np.int8),
        'repetition': np.repeat(np.arange(n), rows),
    }
    layout = SENSOR.layout(config or world.config)
    return Recording.from_arrays(
        layout, values.reshape(n * rows, *world.still.shape),
        stamp_ns=np.arange(n * rows) * 12_500_000 + np.repeat(np.arange(n), rows) * 2_000_000_000,
        stream=np.repeat(np.arange(n), rows), tare=~pressed, truth=truth,
    )  # fmt: skip
