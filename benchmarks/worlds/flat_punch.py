# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Round flat punch on a bonded layer, solved as an integral equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1

if TYPE_CHECKING:
    from tactile_ros.physics.elastomer import Layer
    from tactile_ros.types import Array

NODES = 400  # of the density, which waves that are felt do not outrun
DEEP = 36.0  # wave number times depth, beyond which nothing is felt
POINTS = 5  # Gauss points in half a wave
SPACING = 1e-4  # m, of the table over the distance from the axis


class FlatPunch:
    """Movement of a bonded layer under a round smooth flat head, for each metre that it sinks.

    Its pressure has a root at the edge that no map of squares follows. As cosines of an even
    density over the radius it is finite everywhere, and the layer adds a smooth integral equation
    to the half-space's (Sneddon, Fourier Transforms, 1951; Lebedev and Ufliand, PMM 22, 1958).

    Parameters
    ----------
    layer : Layer
        Free surface at its thickness.
    radius, farthest : float
        Of the head, and how far from its axis movements are asked for (m).
    """

    def __init__(self, layer: Layer, radius: float, farthest: float) -> None:
        self.layer, self.radius, self.farthest = layer, radius, farthest
        wave, weight = _panels(DEEP / layer.thickness, np.pi / radius)
        sinks = -layer.pressed(wave, np.array([layer.thickness]))[1][:, 0]
        soft = (1 - layer.poisson_ratio) / layer.shear_modulus
        node, share = np.polynomial.legendre.leggauss(NODES)
        self._at, share = radius * (1 + node) / 2, radius * share / 2
        cosine = np.cos(np.outer(self._at, wave))
        kernel = (cosine * ((sinks * wave / soft - 1) * weight)) @ cosine.T
        matrix = np.eye(NODES) + 2 / np.pi * kernel * share
        density = np.linalg.solve(matrix, np.full(NODES, 2 / np.pi))
        self._density = density * share / soft

    def pressure(self, wave: Array) -> Array:
        """Hankel transform (n,) of the pressure at wave numbers (n,) (Pa m2 / m)."""
        return np.asarray(np.cos(np.outer(wave, self._at)) @ self._density)

    def movement(self, depth: float) -> CubicSpline:
        """Movement at a depth (m) below the surface, over the distance from the axis (m).

        Returns
        -------
        CubicSpline
            Distances (...) -> (..., 2): away from the axis and up, for a head that sinks by 1.

        Examples
        --------
        What sinks under the head goes sideways in a layer that keeps its volume:

        >>> from tactile_ros.physics.elastomer import Layer
        >>> punch = FlatPunch(Layer(4e-3, 3e4, 0.49), 6e-3, 20e-3)
        >>> away, up = punch.movement(1e-3)(5e-3)
        >>> bool(away > 0 > up > -1)
        True
        """
        distance = np.arange(0.0, self.farthest + 2 * SPACING, SPACING)
        wave, weight = _panels(DEEP / depth, np.pi / (self.farthest + self.radius))
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
