"""Bayesian inversion over a table of nominal touches, with and without a uniform stray field.

What is stated of errors is measured on pads that differ from the config as specimens do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.covariance import SigmaCalibration
from tactile_ros.estimators.gaussian_sum_table import GaussianSumTable, Linearised, Posterior
from tactile_ros.sensors.magnet_pad.body_model import (
    LEAST_NOISE,
    LOADS,
    NOISE,
    TIPS,
    Presses,
    change_of_field,
    nominal_choice,
    spread_presses,
    uniform_response,
)
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Columns

SPECIMENS_COUNT, TOUCHES = 40, 40
MISPLACED, RAISED = 0.01, 0.03  # radii; of the height
GAINS = 0.03  # of chips and of the magnets that they see most, and of crossed axes
STIFFNESS, STIFFENING = 0.2, 0.3  # logarithms, of the modulus and under the largest load
BONDS = (-0.5, 1.5)


def specimens(config: MagnetPadConfig, noise: float) -> tuple[Array, Array]:
    """Readings of touches of many specimens, the same for the same config.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pads.
    noise : float
        Of a channel (T).

    Returns
    -------
    readings : ndarray, shape (s, 3 t)
        Changes since rest (T).
    truth : ndarray, shape (s, 6)
        Places (m) and forces (N).
    """
    readings, truth = [], []
    for seed in range(SPECIMENS_COUNT):
        rng, presses = np.random.default_rng(seed), spread_presses(config, TOUCHES, seed)
        change = _read(config, presses, rng)
        readings.append(change + noise * rng.normal(size=change.shape))
        truth.append(np.column_stack([presses.places(config.radius), presses.force]))
    return np.concatenate(readings), np.concatenate(truth)


def _read(config: MagnetPadConfig, presses: Presses, rng: np.random.Generator) -> Array:
    """Changes (s, 3 t) (T) of touches of one specimen."""
    magnets = config.magnet_positions * np.array([1, 1, np.exp(RAISED * rng.normal())])
    magnets = magnets + MISPLACED * config.radius * rng.normal(size=magnets.shape)
    most = LOADS[1] * config.shear_modulus * config.radius**2
    give = -STIFFNESS * rng.normal() - STIFFENING * rng.uniform() * presses.size / most
    one = np.ones(len(presses.along))
    touches = replace(
        presses,
        force=np.exp(give)[:, None] * presses.force,
        tip=config.radius * rng.uniform(*TIPS) * one,
        bond=rng.uniform(*BONDS) * one,
    )
    change = change_of_field(replace(config, magnet_positions=magnets), touches)
    chips = len(config.positions)
    gains = np.eye(3) + GAINS * rng.normal(size=(chips, 3, 3))
    return np.asarray(np.einsum('tij,stj->sti', gains, change).reshape(len(one), 3 * chips))


MOST = 256  # touches
BLOCK = 1024


class SubthresholdForce:
    """Second moments of forces that readings at rest may hide.

    Parameters
    ----------
    readings, forces : ndarray, shape (n, d) and (n, 3)
        Of touches (T, N), all as likely; the lighter half of them is taken.
    noise : float
        Of a channel (T).
    """

    def __init__(self, readings: Array, forces: Array, noise: float) -> None:
        size = np.sqrt((forces * forces).sum(axis=1))
        light = np.argsort(size, kind='stable')[: max(len(size) // 2, 1)]
        light = light[:: -(-len(light) // MOST)]
        load = np.maximum(size[light], 1e-12)[:, None]
        self.forces_, self.units_ = forces[light] / load, readings[light] / load
        self.noise = max(noise, 1e-9)

    def __call__(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying 0 of readings (s, d) (T)."""
        square = np.maximum((self.units_**2).sum(axis=1), 1e-30)
        outer = (self.forces_[:, :, None] * self.forces_[:, None]).reshape(-1, 9)
        cov = np.empty((len(x), 3, 3))
        for i in range(0, len(x), BLOCK):
            part = x[i : i + BLOCK]
            # a row at a time: the same bits alone and among others
            load = np.maximum(np.matmul(part[:, None], self.units_.T)[:, 0] / square, 0.0)
            gain = load * load * square / self.noise**2
            likely = np.exp(0.5 * (gain - gain.max(axis=1, keepdims=True)))
            likely /= likely.sum(axis=1, keepdims=True)
            hidden = likely * (load * load + self.noise**2 / square)
            cov[i : i + BLOCK] = np.matmul(hidden[:, None], outer)[:, 0].reshape(-1, 3, 3)
        return cov


