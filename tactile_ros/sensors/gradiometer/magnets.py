"""Magnets nearby: what their field does to answers, told by what no place of the disc explains.

Four pixels have six differences and the disc has three freedoms, so that half of what a magnet's
field does shows in what the disc's model leaves over. The other half follows from it as far as
fields without sources tie them together; how strong the magnet is, the readings themselves say.
All of it is linear in the field, given the strength, and normal (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, app. A.2); strengths are weighed by their evidence.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.physics.compiled import available
from tactile_ros.physics.dipoles import dipole_field
from tactile_ros.sensors.gradiometer.magnet_rows import INEXACT, answered, weighed_rows, whitened
from tactile_ros.types import Array, Integers

REACH = 15e-3  # m, of a magnet that is near; farther ones differ less in shape than in strength
DIRECTIONS = 60
FREEDOMS = 3  # of the disc's place, which takes as many from the differences
WEAKEST, STRENGTHS = 0.5, 16  # of the noise; each twice as strong as the one before
NEAR, OCTAVES = 0.9, 1.0  # share of fields that are of a magnet about `REACH` away; its spread
TWO_SIGMAS, BANDS = 0.9545, 3
BLOCK = 512
DEGREES = (1, 2, 3)


class NearbyMagnets:
    """Error of answers in fields of magnets.

    Parameters
    ----------
    shape : ndarray, shape (m, m)
        Of `magnet_shape`.
    share : float
        Root mean square of a difference over that of the field itself, of such magnets.

    Attributes
    ----------
    factor_ : ndarray, shape (k,)
        On the deviations of answers, so that two of them hold 95.45 % beside simulated magnets.
    slopes_ : PolynomialRidge
        Change of answers and of what the disc's model leaves over with each difference, of the
        disc's place.
    width_ : int
        How many quantities slopes are along: m differences, and the disc's temperature if any.
    """

    factor_: Array
    slopes_: PolynomialRidge
    width_: int

    def __init__(self, shape: Array, share: float) -> None:
        self.shape = shape
        self.share = share

    def fit(self, place: Array, slopes: Array) -> NearbyMagnets:
        """Learn slopes (s, k + m, m + h) of k answers and m left over, of the place (s, 3).

        The last h are along the disc's temperature, in its unit.
        """
        self.width_ = slopes.shape[2]
        self.slopes_ = PolynomialRidge(DEGREES).fit(place, slopes.reshape(len(slopes), -1))
        self.factor_ = np.ones(slopes.shape[1] - len(self.shape))
        return self

    def calibrate(self, error: Array, mean: Array, cov: Array, way: Integers) -> None:
        """Learn the factor beside magnets, wherever they are: beside the sensor, over or under it.

        Parameters
        ----------
        error, mean, cov : ndarray, shape (s, k), (s, k), (s, k, k)
            Errors of answers, and what `error` said of them.
        way : ndarray of int, shape (s,)
            Direction of each magnet.
        """
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        ratio = np.abs(error - mean) / np.maximum(sigma, np.finfo(float).tiny)
        band = (BANDS * np.abs(1 - (2 * way + 1) / DIRECTIONS)).astype(int)
        worst = [np.quantile(ratio[band == one], TWO_SIGMAS, axis=0) for one in np.unique(band)]
        self.factor_ = np.max(worst, axis=0) / 2

    def slopes(self, place: Array) -> Array:
        """Slopes (s, k + m, m + h) (unit of the answers, and 1, over T) at places (s, 3)."""
        return self.slopes_.predict(place).reshape(len(place), -1, self.width_)

    def shaken(self, place: Array, cov: Array, count: int) -> Array:
        """Covariance (s, k, k) of k answers at places (s, 3) by one of differences (s, m, m)."""
        slopes = self.slopes(place)[:, :count, : len(self.shape)]
        return np.asarray(np.matmul(np.matmul(slopes, cov), slopes.transpose(0, 2, 1)))

    def error(
        self, place: Array, left: Array, noise: Array, size: Array, gains: float
    ) -> tuple[Array, Array]:
        """What a field that is not the disc's adds to answers.

        Parameters
        ----------
        place : ndarray, shape (s, 3)
            Of the disc.
        left : ndarray, shape (s, m)
            Differences that the disc's model leaves over, less those that it always does (T).
        noise : ndarray, shape (s,)
            Standard deviation of each freedom of them without a magnet (T).
        size : ndarray, shape (s,)
            Of the stray field (T).
        gains : float
            What gains and crossed axes are uncertain by (1).

        Returns
        -------
        mean, cov : ndarray, shape (s, k), (s, k, k)
            (Unit of the answers, and squared.)
        """
        width = len(self.shape)
        count = self.slopes_.level_.size // self.width_ - width
        mean, cov = np.empty((len(place), count)), np.empty((len(place), count, count))
        for i in range(0, len(place), BLOCK):
            part = slice(i, i + BLOCK)
            answer, rest = np.split(self.slopes(place[part])[..., :width], [count], axis=1)
            strength = WEAKEST * noise[part, None] * 2.0 ** np.arange(STRENGTHS)
            # weaker ones than the weakest are one, or rounding at the threshold would be seen
            usual = _usual(strength, np.maximum(self.share * size[part], strength[:, 0]))
            even = (gains * size[part]) ** 2
            seen = left[part], noise[part]
            weighed = self._weigh((answer, rest), seen, strength, even, usual)
            mean[part], cov[part] = weighed
        return mean, cov * np.outer(self.factor_, self.factor_)

    def _weigh(
        self, slopes: tuple[Array, Array], seen: tuple[Array, Array], strength: Array,
        even: Array, usual: Array,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Mean and covariance over strengths (s, j), of logarithms of how usual they are."""
        (answer, rest), (left, noise), width = slopes, seen, len(self.shape)
        # what the disc's place takes up shows nothing, and would pass for a weak magnet
        ways = np.swapaxes(np.linalg.svd(rest)[0][..., : width - FREEDOMS], 1, 2)
        field = self.shape @ self.shape.T
        if available():
            count = answer.shape[1]
            mean, cov = np.empty((len(left), count)), np.empty((len(left), count, count))
            ways, rest, answer = (np.ascontiguousarray(part) for part in (ways, rest, answer))
            weighed_rows(ways, rest, answer, field, left, noise, strength, even, usual, mean, cov)
            return mean, cov
        steep = np.concatenate([_product(ways, rest), answer], axis=1)
        flat = np.swapaxes(steep, 1, 2)
        shown, level = _product(_product(steep, field[None]), flat), _product(steep, flat)
        told, doubt, evidence = _conditioned(
            strength**2, even[:, None], noise[:, None] ** 2,
            _product(ways, left[..., None])[..., 0], shown, level,
        )  # fmt: skip
        share = np.exp(usual + evidence - (usual + evidence).max(axis=1, keepdims=True))
        share = (share / share.sum(axis=1, keepdims=True))[..., None]
        mean = (share * told).sum(axis=1)
        apart = told - mean[:, None]
        doubt = doubt + apart[..., :, None] * apart[..., None, :]
        return mean, np.asarray((share[..., None] * doubt).sum(axis=1))


