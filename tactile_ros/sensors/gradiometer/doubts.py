"""What answers of the gradiometer owe to tares of few frames and to drifts that nobody told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.polynomial_rows import times
from tactile_ros.physics.temperature import EXPANSION, REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer.outside import ends
from tactile_ros.sensors.gradiometer.thermal import LEAST_RANGE, UNIT, beyond

if TYPE_CHECKING:
    from tactile_ros.sensors.gradiometer.features import Features
    from tactile_ros.sensors.gradiometer.magnets import NearbyMagnets
    from tactile_ros.types import Array, Bools, Signals

MANY = 30  # frames of a tare whose noise needs no mention
SMALL = 0.3  # of the noise: drifts that need none
WARMER, HIGHER = UNIT * REMANENCE_SLOPE, UNIT * EXPANSION  # of remanence, of the gap
FEEBLE = 1e-3  # units of temperature
FEW = 1e-3  # degrees
OUTSIDE = 0.01  # of a component's spread, for a degree beyond the temperatures of the fit


def tare_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, learned: float,
    wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what the noise of a tare of few frames does.

    Parameters
    ----------
    features, magnets : Features, NearbyMagnets
        Of the calibration.
    signals : Signals
        Frames.
    place : ndarray, shape (s, 3)
        Of the disc.
    learned : float
        Variance that tares left in the calibration, over that of a frame.
    wider : ndarray, shape (s, k, k)
        Changed in place.
    """
    doubt = signals.doubt
    if doubt is None or not np.count_nonzero(doubt):
        return
    rows = np.flatnonzero((doubt > 0) & (doubt + learned > 1 / MANY))
    if len(rows):
        variance = (doubt[rows] + learned) * features.readings_.noise**2
        cov = variance[:, None, None] * np.eye(features.projection.shape[1])
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])


def drift_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, wider: Array
) -> None:
    """Add to covariances (s, k, k) what drifts with the chip do that no recording told.

    Parameters are those of `tare_doubt`.
    """
    if signals.temperature_c is None:
        return
    readings, count = features.readings_, features.projection.shape[1]
    drift, unsure = readings.unsure_drifts(signals), readings.unsure_drift(count)
    size = (drift**2) @ unsure.diagonal().reshape(2, count).max(axis=1)
    rows = np.flatnonzero(size > (SMALL * readings.noise) ** 2)
    if len(rows):
        cov = unsure.reshape(2, count, 2, count)
        cov = np.einsum('si,imjn,sj->smn', drift[rows], cov, drift[rows])
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])


def warmth_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, field: Array,
    slope: Array, wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what a warmer disc does, where a fit saw one temperature.

    Parameters are those of `tare_doubt`, the `field` (s, n) (T), and the steepest change of
    answers with the place, `slope` (k,) (over gaps).
    """
    if signals.temperature_c is None or features.readings_.warm_:
        return
    warm = features.readings_.unsure_drifts(signals)[:, 0]
    rows = np.flatnonzero(np.abs(warm) > FEEBLE)
    if len(rows):
        weaker = (WARMER * warm[rows])[:, None] * times(field[rows], features.projection)
        cov = weaker[:, :, None] * weaker[:, None]
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])
        higher = (HIGHER * warm[rows])[:, None] * slope
        wider[rows] += higher[..., None] ** 2 * np.eye(len(slope))


def outside_doubt(features: Features, signals: Signals, wider: Array) -> tuple[Bools, Array]:
    """Add to covariances (s, k, k) what temperatures beyond those of an even fit do.

    Rows (s,) where they are clearly beyond, or may be, and how far temperatures are from the
    middle of those of an uneven fit (s,), at least 1.
    """
    readings = features.readings_
    outside = beyond(signals, readings.span_)
    clearly, far = np.maximum(outside - LEAST_RANGE, 0.0), np.ones(len(outside))
    if not readings.warm_ and np.count_nonzero(clearly):
        wider += (OUTSIDE * clearly)[:, None, None] ** 2 * np.eye(wider.shape[1])
    elif readings.warm_ and np.count_nonzero(outside):
        far = ends(outside, readings.span_)
    return np.asarray((clearly > 0) | readings.unknown(signals)), far


def untold_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, field: Array,
    disc: Array, wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what temperatures do that chips did not tell.

    Parameters are those of `tare_doubt`, the `field` (s, n) (T), and what the temperature of the
    disc (s,) is wrong by, in the direction in which those of the chips are (degrees).
    """
    chips = features.readings_.unsure_chips(signals)
    if chips is None:
        if not np.count_nonzero(disc):
            return
        chips = np.zeros(signals.values.shape[:2])
    rows = np.flatnonzero((chips.max(axis=1) > FEW) | (disc > FEW))
    if len(rows):
        read = features.readings_.warmer_chips(field[rows], chips[rows])
        moved, slopes = times(read, features.projection), magnets.slopes(place[rows])
        count = moved.shape[1]
        off = (slopes[:, : wider.shape[1], :count] * moved[:, None]).sum(axis=2)
        if slopes.shape[2] > count:
            warmer = disc[rows, None] / UNIT
            off = off + slopes[:, : wider.shape[1], count] * warmer
        wider[rows] += off[:, :, None] * off[:, None]