def truth_of_touches(truth: Columns) -> Columns:
    """Truth without the forces of untouched rows, which are 0 in use whatever is learned."""
    free = [np.asarray(truth['in_contact']) == 0] if 'in_contact' in truth else []
    if 'force' in truth:
        free.append((np.nan_to_num(np.asarray(truth['force'], float)) == 0).all(axis=1))
    if not free:
        return truth
    loads = {name: truth[name] for name in ('force', 'torque') if name in truth}
    gone = np.any(free, axis=0)[:, None]
    return {**truth, **{name: np.where(gone, np.nan, load) for name, load in loads.items()}}


NEIGHBOURS, BLIND, SLACK = 16, 96, 1.0
STRAY = 0.3e-3  # T, of one component of stray fields that are met
CROSSED = 0.01  # of a stray field, by which crossed axes of a chip falsify it
SPREAD, STEEPER = 0.02, 2.0  # of gains, up to which readings are weighed so; for more than that
ODDS = -4.0  # logarithm, of a stray field against none
SIGMAS = 5.0  # as `conditioning.contact` has them
# place and force; then how much wider their covariance is, how far known touches are, the share
# of the noise in what readings may be wrong by, and the reading
ANSWERS = 6
FAR, NOISY, READING = 7, 8, 9


@dataclass(frozen=True)
class PosteriorMoments:
    """What readings tell.

    Attributes
    ----------
    far, noisy : ndarray, shape (s,)
        Distance from known touches (radii, at most 1); share of the noise of a channel in the
        variance of what readings may be wrong by.
    """

    # (s, 6) and (s, 6, 6) place (m) and force (N)
    mean: Array
    cov: Array
    shares: Array  # (s, n) of the cells
    stray: Array  # (s, 3) uniform outside field (T)
    odd: Bools  # (s,) readings that neither a touch nor a field of the usual size explains
    far: Array
    noisy: Array


def widened(seen: Posterior, usual: float) -> Array:
    """Covariance (s, 6, 6) of place and force, as wide as the table is in doubt there.

    Wider yet where a touch leaves more of the reading unexplained than the usual misfit (Birge,
    Phys. Rev. 40, 1932).
    """
    factor = seen.mean[:, ANSWERS] * np.maximum(seen.misfit / usual, 1.0)
    return np.asarray(seen.cov * factor[:, None, None])


