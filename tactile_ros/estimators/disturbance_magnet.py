"""Magnets nearby: errors that their fields cause, from what no place of the disc explains.

Four pixels have six differences and the disc has three freedoms, so that half of what a magnet's
field does shows in what the disc's model leaves over. The other half follows from it as far as
fields without sources tie them together; how strong the magnet is, the readings themselves say.
All of it is linear in the field, given the strength, and normal (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, app. A.2); strengths are weighed by their evidence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.covariance import CalibratedCovariance
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge, product_rows
from tactile_ros.estimators.regression import group_folds
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.magnetics import dipole_field
from tactile_ros.types import Array, Bools, Integers

INEXACT = 0.05  # of what a magnet does: slopes differ from place to place, and bend


@compiled
def crossed(a: Array, b: Array, c: Array) -> None:
    """Product (i, j) of a (i, n) and the transpose of b (j, n)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for n in range(a.shape[1]):
                total += a[i, n] * b[j, n]
            c[i, j] = total


@compiled
def whitened(
    square: float, even: float, blur: float, left: Array, shown: Array, level: Array, seen: Array,
    right: Array,
) -> float:  # fmt: skip
    """Log likelihood of what is left (r,); `right` (r, 1 + k) becomes it and answers, whitened.

    `shown` and `level`, of shape (r + k, r + k), are covariances that a field of strength 1, and
    an even one, give to what is left and to answers.
    """
    count, evidence = len(left), 0.0
    for i in range(count):
        for j in range(i + 1):
            total = square * shown[i, j] + even * level[i, j]
            total = total + blur if i == j else total
            for n in range(j):
                total = total - seen[i, n] * seen[j, n]
            seen[i, j] = np.sqrt(total) if i == j else total / seen[j, j]
        for k in range(right.shape[1]):
            at = count + k - 1
            total = square * shown[i, at] + even * level[i, at] if k > 0 else left[i]
            for n in range(i):
                total = total - seen[i, n] * right[n, k]
            right[i, k] = total / seen[i, i]
        evidence = evidence - 0.5 * right[i, 0] * right[i, 0] - np.log(seen[i, i])
    return evidence


@compiled
def answered(
    square: float, even: float, shown: Array, level: Array, right: Array, told: Array, doubt: Array
) -> None:
    """Answers (k,) and their covariance (k, k), of `right` of `whitened`."""
    count = len(right)
    for k in range(len(told)):
        told[k] = right[0, 1 + k] * right[0, 0]
        for i in range(1, count):
            told[k] += right[i, 1 + k] * right[i, 0]
        for n in range(k + 1):
            total = square * shown[count + k, count + n] + even * level[count + k, count + n]
            total = (1 + INEXACT**2) * total
            for i in range(count):
                total = total - right[i, 1 + k] * right[i, 1 + n]
            doubt[k, n] = total
            doubt[n, k] = total


@compiled
def mixed(share: Array, told: Array, doubt: Array, mean: Array, cov: Array) -> None:
    """Mean (k,) and covariance (k, k) of normals (j, k) with logarithms (j,) of shares."""
    most, total = share.max(), 0.0
    for j in range(len(share)):
        share[j] = math.exp(share[j] - most)
        total += share[j]
    mean[:], cov[:] = 0.0, 0.0
    for j in range(len(share)):
        share[j] /= total
        for k in range(len(mean)):
            mean[k] += share[j] * told[j, k]
    for j in range(len(share)):
        for k in range(len(mean)):
            apart = told[j, k] - mean[k]
            for n in range(len(mean)):
                cov[k, n] += share[j] * (doubt[j, k, n] + apart * (told[j, n] - mean[n]))


@compiled
def weighed_rows(
    ways: Array, rest: Array, answer: Array, field: Array, left: Array, noise: Array,
    strength: Array, even: Array, usual: Array, mean: Array, cov: Array,
) -> None:  # fmt: skip
    """Means (s, k) and covariances (s, k, k) of answers over strengths (s, j).

    Parameters
    ----------
    ways : ndarray, shape (s, r, m)
        Directions that show fields, among what is left over.
    rest, answer : ndarray, shape (s, m, m), (s, k, m)
        Slopes of what is left over, and of answers (1, unit over T).
    field : ndarray, shape (m, m)
        Covariance of differences of a magnet of strength 1.
    left, noise : ndarray, shape (s, m), (s,)
        What is left over, and the noise of each freedom of it (T).
    strength, even, usual : ndarray, shape (s, j), (s,), (s, j)
        Of magnets (T), variance of an even field (T2), logarithm of how usual a strength is.
    mean, cov : ndarray
        To be filled.
    """
    count, answers, width = ways.shape[1], answer.shape[1], answer.shape[2]
    steep = np.empty((count + answers, width))
    spread, shown = np.empty_like(steep), np.empty((count + answers, count + answers))
    level, share = np.empty_like(shown), np.empty(strength.shape[1])
    shows, seen, right = np.empty(count), np.empty((count, count)), np.empty((count, 1 + answers))
    told, doubt = np.empty((len(share), answers)), np.empty((len(share), answers, answers))
    for s in range(len(ways)):
        product_rows(ways[s], rest[s], steep[:count])
        steep[count:] = answer[s]
        product_rows(steep, field, spread)
        crossed(spread, steep, shown)
        crossed(steep, steep, level)
        crossed(ways[s], left[s : s + 1], shows.reshape(count, 1))
        for j in range(len(share)):
            square = strength[s, j] ** 2
            blur = noise[s] ** 2 + INEXACT**2 * square
            evidence = whitened(square, even[s], blur, shows, shown, level, seen, right)
            answered(square, even[s], shown, level, right, told[j], doubt[j])
            share[j] = usual[s, j] + evidence
        mixed(share, told, doubt, mean[s], cov[s])


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
        count = answer.shape[1]
        mean, cov = np.empty((len(left), count)), np.empty((len(left), count, count))
        ways, rest, answer = (np.ascontiguousarray(part) for part in (ways, rest, answer))
        weighed_rows(ways, rest, answer, field, left, noise, strength, even, usual, mean, cov)
        return mean, cov


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


