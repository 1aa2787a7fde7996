"""How an incompressible soft body on a rigid base gives way to a load on its surface.

A load on the free surface of an incompressible half-space moves a point at r by
(F / r + (F . r) r / r^3) / (4 pi G), whatever its direction (Boussinesq and Cerruti with a
Poisson ratio of one half; Johnson, Contact Mechanics, 1985, secs. 3.2 and 3.6). A base to which
the body is bonded holds it: the images of Blake (Proc. Camb. Phil. Soc. 70, 1971) make the
displacement vanish there. The truth of a layer on a base lies between the two.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1

from tactile_ros.physics.coverage import inside
from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.physics.magnet_sheet import Sheet
    from tactile_ros.types import Array, Outline

Waves = npt.NDArray[np.complex128]
LEAST = 1e-4  # thickness times wave number, below which a wave is even
LAYER_RESPONSE_STEEP = 40.0  # beyond which a wave does not reach the base
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
        deep = np.minimum(k * self.thickness, LAYER_RESPONSE_STEEP)
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


ALONG = (28, 96)  # cells of a punch along its longer side, at least and at most
FINE = 8  # cells in the height of the layer
WIDE = 5.0  # layers of room around a punch


def wave_numbers(count: int, pitch: float) -> tuple[Array, Array]:
    """Wave numbers kx (n, 1) and ky (1, n // 2 + 1) of a periodic square grid (rad / m)."""
    kx: Array = 2 * np.pi * np.fft.fftfreq(count, pitch)  # type: ignore[assignment]
    ky: Array = 2 * np.pi * np.fft.rfftfreq(count, pitch)  # type: ignore[assignment]
    return kx[:, None], ky[None]


def punch_pressure(loops: Sequence[Array], layer: Layer, finer: int = 1) -> tuple[Array, Array]:
    """Loads under a flat punch without friction, for one metre of depth.

    Parameters
    ----------
    loops : sequence of ndarray, shape (n, 2)
        Its outline (m).
    layer : Layer
        Under it.
    finer : int
        So many times as many cells along a side as are usual.

    Returns
    -------
    points : ndarray, shape (p, 2)
        Centres of the cells of a square grid inside the outline (m).
    loads : ndarray, shape (p,)
        Force on each of them per depth (N / m).

    Raises
    ------
    ValueError
        If the outline covers no cell.
    """
    corners = np.concatenate(list(loops))
    low, high = corners.min(axis=0), corners.max(axis=0)
    length = float((high - low).max())
    pitch = max(min(length / ALONG[0], layer.thickness / FINE), length / ALONG[1]) / finer
    count = int(2 ** np.ceil(np.log2((length + WIDE * layer.thickness) / pitch)))
    line = (np.arange(count) - (count - 1) / 2) * pitch
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1) + (low + high) / 2
    under = inside(loops, places.reshape(-1, 2)).reshape(count, count)
    if not under.any():
        msg = f'outline of a punch must cover an area; received {len(corners)} corners that do not'
        raise ValueError(msg)
    kx, ky = wave_numbers(count, pitch)
    give = -layer.pressed(np.hypot(kx, ky), np.array([layer.thickness]))[1][..., 0]
    pressure = flat_pressure(give, under, 1.0)
    return places[under], pressure[under] * pitch**2


