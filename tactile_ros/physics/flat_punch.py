"""A round smooth flat punch on a bonded layer, exact for any Poisson ratio.

Its pressure has a root at the edge that no map of squares follows. As cosines of an even density
over the radius it is finite everywhere, and the layer adds a smooth integral equation to the
half-space's (Sneddon, Fourier Transforms, 1951; Lebedev and Ufliand, PMM 22, 1958).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1

from tactile_ros.physics.layer_response import Layer
from tactile_ros.types import Array

NODES = 400  # of the density, which waves that are felt do not outrun
STEEP = 36.0  # wave number times depth, beyond which nothing is felt
POINTS = 5  # Gauss points in half a wave
SPACING = 1e-4  # m, of the table over the distance from the axis


@dataclass(frozen=True)
class FlatPunch:
    """Movement of a bonded layer under a round head, for each metre by which it sinks.

    Attributes
    ----------
    layer : Layer
        Free surface at its thickness.
    radius, farthest : float
        Of the head, and how far from its axis movements are asked for (m).
    """

    layer: Layer
    radius: float
    farthest: float
    _density: tuple[Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, '_density', self._solved())

    def _solved(self) -> tuple[Array, Array]:
        """Radii (n,) and the density there times its weight, over the half-space's response."""
        wide, thickness = self.radius, self.layer.thickness
        wave, weight = _panels(STEEP / thickness, np.pi / wide)
        sinks = -self.layer.pressed(wave, np.array([thickness]))[1][:, 0]
        soft = (1 - self.layer.poisson_ratio) / self.layer.shear_modulus
        beside = sinks * wave / soft - 1
        node, share = np.polynomial.legendre.leggauss(NODES)
        radius, share = wide * (1 + node) / 2, wide * share / 2
        cosine = np.cos(np.outer(radius, wave))
        matrix = np.eye(NODES) + 2 / np.pi * (cosine * (beside * weight)) @ cosine.T * share
        density = np.linalg.solve(matrix, np.full(NODES, 2 / np.pi))
        return radius, density * share / soft

    def pressure(self, wave: Array) -> Array:
        """Hankel transform (n,) of the pressure at wave numbers (n,) (Pa m2 / m)."""
        radius, density = self._density
        return np.asarray(np.cos(np.outer(wave, radius)) @ density)

    def movement(self, depth: float) -> CubicSpline:
        """Movement at a depth (m) below the surface, over the distance from the axis (m).

        Returns
        -------
        CubicSpline
            Distances (...) -> (..., 2): away from the axis and up, for a head that sinks by 1.

        Examples
        --------
        What sinks under the head goes sideways in a layer that keeps its volume:

        >>> punch = FlatPunch(Layer(4e-3, 3e4, 0.49), 6e-3, 20e-3)
        >>> away, up = punch.movement(1e-3)(5e-3)
        >>> bool(away > 0 > up > -1)
        True
        """
        distance = np.arange(0.0, self.farthest + 2 * SPACING, SPACING)
        wave, weight = _panels(STEEP / depth, np.pi / (self.farthest + self.radius))
        across, up = self.layer.pressed(wave, np.array([self.layer.thickness - depth]))
        load = self.pressure(wave) * wave * weight
        phase = np.outer(distance, wave)
        moved = np.stack([-j1(phase) @ (load * across[:, 0]), j0(phase) @ (load * up[:, 0])], 1)
        return CubicSpline(distance, moved)


def _panels(end: float, width: float) -> tuple[Array, Array]:
    """Gauss points and weights of panels about as wide as `width`, from 0 to an end."""
    count = int(np.ceil(end / width))
    node, weight = np.polynomial.legendre.leggauss(POINTS)
    start = np.arange(count)[:, None] + (1 + node) / 2
    return (start * end / count).ravel(), np.tile(weight * end / count / 2, count)