STRAY_DEGREES = (1, 2, 3, 4)
USUAL, CERTAIN = 0.99, 0.9999  # of what clean frames leave over
BEYOND = 1.5  # times the oddest that is certain
LEAST = 1e-12  # T, of what is left over where a fit saw but one reading


@dataclass(frozen=True)
class Seen:
    """What readings tell beside the disc.

    Attributes
    ----------
    left : ndarray, shape (s, m)
        Differences that the disc's model leaves over, less those that it always does (T).
    """

    field: Array  # (s, r) stray field (T)
    left: Array
    noise: Array  # (s,) of each freedom of them in clean frames (T)
    size: Array  # (s,) of the stray field (T); 0 where it may be none
    # (s,) A field that is not the disc's is likely; the differences are certainly not the disc's
    near: Bools
    odd: Bools


class StrayField:
    """Uniform field beside the disc's, and how odd the differences are.

    Parameters
    ----------
    slow : int
        How many temperatures follow the disc's place.

    Attributes
    ----------
    usual_field_ : PolynomialRidge
        Uniform field that is left beside the disc's model where there is none, and what the model
        leaves over, of its place.
    usual_, limit_ : float
        Mean square of what is left over, in units of its spread, that clean frames reach now and
        then, and beyond which a field is not the disc's.
    """

    usual_field_: PolynomialRidge
    spread_: CalibratedCovariance  # of what is left over then
    usual_: float
    limit_: float
    blind_: float  # size of a stray field (T) that clean frames seem to have now and then
    report_: dict[str, float]  # held-out error of the stray field (T), and the limit

    def __init__(self, slow: int = 0) -> None:
        self.slow = slow

    def fit(
        self, place: Array, rest: Array, uniform: Array, stray: Array, groups: Integers
    ) -> StrayField:
        """Learn what the disc does.

        Parameters
        ----------
        place : ndarray, shape (s, 3 + h)
            Of the disc, and temperatures.
        rest : ndarray, shape (s, m)
            What the disc's model leaves over (T).
        uniform, stray : ndarray, shape (s, r)
            Uniform part of what the disc's model leaves over, along the axes that are measured,
            and the true stray field (T); NaN: taken as 0.
        groups : ndarray of int, shape (s,)
            What a split keeps together.
        """
        both = np.column_stack([uniform - np.nan_to_num(stray), rest])
        self.usual_field_ = PolynomialRidge(STRAY_DEGREES, self.slow).fit(place, both, groups)
        _, number = np.unique(groups, return_inverse=True)
        fold = group_folds(np.asarray(number).reshape(-1), 3, 0)
        said = np.empty_like(both)
        for part in np.unique(fold):
            out, known = fold == part, fold != part
            known = known if known.any() else out
            model = PolynomialRidge(STRAY_DEGREES, self.slow).fit(
                place[known], both[known], groups[known]
            )
            said[out] = model.predict(place[out])
        count = uniform.shape[1]
        error, left = said[:, :count] - both[:, :count], rest - said[:, count:]
        self.spread_ = CalibratedCovariance().fit(place, left, groups)
        odd = ((left / np.maximum(self.spread_.sigma(place), LEAST)) ** 2).mean(axis=1)
        self.usual_ = float(np.quantile(odd, USUAL))
        self.limit_ = BEYOND * float(np.quantile(odd, CERTAIN))
        self.blind_ = float(np.quantile(np.sqrt((error**2).sum(axis=1)), USUAL))
        self.report_ = {
            'held_out_rmse': float(np.sqrt((error**2).sum(axis=1).mean())),
            'oddness_limit': self.limit_,
        }
        return self

    def predict(self, place: Array, uniform: Array, rest: Array) -> Seen:
        """Stray field, what of it may disturb differences, and where it certainly does.

        Parameters
        ----------
        place : ndarray, shape (s, 3 + h)
            Of the disc, and temperatures.
        uniform, rest : ndarray, shape (s, r), (s, m)
            Uniform part along the axes that are measured, and differences, that the disc's model
            leaves over (T).

        Returns
        -------
        Seen
            Of every row.
        """
        usual, count = self.usual_field_.predict(place), uniform.shape[1]
        field, left = uniform - usual[:, :count], rest - usual[:, count:]
        sigma = np.maximum(self.spread_.sigma(place), LEAST)
        odd = ((left / sigma) ** 2).mean(axis=1)
        size = np.sqrt(np.maximum((field**2).sum(axis=1) - self.blind_**2, 0.0))
        near = (odd > self.usual_) | (size > 0)
        noise = np.sqrt((sigma**2).sum(axis=1) / max(rest.shape[1] - FREEDOMS, 1))
        return Seen(field, left, noise, size, near, odd > self.limit_)