class UniformPart:
    """Uniform field in readings, and what remains.

    Parameters
    ----------
    common : ndarray, shape (d, 3)
        What a uniform field adds to the features, in sensor axes.
    """

    def __init__(self, common: Array) -> None:
        self.common = common
        self.solve = np.linalg.pinv(common).T

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Field (s, 3) in readings (s, d) (T), and the largest channel of what remains."""
        field = self.field(x)
        return field, np.abs(self.left(x, field)).max(axis=1)

    def field(self, x: Array) -> Array:
        """Field (s, 3) in readings (s, d) (T)."""
        # a row at a time: the same bits alone and among others
        return np.asarray(np.matmul(x[:, None], self.solve)[:, 0])

    def left(self, x: Array, field: Array) -> Array:
        """What remains (s, d) of readings less a field (s, 3) (T)."""
        return np.asarray(x - np.matmul(field[:, None], self.common.T)[:, 0])


class TouchPosterior:
    """Touches of a table that answer readings.

    Parameters
    ----------
    rows : Linearised
        Answers are place, force, and what follows them (`ANSWERS`).
    common : ndarray, shape (d, 3), or None
        As `UniformPart`; None: an outside field cannot be told.
    noise, contact : float
        Of a channel; largest channel, less a uniform field, beyond which something touches (T).
    usual, limit : float
        Misfit that most touches leave; from which an outside field is thought of.
    spread : float
        Of gains among chips: the share of a stray field that may be left in what is told.
    neighbours : int
        Touches that answer.
    """

    def __init__(
        self, rows: Linearised, common: Array | None, noise: float, contact: float, usual: float,
        limit: float, spread: float = SPREAD, neighbours: int = NEIGHBOURS,
    ) -> None:  # fmt: skip
        self.plain = GaussianSumTable(
            rows.of(READING), neighbours=neighbours, told=ANSWERS, slack=SLACK
        )
        self.noise, self.contact = noise, contact
        self.usual, self.limit = usual, limit
        self.entry = max(CROSSED, STEEPER * (spread - SPREAD))
        self.leak = max(CROSSED, spread)
        light = rows.readings, rows.answers[:, 3:ANSWERS]
        self.unfelt = SubthresholdForce(*light, noise)
        self.part = self.blind = None
        if common is not None:
            part = self.part = UniformPart(common)
            left = part.left(light[0], part.field(light[0]))
            self.unfelt_beside = SubthresholdForce(left, light[1], noise)
            beside = replace(rows, sigma=np.hypot(rows.sigma, self.entry * STRAY))
            self.blind = GaussianSumTable(beside, common, STRAY, neighbours=BLIND, told=ANSWERS)

    def __call__(self, x: Array, cells: Array) -> PosteriorMoments:
        """What finite readings x (s, d) (T) tell, with centres (n, 3) of cells (m)."""
        seen = self.plain(x)
        shares, stray = self.plain.shares(seen, cells), np.zeros((len(x), 3))
        unlike = seen.misfit > self.limit
        cov = widened(seen, self.usual)
        far, noisy = seen.mean[:, FAR], seen.mean[:, NOISY]
        told = PosteriorMoments(seen.mean[:, :ANSWERS], cov, shares, stray, unlike, far, noisy)
        if np.count_nonzero(unlike):
            rows = np.flatnonzero(unlike)
            if self.blind is None:
                told.mean[rows], told.cov[rows], shares[rows] = self.plain.at_large(x[rows], cells)
            else:
                self._mend(told, seen, x, cells, rows)
        return told

    def _mend(
        self, told: PosteriorMoments, seen: Posterior, x: Array, cells: Array, rows: Integers
    ) -> None:
        """Weigh what readings of some rows say of touches beside a field, in place."""
        blind, part = self.blind, self.part
        assert blind is not None
        assert part is not None
        other = blind(x[rows])
        mean, cov = other.mean[:, :ANSWERS].copy(), other.cov.copy()
        named, odd = blind.shares(other, cells), np.asarray(other.misfit > self.limit)
        told.odd[rows] = odd
        if np.count_nonzero(odd):
            mean[odd], cov[odd], named[odd] = blind.at_large(x[rows[odd]], cells)
        lean = other.evidence - seen.evidence[rows] + ODDS
        lean = 1 / (1 + np.exp(-np.clip(lean, -50, 50)))
        lean[odd] = 1.0
        share, apart = lean[:, None], mean - told.mean[rows]
        between = (share * (1 - share))[:, :, None] * apart[:, :, None] * apart[:, None]
        left = x[rows] - other.mean[:, READING:]
        field = part(left)[0]
        leak = self.leak**2 * (field * field).sum(axis=1) / self.noise**2
        wider = np.maximum(other.misfit / x.shape[1], 1.0) * (1 + leak * other.mean[:, NOISY])
        cov[~odd] *= wider[~odd, None, None]
        told.cov[rows] += share[:, :, None] * (cov - told.cov[rows]) + between
        told.mean[rows] += share * apart
        told.shares[rows] += share * (named - told.shares[rows])
        told.stray[rows] = share * field

    def resting_field(self, x: Array) -> Array:
        """Uniform field (s, 3) (T) of readings (s, d) that nothing touches; 0 within noise."""
        assert self.part is not None
        field, _ = self.part(x)
        seen = np.abs(field).max(axis=1, keepdims=True) > SIGMAS * self.noise
        return np.where(seen, field, 0.0)

    def hidden(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying that nothing touches, of readings (s, d)."""
        cov = self.unfelt(x)
        if self.part is not None:
            field = self.resting_field(x)
            rows = np.flatnonzero(field.any(axis=1))
            if len(rows):
                cov[rows] = self.unfelt_beside(self.part.left(x[rows], field[rows]))
        return cov

    def touching(self, x: Array) -> Bools:
        """Whether readings (s, d) are rather those of a touch than of a uniform field alone."""
        assert self.blind is not None
        assert self.part is not None
        touching = np.asarray(self.part(x)[1] > self.contact)
        if np.count_nonzero(touching) < len(x):
            weak = np.flatnonzero(~touching)
            touch = np.maximum(self.plain(x[weak]).evidence, self.blind(x[weak]).evidence)
            noise = float(np.hypot(self.noise, self.entry * STRAY))
            touching[weak] = touch > self.blind.of_causes(x[weak], noise)
        return touching


COUNT = 8000
STEP = 1e-2  # radii and rad, by which slopes are measured
LOAD = 2.0  # radii that a factor e of load counts as
NEAR = 6  # neighbour whose distance is the reach of a touch
RIGHT = 0.06  # of a reading: what the model may be wrong by
UNLIKE = 4.0  # misfit of a channel, from which a stray field is thought of
STIFF = 0.2  # share by which a modulus from a hardness, and thus a force, may be wrong
LEAST = 1e-4  # m; N times shear modulus and radius follow


