# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A five-wire skin of its own: an uneven border as a line, a sine series inside, a rough film.

The border conducts so well that it alone sets the potential of the edges of the sheet; inside,
a series of sines solves the equation of Laplace. The power law of the film varies by bumps.
Nothing of it is shared with the model of the package.
"""

import numpy as np

from tactile_ros.types import Layout, Recording

EDGE = 200  # pieces of an edge of the border
TERMS = 60


class FiveWireWorld:
    """Readings of touches on a square sheet of `size` (m)."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.size, self.noise = 0.1, 2.5e-4
        turn = 2 * np.pi * (np.arange(4 * EDGE) + 0.5) / (4 * EDGE)
        waves = np.arange(1, 9)
        phase, height = rng.uniform(0, 2 * np.pi, 8), rng.normal(size=8) / waves**0.7
        bump = np.sin(np.outer(turn, waves) + phase) @ height
        resistance = np.exp(0.3 * bump / bump.std())
        self.edges = [self._edges(resistance, 0), self._edges(resistance, EDGE)]
        self.centres = rng.uniform(-0.1, 1.1, (30, 2))
        self.gain, self.steepness = rng.normal(size=(2, 30))

    @staticmethod
    def _edges(resistance: np.ndarray, start: int) -> tuple[np.ndarray, np.ndarray]:
        """Corner potentials A B C D and sine coefficients of AB BC DC AD; 1 V at `start`."""
        turned = np.roll(resistance, -start)
        there, back = np.cumsum(turned[: 2 * EDGE]), np.cumsum(turned[2 * EDGE :])
        u = np.concatenate([[1.0], 1 - there / there[-1], back / back[-1]])[:-1]
        u = np.roll(u, start)
        u = np.append(u, u[0])
        lines = [u[: EDGE + 1], u[EDGE : 2 * EDGE + 1]]
        lines += [u[2 * EDGE : 3 * EDGE + 1][::-1], u[3 * EDGE :][::-1]]
        x = np.linspace(0, 1, EDGE + 1)
        sine = np.sin(np.pi * np.outer(np.arange(1, TERMS), x))
        rest = [line - line[0] - (line[-1] - line[0]) * x for line in lines]
        corners = np.array([lines[0][0], lines[0][-1], lines[2][-1], lines[2][0]])
        return corners, np.array([2 * (sine * r).sum(axis=1) / EDGE for r in rest])

    def potentials(self, places: np.ndarray) -> np.ndarray:
        """u_AC and u_BD (s, 2) at places (s, 2)."""
        x, y = (places / self.size).T
        n = np.arange(1, TERMS)

        def away(t: np.ndarray) -> np.ndarray:
            return np.exp(np.pi * np.outer(t - 1, n)) * -np.expm1(-2 * np.pi * np.outer(t, n))

        sines = [np.sin(np.pi * np.outer(t, n)) for t in (x, y)]
        found = []
        for (a, b, c, d), edge in self.edges:
            flat = a * (1 - x) * (1 - y) + b * x * (1 - y) + c * x * y + d * (1 - x) * y
            bent = (sines[0] * away(1 - y)) @ edge[0] + (sines[1] * away(x)) @ edge[1]
            bent += (sines[0] * away(y)) @ edge[2] + (sines[1] * away(1 - x)) @ edge[3]
            found.append(flat + bent)
        return np.stack(found, axis=1)

    def readings(
        self, places: np.ndarray, force: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Noisy readings (s, 3) of touches."""
        apart = ((places / self.size)[:, None] - self.centres) ** 2
        bumps = np.exp(-apart.sum(axis=2) / (2 * 0.25**2))
        film = (
            2000
            * np.exp(0.15 * bumps @ self.gain)
            * force ** -(0.7 * (1 + 0.03 * bumps @ self.steepness))
        )
        edge = np.min([places, self.size - places], axis=(0, 2)) / self.size
        divider = 1000 / (1000 + 40 * np.sqrt(2 * edge) + film)
        clean = np.column_stack([self.potentials(places), divider])
        return clean + self.noise * rng.normal(size=clean.shape)

    def bound(self, places: np.ndarray) -> float:
        """Mean error of a place (m) by the noise of the potentials alone."""
        step = 1e-6
        slopes = np.stack(
            [
                (self.potentials(places + d) - self.potentials(places - d)) / (2 * step)
                for d in step * np.eye(2)
            ],
            axis=-1,
        )
        noise = self.noise * np.random.default_rng(0).normal(size=places.shape)
        return float(np.linalg.norm(np.linalg.solve(slopes, noise[..., None]), axis=1).mean())


def grid(count: int, size: float = 0.1, border: float = 12.5e-3) -> np.ndarray:
    """Places of a square grid, shape (count squared, 2)."""
    line = np.linspace(border, size - border, count)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def touches(
    world: FiveWireWorld,
    layout: Layout,
    places: np.ndarray,
    force: np.ndarray,
    seed: int,
    floating: bool = True,
) -> Recording:
    """A stream: five tare rows, then touches; every tenth row is untouched."""
    rng = np.random.default_rng(seed)
    rest = 5 + len(places) // 9
    values = np.concatenate([np.full((rest, 3), 1e-3), world.readings(places, force, rng)])
    values[:rest] += world.noise * rng.normal(size=(rest, 3))
    if floating:
        values[:rest, :2] = rng.uniform(0, 1, (rest, 2))
    position = np.full((len(values), 3), np.nan)
    position[rest:] = np.column_stack([places, np.zeros(len(places))])
    told = np.full((len(values), 3), np.nan)
    told[:, 2] = np.concatenate([np.zeros(rest), force])
    order = np.concatenate([np.arange(5), 5 + rng.permutation(len(values) - 5)])
    touched = np.concatenate([np.zeros(rest), np.ones(len(places))]).astype(np.int8)
    return Recording.from_arrays(
        layout,
        np.clip(values, 0, 1)[order, None],
        stream=np.zeros(len(values), int),
        tare=np.arange(len(values)) < 5,
        truth={'position': position[order], 'force': told[order], 'in_contact': touched[order]},
    )
