"""A soft layer of finite thickness, bonded to a rigid base, under tractions on its surface.

The exact solution, wave by wave: for a wave vector of length q the displacement along it, that
along z and the tractions on a plane z = const obey four linear equations of first order, whose
eigenvalues are +-q, each twice; the displacement across the wave decouples. Any Poisson ratio up
to one half. In a nearly incompressible layer what sinks must go sideways: the squeeze moves a
magnet more than the dent does, which neither a half-space nor springs (Winkler) can show.

Source: Johnson, Contact Mechanics, 1985, secs. 2.1 and 5.8; Thomson (J. Appl. Phys. 21, 1950) for
the propagation from plane to plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools

Waves = npt.NDArray[np.complex128]
LEAST = 1e-4  # thickness times wave number, below which a wave is even
STEEP = 40.0  # beyond which a wave does not reach the base
ROUNDS, CLOSE = 200, 1e-7


@dataclass(frozen=True)
class Layer:
    """A soft layer on a rigid base at z = 0, its free surface at z = thickness.

    Attributes
    ----------
    thickness : float
        (m).
    shear_modulus : float
        (Pa).
    poisson_ratio : float
        0 to 0.5.
    """

    thickness: float
    shear_modulus: float
    poisson_ratio: float = 0.5

    def response(self, kx: Array, ky: Array, z: float) -> Waves:
        """Displacement at a height that tractions on the surface cause, wave by wave.

        Parameters
        ----------
        kx, ky : ndarray, shape (...)
            Wave vector (rad / m).
        z : float
            Height over the base, 0 to the thickness (m).

        Returns
        -------
        ndarray of complex, shape (..., 3, 3)
            Displacement along x, y, z for tractions along x, y, z (m / Pa).
        """
        q = np.hypot(kx, ky)
        even = q * self.thickness < LEAST
        k = np.where(even, LEAST / self.thickness, q)
        along = np.stack([np.where(even, 1.0, kx / k), np.where(even, 0.0, ky / k)], axis=-1)
        plane = self._in_plane(k, z)
        plane[even] = self._even(z)
        deep = k * self.thickness
        across = _sinh_over_cosh(k * z, deep) / (self.shear_modulus * k)
        across = np.where(even, z / self.shear_modulus, across)
        ex, ey = along[..., 0], along[..., 1]
        found = np.zeros((*q.shape, 3, 3), complex)
        for i, a in enumerate((ex, ey)):
            for j, b in enumerate((ex, ey)):
                beside = (-ey, ex)[i] * (-ey, ex)[j]
                found[..., i, j] = a * b * plane[..., 0, 0] + beside * across
            # displacement and traction along the wave are a quarter of it ahead
            found[..., i, 2] = 1j * a * plane[..., 0, 1]
            found[..., 2, i] = -1j * a * plane[..., 1, 0]
        found[..., 2, 2] = plane[..., 1, 1]
        return found

    def pressed(self, numbers: Array, heights: Array) -> tuple[Array, Array]:
        """Movement that a pressure wave of amplitude one on the surface causes.

        Parameters
        ----------
        numbers : ndarray, shape (...)
            Wave numbers k (rad / m).
        heights : ndarray, shape (h,)
            Over the base, 0 to the thickness (m).

        Returns
        -------
        across, up : ndarray, shape (..., h)
            Amplitudes (m / Pa): the movement along k is i times `across`, that along z is `up`.

        Examples
        --------
        A long wave squeezes a column, a short one sees a half-space:

        >>> layer = Layer(4e-3, 1e5 / 2.6, 0.3)
        >>> up = layer.pressed(np.array([1.0, 1e5]), np.array([4e-3]))[1][:, 0]
        >>> column = 4e-3 * (1 + 0.3) * (1 - 0.6) / (0.7 * 1e5)
        >>> bool(np.isclose(up[0], -column, rtol=1e-4))
        True
        >>> bool(np.isclose(up[1], -2 * (1 - 0.3**2) / (1e5 * 1e5)))
        True
        """
        k = np.maximum(np.asarray(numbers, np.float64), LEAST / self.thickness)
        moved = np.stack([self._in_plane(k, float(z))[..., 1] for z in heights], axis=-1)
        return -moved[..., 0, :], -moved[..., 1, :]

    def _even(self, z: float) -> Array:
        """The same (2, 2) for a load that is the same everywhere."""
        nu = self.poisson_ratio
        sink = (1 - 2 * nu) / (2 * (1 - nu))
        return z / self.shear_modulus * np.diag([1.0, sink])

    def _in_plane(self, k: Array, z: float) -> Array:
        """Displacement (..., 2) along the wave and z for tractions along both: (..., 2, 2)."""
        deep = np.minimum(k * self.thickness, STEEP)
        up = deep - k * (self.thickness - z)  # from the base, or from a depth without effect
        top = _propagated(deep, self.poisson_ratio)[..., 2:, 2:]
        here = _propagated(np.maximum(up, 0.0), self.poisson_ratio)[..., :2, 2:]
        a, b, c, d = (top[..., i, j] for i in (0, 1) for j in (0, 1))
        inverse = np.stack([d, -b, -c, a], axis=-1).reshape(*k.shape, 2, 2)
        inverse /= (a * d - b * c)[..., None, None]
        share = np.exp(np.maximum(up, 0.0) - deep) / (self.shear_modulus * k)
        return np.where(up[..., None, None] >= 0, here @ inverse * share[..., None, None], 0.0)

    def displacement(self, tractions: Array, pitch: float, z: float) -> Array:
        """Displacement under a map of tractions that repeats itself beyond its edges.

        Parameters
        ----------
        tractions : ndarray, shape (ny, nx, 3)
            On the surface, on squares of the pitch (Pa).
        pitch : float
            (m).
        z : float
            Height over the base (m).

        Returns
        -------
        ndarray, shape (ny, nx, 3)
            At the same places (m).
        """
        return self.under(tractions, self.response(*_waves(tractions.shape[:2], pitch), z))

    @staticmethod
    def under(tractions: Array, response: Waves) -> Array:
        """Displacement (ny, nx, 3) under tractions (ny, nx, 3) by a response of all waves."""
        waves = np.fft.rfft2(tractions, axes=(0, 1))
        moved = np.einsum('yxij,yxj->yxi', response, waves)
        return np.asarray(np.fft.irfft2(moved, s=tractions.shape[:2], axes=(0, 1)))

    def punch(self, covered: Bools, pitch: float, depth: float) -> Array:
        """Tractions under a smooth flat punch.

        Parameters
        ----------
        covered : ndarray of bool, shape (ny, nx)
            Squares under the punch.
        pitch : float
            Of the squares (m).
        depth : float
            By which they sink (m).

        Returns
        -------
        ndarray, shape (ny, nx, 3)
            (Pa); along z only.
        """
        sink = self.response(*_waves(covered.shape, pitch), self.thickness)[..., 2, 2].real
        pressure = flat_pressure(sink, covered, -depth)
        return np.stack([0 * pressure, 0 * pressure, pressure], axis=-1)


def flat_pressure(give: Array, covered: Bools, height: float) -> Array:
    """Pressure (m, n) on the squares of a map that are covered, so that all of them move alike.

    Parameters
    ----------
    give : ndarray, shape (m, n // 2 + 1)
        Movement under a pressure wave of amplitude one (m / Pa), as a real transform orders them.
    covered : ndarray of bool, shape (m, n)
        Squares under the punch.
    height : float
        By which they move (m).

    Notes
    -----
    Conjugate gradients on the squares that are covered.
    """
    flat = covered.astype(np.float64)
    pressure, left = np.zeros(covered.shape), height * flat
    step, size = left.copy(), float((left * left).sum())
    goal = CLOSE**2 * size
    for _ in range(ROUNDS):
        if size <= goal:
            break
        answer = np.fft.irfft2(np.fft.rfft2(step) * give, s=covered.shape) * flat
        length = size / float((step * answer).sum())
        pressure, left = pressure + length * step, left - length * answer
        former, size = size, float((left * left).sum())
        step = left + size / former * step
    return pressure


def _waves(shape: tuple[int, ...], pitch: float) -> tuple[Array, Array]:
    """Wave vectors of a map (ny, nx), as a real transform orders them (rad / m)."""
    ky = 2 * np.pi * np.fft.fftfreq(shape[0], pitch)
    kx = 2 * np.pi * np.fft.rfftfreq(shape[1], pitch)
    grid = np.meshgrid(kx, ky)
    return grid[0], grid[1]


def _sinh_over_cosh(a: Array, b: Array) -> Array:
    """Sinh a / cosh b for 0 <= a <= b."""
    return np.asarray(np.exp(a - b) * -np.expm1(-2 * a) / (1 + np.exp(-2 * b)))


def _propagated(height: Array, poisson_ratio: float) -> Array:
    """exp(A h) / exp(h), shape (..., 4, 4), of displacements and tractions over a height h.

    Displacement along the wave (a quarter ahead) and z, tractions over shear modulus and wave
    number in the same order; lengths in radians.
    """
    nu = poisson_ratio
    ratio = nu / (1 - nu)
    change = np.array(
        [
            [0.0, -1.0, 1.0, 0.0],
            [ratio, 0.0, 0.0, (1 - 2 * nu) / (2 * (1 - nu))],
            [2 / (1 - nu), 0.0, 0.0, -ratio],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    cosh, sinh = 0.5 * (1 + np.exp(-2 * height)), -0.5 * np.expm1(-2 * height)
    third = 0.5 * (height * cosh - sinh)
    powers = np.stack([np.linalg.matrix_power(change, n) for n in range(4)])
    shares = np.stack([cosh - 0.5 * height * sinh, sinh - third, 0.5 * height * sinh, third])
    return np.asarray(np.einsum('n...,nij->...ij', shares, powers))