def _usual(strength: Array, expected: Array) -> Array:
    """Logarithm of how usual strengths (s, j) are where a field of a magnet has one (s,).

    Any strength up to it may be, of magnets that are far and coils; most that disturb are near.
    """
    least = np.maximum(expected, np.finfo(float).tiny)
    apart = (np.log2(strength) - np.log2(least)[:, None]) / OCTAVES
    near = np.exp(-0.5 * apart**2)
    far = np.where(apart > 0, near, 1.0)
    near, far = (one / (one.sum(axis=1, keepdims=True) + 1e-300) for one in (near, far))
    return np.asarray(np.log(NEAR * near + (1 - NEAR) * far + 1e-300))


def _product(a: Array, b: Array) -> Array:
    """Products (s, i, j) of a (s, i, n) and b (s, n, j), added up in the order of the loops."""
    total = a[:, :, :1] * b[:, :1]
    for n in range(1, a.shape[2]):
        total = total + a[:, :, n : n + 1] * b[:, n : n + 1]
    return np.asarray(total)


def _conditioned(
    square: Array, even: Array, noise: Array, left: Array, shown: Array, level: Array
) -> tuple[Array, Array, Array]:
    """Answers (s, j, k) given what is left (s, r), their covariances, and its likelihood."""
    count, answers = left.shape[1], shown.shape[1] - left.shape[1]
    many = square.shape
    seen, right = np.empty((count, count, *many)), np.empty((count, 1 + answers, *many))
    told, doubt = np.empty((answers, *many)), np.empty((answers, answers, *many))
    left, shown, level = (np.moveaxis(one, 0, -1)[..., None] for one in (left, shown, level))
    blur = noise + INEXACT**2 * square
    evidence = whitened(square, even, blur, left, shown, level, seen, right)
    answered(square, even, shown, level, right, told, doubt)
    return np.moveaxis(told, 0, -1), np.moveaxis(doubt, (0, 1), (-2, -1)), np.asarray(evidence)


def magnet_fields(pixels: Array, response: Array, distance: float = REACH) -> Array:
    """Readings of magnets of 1 A m2 all around, turned along x, y and z each.

    Parameters
    ----------
    pixels : ndarray, shape (t, 3)
        (m).
    response : ndarray, shape (n, 3)
        Of the n = c t channels to a uniform field, pixel by pixel.
    distance : float
        From the pixels' middle (m).

    Returns
    -------
    ndarray, shape (d, 3, n)
        (T), of d directions.
    """
    index = np.arange(DIRECTIONS) + 0.5
    up, turn = 1 - 2 * index / DIRECTIONS, np.pi * (1 + np.sqrt(5.0)) * index
    flat = np.sqrt(1 - up**2)
    way = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), up])
    places = pixels.mean(axis=0) + distance * np.repeat(way, 3, axis=0)
    moments = np.tile(np.eye(3), (DIRECTIONS, 1))
    every = np.broadcast_to(pixels, (len(places), *pixels.shape))
    field = dipole_field(every, places[:, None], moments[:, None])
    channels = response.reshape(len(pixels), -1, 3)
    seen = np.einsum('dti,tci->dtc', field, channels)
    return np.asarray(seen.reshape(DIRECTIONS, 3, -1))


def magnet_shape(field: Array, projection: Array) -> Array:
    """Shape of the differences that magnets make.

    Parameters
    ----------
    field : ndarray, shape (d, 3, n)
        Of `magnet_fields`.
    projection : ndarray, shape (n, m)
        To differences.

    Returns
    -------
    ndarray, shape (m, m)
        A root of their covariance, of mean square 1.
    """
    seen = field.reshape(-1, field.shape[2]) @ projection
    size, way = np.linalg.eigh(seen.T @ seen)
    root = way * np.sqrt(np.maximum(size, 0.0))
    return np.asarray(root / np.sqrt((root**2).sum() / len(root)))