def at_pose(points: Array, pose: Array) -> Array:
    """Points (p, 2) of an outline's frame at a pose: place (m) and turn (rad), shape (2, p).

    Examples
    --------
    >>> at_pose(np.array([[1.0, 0.0]]), np.array([2.0, 3.0, np.pi / 2])).round(12).tolist()
    [[2.0], [4.0]]
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(np.array([[c, -s], [s, c]]) @ points.T + pose[:2, None])


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


ROOM = 1.6  # of the sheet: a periodic grid on which dents do not meet themselves
EVEN = 6  # cells of the grid are a multiple of it
STEP = 1e-3  # of the layer, over which movements are differentiated
NEAR = 0.5  # shift of the grid, in cells, where the sheet has an even number of them


def punched_waves(body: Layer, heights: Array, kx: Array, ky: Array) -> Array:
    """What a wave of pressure does in a layer, whose wave vectors are a grid.

    Parameters
    ----------
    body : Layer
        The whole body.
    heights : ndarray, shape (h,)
        Over the base (m).
    kx, ky : ndarray, shape (m, 1) and (1, n)
        Wave vectors (rad / m).

    Returns
    -------
    ndarray, shape (5, h, m, n)
        ux, uy, uz (m / Pa), and turns about x and y (rad / Pa).
    """
    k = np.hypot(kx, ky)
    step = STEP * body.thickness
    steps = np.concatenate([heights - step, heights, heights + step])
    across, up = body.pressed(k, np.clip(steps, 0.0, body.thickness))
    n = len(heights)
    moved = [np.moveaxis(wave, -1, 0) for wave in (across, up)]
    slope = (moved[0][2 * n :] - moved[0][:n]) / (2 * step)
    along, lift = moved[0][n : 2 * n], moved[1][n : 2 * n]
    k = np.maximum(k, 1e-9)
    cx, cy = kx / k, ky / k
    # half the curl; lateral movement is a gradient, so that nothing turns about z
    turn = 0.5 * (k * lift - slope)
    return np.stack([1j * along * cx, 1j * along * cy, lift + 0j, 1j * turn * cy, -1j * turn * cx])


class PunchDents:
    """Dents of flat punches in one layer, for one metre of depth.

    Parameters
    ----------
    sheet : Sheet
        In the layer; gives cells and heights.
    base : float
        Height of the rigid base (m).
    body : Layer
        The whole body.
    """

    def __init__(self, sheet: Sheet, base: float, body: Layer) -> None:
        self.pitch = sheet.pitch
        longest = max(len(line) for line in sheet.lines)
        self.count = EVEN * int(np.ceil(ROOM * longest / EVEN))
        self.shift = np.array([(NEAR if len(line) % 2 == 0 else 0.0) for line in sheet.lines])
        self.body = body
        self.kx, self.ky = wave_numbers(self.count, self.pitch)
        self.waves = punched_waves(body, sheet.levels - base, self.kx, self.ky) / self.pitch**2

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        return punch_pressure(outline.loops, self.body)

    def images(self, points: Array, loads: Array, pose: Array) -> Array:
        """Movements and turns for a unit of depth.

        Parameters
        ----------
        points, loads : ndarray, shape (p, 2) and (p,)
            Of `loads`.
        pose : ndarray, shape (3,)
            Place of the outline's origin (m), and its turn (rad).

        Returns
        -------
        ndarray, shape (5, 2, n, n)
            ux, uy, uz (m / m), turns about x and y (rad / m), on two levels, at cells whose
            centres are `shift` beyond multiples of the pitch.
        """
        x, y = at_pose(points, pose)
        x, y = x - self.shift[0] * self.pitch, y - self.shift[1] * self.pitch
        first = np.exp(-1j * self.kx * x) * loads
        spectrum = first @ np.exp(-1j * self.ky.T * y).T
        shape = (self.count, self.count)
        return np.asarray(np.fft.irfft2(self.waves * spectrum, shape, axes=(-2, -1)))

    def on_sheet(self, sheet: Sheet, images: Array) -> Array:
        """Movements and turns at a sheet's dipoles, shape (5, x y 2), from those at all cells."""
        rows = [self.index(line, axis) for axis, line in enumerate(sheet.lines)]
        cut = images[:, :, rows[0][:, None], rows[1][None]]
        return np.moveaxis(cut, 1, -1).reshape(len(images), -1)

    def index(self, line: Array, axis: int) -> Array:
        """Number of the cells on the periodic grid of centres (n,) along an axis (m)."""
        found = np.rint(line / self.pitch - self.shift[axis]).astype(int) % self.count
        return np.asarray(found)


FINER = 2  # cells of a punch, whose rim decides
PITCHES = 128  # of the shortest wave, in the period
PUNCHED_CARPET_ROOM = (
    1.6  # of the nodes' longer side: dents do not meet themselves within this period
)


