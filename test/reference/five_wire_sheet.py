# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A second five-wire skin: finite differences, silver pads in the corners, an uneven sheet.

The film is rough over a stated length, an air gap of its own takes force off everywhere, and the
film may creep. Readings of a stream come at even times. Nothing of it is shared with the model of
the package, nor with `five_wire_world.py`.
"""

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.sparse.linalg import splu

from reference.sheet_solver import network_matrix, network_potential
from tactile_ros.types import Layout, Recording

NODES = 81
FILM = 400  # random waves of the film
REFERENCE, SHEET = 1000.0, 100.0  # ohm, ohm per square
FELT = 0.4  # N: a load that a press of a stream reaches
LAGS, CREEP = np.array([0.3, 3.0]), 0.06  # s, and the share of either
RATE_HZ = 25.0  # of a stream


class SheetWorld:
    """Readings of touches on a sheet of `size` (m)."""

    def __init__(
        self,
        seed: int,
        *,
        size: tuple[float, float] = (0.1, 0.1),
        length: float = 0.02,
        spread: float = 0.25,
        uneven: float = 0.3,
        rough: float = 0.02,
        pad: float = 4e-3,
        gap: float = 0.3,
        noise: float = 2.5e-4,
    ) -> None:
        rng = np.random.default_rng(seed)
        self.size, self.noise, self.gap, self.spread = np.array(size), noise, gap, spread
        nodes = np.array([NODES, max(round(NODES * size[1] / size[0]), 21)])
        self.axes = [np.linspace(0, s, n) for s, n in zip(size, nodes, strict=True)]
        self.x, self.y = np.meshgrid(*self.axes, indexing='ij')
        self._solve(rng, nodes, uneven, rough, pad)
        self.waves = (
            rng.normal(size=(3, FILM, 2))
            / np.array([length, length, 0.3 * size[0]])[:, None, None]
        )
        self.phases = rng.uniform(0, 2 * np.pi, (3, FILM))
        self.heights = rng.normal(size=(3, FILM)) * np.sqrt(2 / FILM)

    def _solve(
        self, rng: np.random.Generator, nodes: np.ndarray, uneven: float, rough: float, pad: float
    ) -> None:
        """Potentials of both excitations, and the resistance to the joined corners."""
        (nx, ny), (hx, hy) = nodes, self.size / (nodes - 1)
        number = np.arange(nx * ny).reshape(nx, ny)
        wave, phase = rng.normal(size=(6, 2)) * 2 / self.size[0], rng.uniform(0, 2 * np.pi, 6)
        angle = np.stack([self.x, self.y], -1) @ wave.T + phase
        sheet = np.exp(rough * np.cos(angle).sum(-1) / np.sqrt(3))
        along_x = 2 / (1 / sheet[1:] + 1 / sheet[:-1]) * hy / hx
        along_y = 2 / (1 / sheet[:, 1:] + 1 / sheet[:, :-1]) * hx / hy
        along_x[:, [0, -1]] *= 0.5
        along_y[[0, -1]] *= 0.5
        turn, order = np.linspace(0, 1, 400), np.arange(1, 9)
        shape = np.sin(2 * np.pi * np.outer(turn, order) + rng.uniform(0, 2 * np.pi, 8))
        bump = shape @ (rng.normal(size=8) / order**0.7)
        bump *= uneven / bump.std()

        def silver(share: np.ndarray) -> np.ndarray:
            return 24.0 * np.exp(np.interp(share % 1, turn, bump))

        half_x, half_y = (np.arange(nx - 1) + 0.5) / (nx - 1), (np.arange(ny - 1) + 0.5) / (ny - 1)
        along_x[:, 0] += silver(half_x / 4) / hx
        along_y[-1] += silver(0.25 + half_y / 4) / hy
        along_x[:, -1] += silver(0.75 - half_x / 4) / hx
        along_y[0] += silver(1 - half_y / 4) / hy
        corners = [(0, 0), (nx - 1, 0), (nx - 1, ny - 1), (0, ny - 1)]
        for i, j in corners:
            near = (abs(self.x - self.axes[0][i]) < pad) & (abs(self.y - self.axes[1][j]) < pad)
            along_x[near[1:] & near[:-1]] += 1e5
            along_y[near[:, 1:] & near[:, :-1]] += 1e5
        first = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
        second = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
        links = first, second, np.concatenate([along_x.ravel(), along_y.ravel()]), number.size
        held = np.array([number[i, j] for i, j in corners])
        self.splines = []
        for excited in (held[[0, 2]], held[[1, 3]]):
            potential = network_potential(*links, excited, np.array([1.0, 0.0]))
            self.splines.append(RectBivariateSpline(*self.axes, potential.reshape(nx, ny)))
        self.series = self._series(network_matrix(*links), held)

    def _series(self, matrix: object, held: np.ndarray) -> RectBivariateSpline:
        """Resistance (ohm) from a square touch of 15 mm to all corners."""
        free = np.setdiff1d(np.arange(self.x.size), held)
        lines = [np.linspace(0.08, 0.92, 13) * s for s in self.size]
        loads = []
        for a in lines[0]:
            for b in lines[1]:
                on = (abs(self.x - a) <= 7.5e-3) & (abs(self.y - b) <= 7.5e-3)
                loads.append((on / on.sum()).ravel()[free])
        load = np.array(loads).T
        found = (load * splu(matrix[free][:, free]).solve(load)).sum(axis=0)
        return RectBivariateSpline(*lines, SHEET * found.reshape(13, 13))

    def potentials(self, places: np.ndarray) -> np.ndarray:
        """u_AC and u_BD (s, 2) at places (s, 2)."""
        return np.column_stack([spline.ev(*places.T) for spline in self.splines])

    def divider(
        self, places: np.ndarray, force: np.ndarray, crept: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """Clean reading (s,) of the divider; the film's resistance is `crept` times its first."""
        angles = np.einsum('wfk,sk->wsf', self.waves, places) + self.phases[:, None]
        gain, steep, gap = np.einsum('wsf,wf->ws', np.cos(angles), self.heights)
        net = np.maximum(force - self.gap * (1 + 0.3 * gap), 1e-9)
        film = crept * 2000 * np.exp(self.spread * gain) * net ** (-0.7 * (1 + 0.05 * steep))
        whole = film + self.series.ev(*places.T)
        return np.where(net > 1e-9, REFERENCE / (REFERENCE + whole), 0.0)

    def readings(
        self, places: np.ndarray, force: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Noisy readings (s, 3) of touches."""
        clean = np.column_stack([self.potentials(places), self.divider(places, force)])
        return clean + self.noise * rng.normal(size=clean.shape)

    def bound(self, places: np.ndarray) -> float:
        """Mean error of a place (m) by the noise of the potentials alone."""
        steps = 1e-5 * np.eye(2)
        slopes = [
            (self.potentials(places + d) - self.potentials(places - d)) / 2e-5 for d in steps
        ]
        noise = self.noise * np.random.default_rng(0).normal(size=places.shape)
        error = np.linalg.solve(np.stack(slopes, axis=-1), noise[..., None])
        return float(np.linalg.norm(error, axis=1).mean())

    def least(self, places: np.ndarray, force: np.ndarray) -> float:
        """Root mean square error of a force (N) by the divider's noise alone."""
        step = 1e-3
        high, low = (self.divider(places, force + d) for d in (step, -step))
        return float(np.sqrt(np.mean((2 * step * self.noise / (high - low)) ** 2)))


def pressed(
    world: SheetWorld,
    layout: Layout,
    places: np.ndarray,
    loads: np.ndarray,
    seed: int,
    *,
    hold_s: float = 1.2,
) -> Recording:
    """A stream of presses with rests between them, on a film that creeps while it is held."""
    rng = np.random.default_rng(seed)
    force, press = [np.zeros(round(RATE_HZ))], [np.full(round(RATE_HZ), -1)]
    for i, load in enumerate(loads):
        held = round(hold_s * rng.uniform(0.7, 1.4) * RATE_HZ)
        rise, fall = np.linspace(0.2, 1, 5), np.linspace(0.8, 0.2, 3)
        force += [load * np.concatenate([rise, np.ones(held), fall]), np.zeros(round(RATE_HZ))]
        press += [np.full(held + 8, i), np.full(round(RATE_HZ), -1)]
    whole, number = np.concatenate(force), np.concatenate(press)
    fade, past, crept = np.exp(-1 / (RATE_HZ * LAGS)), np.zeros(2), np.ones(len(whole))
    for i, now in enumerate(whole):
        past = fade * past + (1 - fade) * now
        if now > 0:
            crept[i] = np.exp(-CREEP * np.minimum(past / now, 1.5).sum())
    felt = whole > FELT
    where = places[number[felt]]
    clean = np.column_stack(
        [world.potentials(where), world.divider(where, whole[felt], crept[felt])]
    )
    values = np.column_stack([rng.uniform(0, 1, (len(whole), 2)), np.zeros(len(whole))])
    values[felt] = clean
    values[:, 2] += world.noise * rng.normal(size=len(whole))
    values[felt, :2] += world.noise * rng.normal(size=(int(felt.sum()), 2))
    position, told = np.full((2, len(whole), 3), np.nan)
    position[felt] = np.column_stack([where, np.zeros(len(where))])
    told[:, 2] = np.where(felt, whole, 0.0)
    return Recording.from_arrays(
        layout,
        np.clip(values, 0, 1)[:, None],
        stamp_ns=np.round(np.arange(len(whole)) / RATE_HZ * 1e9).astype(np.int64),
        tare=np.arange(len(whole)) < RATE_HZ,
        truth={
            'position': position,
            'force': told,
            'in_contact': felt.astype(np.int8),
            'repetition': np.maximum(number, 0),
        },
    )