class NominalEstimator:
    """Touches of the nominal model as a table that answers readings.

    Parameters
    ----------
    config : MagnetPadConfig
        Geometry and materials.

    Attributes
    ----------
    telling : TouchPosterior
        Of the touches.
    spread : SigmaCalibration
        Of place and force, measured on specimens.
    """

    def __init__(self, config: MagnetPadConfig) -> None:
        self.cells = config.cells
        noise = NOISE if config.noise is None else max(float(np.max(config.noise)), LEAST_NOISE)
        presses = spread_presses(config, COUNT)
        several = len(config.positions) > 1 and config.stray_term
        common = uniform_response(config) if several else None
        rows = self._rows(config, presses, noise)
        usual = float(rows.readings.shape[1])
        self.telling = TouchPosterior(
            rows, common, noise, SIGMAS * noise, usual, UNLIKE * usual,
            config.gain_spread, neighbours=32,
        )  # fmt: skip
        force = LEAST * config.shear_modulus * config.radius
        self.floor = np.diag(np.repeat([LEAST, force], 3) ** 2)
        self.spread = self._measured(config, noise)

    def _measured(self, config: MagnetPadConfig, noise: float) -> SigmaCalibration:
        """What is said of touches of specimens, beside what they are."""
        x, true = specimens(config, noise)
        mean, cov, _ = self._told(x)
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        return SigmaCalibration().fit(sigma, mean - true)

    def _told(self, x: Array) -> tuple[Array, Array, PosteriorMoments]:
        """Mean (s, 6) and covariance (s, 6, 6) of place and force, as the table has them."""
        told = self.telling(x, self.cells)
        cov = told.cov + self.floor
        stiffer = STIFF * told.mean[:, 3:]
        cov[:, 3:, 3:] += stiffer[:, :, None] * stiffer[:, None, :]
        return told.mean, cov, told

    @staticmethod
    def _rows(config: MagnetPadConfig, presses: Presses, noise: float) -> Linearised:
        """Touches with their readings, and both a little further along, around and harder."""
        nodes, radius = nominal_choice(config).size[0], config.radius
        spots = np.column_stack(
            [presses.along / radius, presses.around, LOAD * np.log(presses.size)]
        )
        reach = cKDTree(spots).query(spots, k=[NEAR + 1])[0][:, 0]
        reach = np.clip(reach, 0.005, 0.3)[:, None]
        steps = (
            replace(presses, along=presses.along + STEP * radius),
            presses.turned(STEP),
            replace(presses, force=presses.force * (1 + STEP / LOAD)),
        )
        level = change_of_field(config, presses, nodes).reshape(len(reach), -1)
        sigma = np.sqrt(noise**2 + RIGHT**2 * (level**2).mean(axis=1))
        beside = np.column_stack([np.ones(len(level)), np.zeros(len(level)), (noise / sigma) ** 2])
        start = np.column_stack([presses.places(radius), presses.force, beside, level])
        rises = []
        for step in steps:
            change = change_of_field(config, step, nodes).reshape(len(reach), -1)
            moved = np.column_stack([step.places(radius), step.force, beside, change])
            rises.append(moved - start)
        leads = np.stack(rises, axis=-1) / STEP * reach[:, None]
        share = np.full(len(level), 1 / len(level))
        return Linearised(level, leads[:, READING:], start, leads, sigma, share)

    def _hidden(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying that nothing touches, of readings (s, d)."""
        return (1 + STIFF) ** 2 * self.telling.hidden(x)

    def estimate(self, x: Array, rest: Bools, doubt: Array | float = 0.0) -> Columns:
        """Place, force and cell of changes of field x (s, d) (T); NaN and -1 where x is not.

        Rows of `rest` (s,) are untouched; `doubt` (s,) is the baseline's variance over a frame's.
        """
        there = np.asarray(np.isfinite(x).all(axis=1))
        mean, cov = np.full((len(x), 6), np.nan), np.full((len(x), 6, 6), np.nan)
        cell, share = np.full(len(x), -1), np.full(len(x), np.nan)
        stray, odd = np.full((len(x), 3), np.nan), np.zeros(len(x), np.int8)
        if there.any():
            mean[there], wide, told = self._told(x[there])
            sigma = np.sqrt(np.diagonal(wide, axis1=1, axis2=2))
            factor = self.spread(sigma) / sigma
            noisy = 1 + (doubt * np.ones(len(x)))[there] * told.noisy
            cov[there] = wide * factor[:, :, None] * factor[:, None, :] * noisy[:, None, None]
            cell[there], share[there] = told.shares.argmax(axis=1), told.shares.max(axis=1)
            stray[there], odd[there] = told.stray, told.odd
            if (rest & there).any():
                cov[rest & there, 3:, 3:] = self._hidden(x[rest & there])
            if self.telling.part is not None and (rest & there).any():
                stray[rest & there] = self.telling.resting_field(x[rest & there])
        known = {
            'position': mean[:, :3], 'position_cov': cov[:, :3, :3],
            'force': mean[:, 3:], 'force_cov': cov[:, 3:, 3:],
            'cell': cell, 'cell_probability': share, 'odd': odd,
        }  # fmt: skip
        return known if self.telling.part is None else {**known, 'stray_field': stray}