class PunchedCarpet:
    """Nodes in one bonded layer.

    Parameters
    ----------
    layer : Layer
        Bonded to its base at z = 0.
    x, y, heights : ndarray, shape (m,), (n,) and (h,)
        Nodes (m).
    """

    def __init__(self, layer: Layer, x: Array, y: Array, heights: Array) -> None:
        self.layer, self.shape = layer, (len(x), len(y), len(heights))
        period = PUNCHED_CARPET_ROOM * max(float(np.ptp(x)), float(np.ptp(y)))
        self.kx, self.ky = wave_numbers(PITCHES, period / PITCHES)
        self.waves = punched_waves(layer, heights, self.kx, self.ky) / period**2
        # a real transform has half of the waves along y: those between its ends count twice
        twice = np.where(np.arange(self.ky.shape[1]) % (PITCHES // 2) == 0, 1.0, 2.0)
        self.along_x = np.exp(1j * self.kx * x)
        self.along_y = twice[:, None] * np.exp(1j * self.ky.T * y)

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        return punch_pressure(outline.loops, self.layer, FINER)

    def under(self, points: Array, loads: Array, pose: Array) -> tuple[Array, Array]:
        """Movements and turns for one metre of depth.

        Parameters
        ----------
        points, loads : ndarray, shape (p, 2) and (p,)
            Of `loads`.
        pose : ndarray, shape (3,)
            Place of the outline's origin (m), and its turn (rad).

        Returns
        -------
        moved, turned : ndarray, shape (m n h, 3)
            (m / m) and (rad / m), height by height within a node.
        """
        x, y = at_pose(points, pose)
        # waves of a row are powers of the longest one; x has those of both signs
        rows = self._powers(x)
        rows = np.concatenate([rows[:-1], rows[:0:-1].conj()]) * loads
        spectrum = rows @ self._powers(y).T
        waves = np.matmul(self.waves * spectrum, self.along_y)
        found = np.matmul(self.along_x.T, waves).real
        flat = np.moveaxis(found, 1, -1).reshape(len(found), -1)
        turned = np.column_stack([flat[3], flat[4], np.zeros(flat.shape[1])])
        return np.ascontiguousarray(flat[:3].T), turned

    def _powers(self, at: Array) -> Array:
        """Waves of rising number (PITCHES / 2 + 1, p) at points (p,) along an axis (m)."""
        longest = np.exp(-1j * self.ky[0, 1] * at)
        waves = np.broadcast_to(longest, (PITCHES // 2, len(at)))
        return np.asarray(np.cumprod(np.concatenate([np.ones((1, len(at))), waves]), axis=0))


# Hexagon and centre: integrates polynomials up to the fifth degree over a disc
# (Abramowitz and Stegun, 25.4.61).
RING = np.arange(6) * np.pi / 3
DISC = np.vstack([np.zeros(2), np.sqrt(2 / 3) * np.column_stack([np.cos(RING), np.sin(RING)])])
SHARES = np.array([0.25] + [0.125] * 6)
NEAREST = 1e-5  # m, inside which a load counts as spread out


def point_load(points: Array, loads: Array, forces: Array, shear_modulus: float) -> Array:
    """Displacement of a half-space under point loads on its surface.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        Where it is wanted (m).
    loads : ndarray, shape (..., 3)
        Where the loads act (m).
    forces : ndarray, shape (..., 3)
        On the body (N).
    shear_modulus : float
        Of the body (Pa).

    Returns
    -------
    ndarray, shape (..., 3)
        Displacements (m).

    Examples
    --------
    >>> down = np.array([0.0, 0.0, -1.0])
    >>> 1e6 * point_load(5e-3 * down, 0 * down, down, 1e5).round(9)
    array([   0.   ,    0.   , -318.309])
    """
    r = points - loads
    near = 1 / np.sqrt((r * r).sum(axis=-1, keepdims=True) + NEAREST**2)
    along = (forces * r).sum(axis=-1, keepdims=True)
    moved: Array = (forces * near + along * r * near**3) / (4 * np.pi * shear_modulus)
    return moved


def base_image(points: Array, loads: Array, forces: Array, shear_modulus: float) -> Array:
    """Displacement that a rigid base at z = 0 adds to `point_load`, which takes the same.

    Notes
    -----
    Blake (1971), Eq. (2.3), doubled as the free surface doubles the load's own field.

    Examples
    --------
    >>> base, load = np.array([3e-3, 0.0, 0.0]), np.array([0.0, 0.0, 4e-3])
    >>> force = np.array([1.0, 2.0, -3.0])
    >>> held = [f(base, load, force, 1e5) for f in (point_load, base_image)]
    >>> bool(np.abs(sum(held)).max() < 1e-5 * np.abs(held[0]).max())
    True
    """
    height = loads[..., 2:]
    mirrored = forces * np.array([1.0, 1.0, -1.0])
    r = points - loads * np.array([1.0, 1.0, -1.0])
    near = 1 / np.linalg.norm(r, axis=-1, keepdims=True)
    z, up = r[..., 2:], np.array([0.0, 0.0, 1.0])
    along = (forces * r).sum(axis=-1, keepdims=True)
    across = (mirrored * r).sum(axis=-1, keepdims=True)
    lift = mirrored[..., 2:]
    dipoles = height * (mirrored * near**3 - 3 * r * across * near**5)
    dipoles += (up * across - mirrored * z - r * lift) * near**3 + 3 * r * z * across * near**5
    moved: Array = -forces * near - along * r * near**3 + 2 * height * dipoles
    return moved / (4 * np.pi * shear_modulus)


def disc_press(
    points: Array,
    contacts: Array,
    normals: Array,
    forces: Array,
    radius: Array,
    shear_modulus: float,
    bond: Array,
) -> Array:
    """Displacement under even pressure on discs of the surface.

    Parameters
    ----------
    points : ndarray, shape (s, m, 3)
        Where it is wanted (m).
    contacts, normals : ndarray, shape (s, 3)
        Centres of the discs (m), and what they are normal to.
    forces : ndarray, shape (s, 3)
        On the body (N).
    radius : ndarray, shape (s,)
        Of the discs (m).
    shear_modulus : float
        Of the body (Pa).
    bond : ndarray, shape (s,)
        Share of the base's image, 0 (half-space) to 1 (bonded at z = 0).

    Returns
    -------
    ndarray, shape (s, m, 3)
        Displacements (m).
    """
    first = np.cross(normals, np.array([1.0, 0.0, 0.0]))
    flat = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.where(flat > 1e-6, first / np.maximum(flat, 1e-6), np.array([0.0, 1.0, 0.0]))
    second = np.cross(normals, first)
    moved = np.zeros_like(points)
    held = bool(np.any(bond))
    for (u, v), share in zip(DISC, SHARES, strict=True):
        load = (contacts + radius[:, None] * (u * first + v * second))[:, None]
        part = share * forces[:, None]
        moved += point_load(points, load, part, shear_modulus)
        if held:
            moved += bond[:, None, None] * base_image(points, load, part, shear_modulus)
    return moved
