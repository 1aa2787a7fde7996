"""How a soft layer that is bonded to a rigid base gives way to a flat punch of any outline.

A pressure exp(i k x) on the face of a layer moves its inside along z and along k. For every wave
number the two follow from Navier's equations, with no movement at the base and no shear at the
face (Johnson, Contact Mechanics, 1985, sec. 5.7, for one wave; here with any Poisson ratio up to
one half). A flat punch is the pressure inside its outline that makes the face flat there, found
by conjugate gradients. Half-spaces and springs have the wrong sign of the lateral squeeze, which
moves the inside of a nearly incompressible layer more than the dent does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.outlines import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array, Bools

ALONG = (28, 96)  # cells of a punch along its longer side, at least and at most
FINE = 8  # cells in the height of the layer
WIDE = 5.0  # layers of room around a punch
ROUNDS = 200
CLOSE = 1e-6


def layer_waves(
    numbers: Array, heights: Array, thickness: float, youngs: float, poisson: float
) -> tuple[Array, Array]:
    """Movement inside a bonded layer under a pressure wave of amplitude one on its face.

    Parameters
    ----------
    numbers : ndarray, shape (...,)
        Wave numbers k (rad / m).
    heights : ndarray, shape (h,)
        Where it is wanted, above the base (m).
    thickness : float
        Of the layer (m).
    youngs, poisson : float
        Its modulus (Pa) and ratio (0 to 0.5).

    Returns
    -------
    across, up : ndarray, shape (..., h)
        Amplitudes (m / Pa): the movement along k is i times `across`, that along z is `up`.

    Examples
    --------
    >>> k = np.array([1.0, 1e5])  # a long wave squeezes a column; a short one sees a half-space
    >>> up = layer_waves(k, np.array([4e-3]), 4e-3, 1e5, 0.3)[1][:, 0]
    >>> column = 4e-3 * (1 + 0.3) * (1 - 0.6) / (0.7 * 1e5)
    >>> bool(np.isclose(up[0], -column, rtol=1e-4))
    True
    >>> bool(np.isclose(up[1], -2 * (1 - 0.3**2) / (1e5 * 1e5)))
    True
    """
    k = np.maximum(np.asarray(numbers, np.float64), 1e-3 / thickness)[..., None]
    top = k * thickness
    kappa, shear = 3 - 4 * poisson, youngs / (2 * (1 + poisson))
    a, b, c, d = _amplitudes(top[..., 0], kappa, poisson)
    z = k * np.asarray(heights, np.float64)
    # growing waves are told relative to the face, so that nothing overflows
    rise, fall = np.exp(z - top), np.exp(-z)
    across = (a + b * z) * rise + (c + d * z) * fall
    up = (a - kappa * b + b * z) * rise + (-c - kappa * d - d * z) * fall
    size = -1.0 / (shear * k)
    return size * across, size * up


def _amplitudes(top: Array, kappa: float, poisson: float) -> tuple[Array, ...]:
    """Amplitudes (..., 1) of growing and fading waves for a stress of one on the face."""
    low, high = np.exp(-top), np.ones_like(top)
    zero = np.zeros_like(top)
    rows = [
        [low, zero, high, zero],
        [low, -kappa * low, -high, -kappa * high],
        [
            2 * high, (2 * top + 1 - kappa) * high,
            -2 * low, (1 - kappa - 2 * top) * low,
        ],
        [
            2 * high, (2 * (1 - kappa + top) - 4 * poisson) * high,
            2 * low, (4 * poisson + 2 * (kappa - 1 + top)) * low,
        ],
    ]  # fmt: skip
    matrix = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    wanted = np.zeros((*top.shape, 4, 1))
    wanted[..., 3, 0] = 1.0
    solved = np.linalg.solve(matrix, wanted)[..., 0]
    return tuple(solved[..., i : i + 1] for i in range(4))


def wave_numbers(count: int, pitch: float) -> tuple[Array, Array]:
    """Wave numbers kx (n, 1) and ky (1, n // 2 + 1) of a periodic square grid (rad / m)."""
    kx: Array = 2 * np.pi * np.fft.fftfreq(count, pitch)  # type: ignore[assignment]
    ky: Array = 2 * np.pi * np.fft.rfftfreq(count, pitch)  # type: ignore[assignment]
    return kx[:, None], ky[None]


def punch_pressure(
    loops: Sequence[Array], thickness: float, youngs: float, poisson: float
) -> tuple[Array, Array]:
    """Loads under a flat punch without friction, for one metre of depth.

    Parameters
    ----------
    loops : sequence of ndarray, shape (n, 2)
        Its outline (m).
    thickness, youngs, poisson : float
        Of the layer (m, Pa, 1).

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
    pitch = max(min(length / ALONG[0], thickness / FINE), length / ALONG[1])
    count = int(2 ** np.ceil(np.log2((length + WIDE * thickness) / pitch)))
    line = (np.arange(count) - (count - 1) / 2) * pitch
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1) + (low + high) / 2
    under = inside(loops, places.reshape(-1, 2)).reshape(count, count)
    if not under.any():
        msg = f'outline of a punch must cover an area; received {len(corners)} corners that do not'
        raise ValueError(msg)
    kx, ky = wave_numbers(count, pitch)
    height = np.array([thickness])
    give = -layer_waves(np.hypot(kx, ky), height, thickness, youngs, poisson)[1][..., 0]
    pressure = _flat(give, under)
    return places[under], pressure[under] * pitch**2


def _flat(give: Array, under: Bools) -> Array:
    """Pressure inside a mask that lowers the face by one there, by conjugate gradients."""
    flat = under.astype(np.float64)
    pressure = np.zeros_like(flat)
    left = flat.copy()
    step, size = left.copy(), float((left * left).sum())
    first = size
    for _ in range(ROUNDS):
        answer = np.fft.irfft2(np.fft.rfft2(step) * give, flat.shape) * flat
        share = size / float((step * answer).sum())
        pressure += share * step
        left -= share * answer
        size, old = float((left * left).sum()), size
        if size < CLOSE**2 * first:
            break
        step = left + size / old * step
    return pressure
