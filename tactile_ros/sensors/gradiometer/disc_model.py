# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Forward model of a disc magnet over pixels, and polynomials of its place: states and parameters.

A disc in an elastomer moves and leans with the force on it. Pixels read its field, of a table, and
any uniform field, each by a gain and two crossed axes of its own, times the Hall sensitivity at
the temperature of the chip; the magnet's own temperature changes its strength and height.
Readings are changes since a tare at other temperatures. What a magnet nearby adds beside a uniform
field is a sum of patterns. Lengths are in mm, fields in mT.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from tactile_ros.estimators.model_inversion import FIXED, ModelPrior
from tactile_ros.physics.compiled import compiled, inlined
from tactile_ros.physics.field_table import SHAPE, disc_table, reach_under, table_point
from tactile_ros.physics.magnetics import dipole_field
from tactile_ros.physics.temperature import CALIBRATED_AT, EXPANSION, REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.gradiometer.temperature import mean_row
from tactile_ros.types import Array, Bools, Integers

Answers = Sequence[Sequence[str | int]]
MM = MT = 1e-3
# state: place since rest (3), tilt beside that of the place (2), uniform field (3), temperature of
# the magnet now and at the tare, of the chip now and at the tare (K from the usual one), relative
# error common to all references of a frame, patterns of a nearby magnet
PLACE, TILT, UNIFORM, MAGNET, CHIP, LABEL, NEAR = 0, 3, 5, 8, 10, 12, 13
PATTERNS = 6
STATES = NEAR + PATTERNS
# parameters: of t pixels with 2 channels: places 3 t, gains 2 t, crossed to the other axis 2 t and
# to y 2 t, offset of the tare 2 t, drift with the chip 2 t, then these, then coefficients
PER_PIXEL = 13
REST, LEVEL, GAP, STRENGTH, LEAN, DEEPER, WIDER = 0, 2, 4, 5, 6, 7, 8
WEAKER, SOFTER, RISE, SENSITIVITY, CURVE, BEND, SHARED = 9, 10, 11, 12, 13, 14, 15
# data: number of pixels, grid of the table (4), rows, columns, height, unit of length, p0, p1, p2,
# number of loads, 2 where a tare is taken off or 1, number of terms; then pixels, chip axes,
# patterns, table, terms
COUNT, GRID, ROWS, COLUMNS, HEIGHT, UNIT, HALL, LOADS = 0, 1, 5, 6, 7, 8, 9, 12
PARTS, TERMS, ARRAYS = 13, 14, 15
TERM = 7  # numbers of a term: answer, powers of x, y, z and radius, coefficient, sign
DEGREE, WRONG_DEGREE = 5, 3
# how far specimens differ from their config: pixels, rest (mm), gains and crossed axes (1), level
# (rad), gap and remanence (1), lean (rad / mm) and its course, offset of readings and of baselines
# (mT), drift (mT / K)
PIXELS_OFF, REST_OFF, GAINS_OFF, LEVEL_OFF = 0.05, 0.2, 0.02, 0.05
GAP_OFF, STRENGTH_OFF, LEAN_OFF, COURSE_OFF = 0.08, 0.08, 0.1, 0.5
ABSOLUTE, OFFSET, OFFSET_WARM, DRIFT = 1.0, 1e-3, 0.1, 1e-2
# coefficients over an answer's size, of a round elastomer, of one that is not, of one that is not
# alike on both sides; for each degree
ROUND, UNEVEN, WRONG, SMOOTH = 3.0, 1.0, 0.05, 0.6
ANY = 1e3
LEAST_NOISE = 1e-4  # of references, over the spread of what they say
FIELD_LEAST = 1e-8  # mT2, of patterns of a magnet
NEAR_DISTANCE, NEAR_DRAWN = (10e-3, 20e-3), 400  # m; dipoles of which patterns are
TILT_OFF, CROSSED_FIELD, LABEL_OFF = 1e-3, 1.0, 2e-3


@inlined
def disc_field(
    apart: Array, axis: Array, table: Array, grid: Array, field: Array, slope: Array
) -> None:
    """Write the field (3,) of a disc at a point apart (3,) of it, and its slopes (3, 5)."""
    height = axis[0] * apart[0] + axis[1] * apart[1] + axis[2] * apart[2]
    x, y = apart[0] - height * axis[0], apart[1] - height * axis[1]
    z = apart[2] - height * axis[2]
    f, g, fs, gs, fz, gz = table_point(x * x + y * y + z * z, height, table, grid)
    for i, across in enumerate((x, y, z)):
        field[i] = f * across + g * axis[i]
        radial, axial = fs * across + gs * axis[i], fz * across + (gz - f) * axis[i]
        slope[i, 0] = -(radial * x + axial * axis[0])
        slope[i, 1] = -(radial * y + axial * axis[1])
        slope[i, 2] = -(radial * z + axial * axis[2])
        slope[i, i] -= f
    slope[0, 3], slope[1, 3], slope[2, 3] = 0.0, -field[2], field[1]
    slope[0, 4], slope[1, 4], slope[2, 4] = field[2], 0.0, -field[0]
    for i in range(3):
        slope[i, 3] += slope[i, 2] * apart[1] - slope[i, 1] * apart[2]
        slope[i, 4] += slope[i, 0] * apart[2] - slope[i, 2] * apart[0]


@inlined
def disc_pose(part: int, x: Array, p: Array, data: Array, pose: Array, axis: Array) -> None:
    """Write what holds for all pixels now (part 0) or at the tare (1): centre, axis, strengths."""
    base = PER_PIXEL * int(data[COUNT])
    now = 1.0 - part
    magnet, chip = x[MAGNET + part], x[CHIP + part]
    dx, dy, dz = now * x[0], now * x[1], now * x[2]
    radius = dx * dx + dy * dy
    course = 1.0 + p[base + DEEPER] * dz + p[base + WIDER] * radius
    lean = p[base + LEAN] * course
    a = p[base + LEVEL] - lean * dy + now * x[3]
    b = p[base + LEVEL + 1] + lean * dx + now * x[4]
    angle = math.hypot(a, b)
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    axis[0], axis[1], axis[2] = sine * b, -sine * a, math.cos(angle)
    pose[0], pose[1] = dx + p[base + REST], dy + p[base + REST + 1]
    pose[2] = dz + p[base + GAP] + p[base + RISE] * magnet + 0.5e3 * data[HEIGHT]
    linear, curve = data[HALL + 1] + p[base + SENSITIVITY], data[HALL + 2] + p[base + CURVE]
    pose[3] = data[HALL] + (linear + curve * chip) * chip
    pose[4] = linear + 2 * curve * chip
    pose[5] = 1.0 + p[base + WEAKER] * magnet
    pose[6], pose[7], pose[8] = lean, course, radius


@inlined
def pixel_seen(
    q: int, p: Array, data: Array, table: Array, pose: Array, axis: Array, seen: Array,
    moved: Array, apart: Array, field: Array, slope: Array,
) -> None:  # fmt: skip
    """Write the disc's field at pixel q in axes of its chip (3,) (mT), and its slopes (3, 5).

    Arrays from `apart` on hold intermediate values: to allocate them costs as much as the rest.
    """
    pixels = int(data[COUNT])
    base, place, axes = PER_PIXEL * pixels, ARRAYS + 3 * q, ARRAYS + 3 * pixels + 9 * q
    for i in range(3):
        apart[i] = 1e-3 * (data[place + i] + p[3 * q + i] - pose[i])
    disc_field(apart, axis, table, data[GRID : GRID + 4], field, slope)
    strength = 1e3 * p[base + STRENGTH] * pose[5]
    for i in range(3):
        ax, ay, az = data[axes + i], data[axes + 3 + i], data[axes + 6 + i]
        seen[i] = strength * (ax * field[0] + ay * field[1] + az * field[2])
        for k in range(5):
            moved[i, k] = ax * slope[0, k] + ay * slope[1, k] + az * slope[2, k]
            moved[i, k] *= strength * (1e-3 if k < 3 else 1.0)


@inlined
def by_shared(
    part: int, m: int, x: Array, p: Array, data: Array, pose: Array, d: Array, disc: float,
    by_state: Array, by_parameter: Array,
) -> None:  # fmt: skip
    """Add slopes of a channel by the disc: d (5,) by place and tilt, `disc` is its reading."""
    base, q = PER_PIXEL * int(data[COUNT]), m // 2
    magnet, lean, course = x[MAGNET + part], pose[6], pose[7]
    by_state[m, MAGNET + part] = disc * p[base + WEAKER] / pose[5] + d[2] * p[base + RISE]
    sideways = d[4] * x[0] - d[3] * x[1]
    bend = sideways * p[base + LEAN]
    if part == 0:
        by_state[m, 0] = d[0] + d[4] * lean + 2 * x[0] * bend * p[base + WIDER]
        by_state[m, 1] = d[1] - d[3] * lean + 2 * x[1] * bend * p[base + WIDER]
        by_state[m, 2] = d[2] + bend * p[base + DEEPER]
        by_state[m, 3], by_state[m, 4] = d[3], d[4]
    if len(by_parameter) == 0:
        return
    for i in range(3):
        by_parameter[m, 3 * q + i] -= d[i]
    for i in range(2):
        by_parameter[m, base + REST + i] += d[i]
        by_parameter[m, base + LEVEL + i] += d[3 + i]
    by_parameter[m, base + GAP] += d[2]
    by_parameter[m, base + RISE] += d[2] * magnet
    by_parameter[m, base + STRENGTH] += disc / p[base + STRENGTH]
    by_parameter[m, base + WEAKER] += disc * magnet / pose[5]
    if part == 0:
        by_parameter[m, base + LEAN] = sideways * course
        by_parameter[m, base + DEEPER] = bend * x[2]
        by_parameter[m, base + WIDER] = bend * pose[8]


@inlined
def channel_reading(
    part: int, m: int, x: Array, p: Array, data: Array, pose: Array, seen: Array, moved: Array,
    d: Array, out: Array, by_state: Array, by_parameter: Array,
) -> None:  # fmt: skip
    """Add the reading of channel m now (part 0), or take off that at the tare, and its slopes."""
    pixels = int(data[COUNT])
    base, axes = PER_PIXEL * pixels, ARRAYS + 3 * pixels + 9 * (m // 2)
    i, j = 2 * (m % 2), 2 - 2 * (m % 2)
    gain, k1, k2 = p[3 * pixels + m], p[5 * pixels + m], p[7 * pixels + m]
    drift, chip = p[11 * pixels + m], x[CHIP + part]
    sign = 1.0 - 2.0 * part
    own, other, third = seen[i], seen[j], seen[1]
    g = sign * pose[3] * gain
    disc = own + k1 * other + k2 * third
    if part == 0:
        for k in range(3):
            u, a = x[UNIFORM + k], axes + 3 * k
            own, other = own + data[a + i] * u, other + data[a + j] * u
            third += data[a + 1] * u
            by_state[m, UNIFORM + k] = g * (data[a + i] + k1 * data[a + j] + k2 * data[a + 1])
    whole = own + k1 * other + k2 * third
    out[m] += g * whole + sign * drift * chip
    by_state[m, CHIP + part] = sign * (pose[4] * gain * whole + drift)
    if len(by_parameter) > 0:
        by_parameter[m, 3 * pixels + m] += sign * pose[3] * whole
        by_parameter[m, 5 * pixels + m] += g * other
        by_parameter[m, 7 * pixels + m] += g * third
        by_parameter[m, 11 * pixels + m] += sign * chip
        by_parameter[m, base + SENSITIVITY] += sign * chip * gain * whole
        by_parameter[m, base + CURVE] += sign * chip * chip * gain * whole
    for k in range(5):
        d[k] = g * (moved[i, k] + k1 * moved[j, k] + k2 * moved[1, k])
    by_shared(part, m, x, p, data, pose, d, g * disc, by_state, by_parameter)


@compiled
def disc_readings(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Changes of reading (2 t,) (mT) since a tare at a state (19,)."""
    pixels, rows, columns = int(data[COUNT]), int(data[ROWS]), int(data[COLUMNS])
    channels, first = 2 * pixels, ARRAYS + 12 * pixels
    patterns = data[first : first + channels * PATTERNS].reshape(channels, PATTERNS)
    first += channels * PATTERNS
    table = data[first : first + 2 * rows * columns].reshape(rows, columns, 2)
    pose, axis, seen, moved = np.empty(9), np.empty(3), np.empty(3), np.empty((3, 5))
    apart, field, slope, d = np.empty(3), np.empty(3), np.empty((3, 5)), np.empty(5)
    for m in range(channels):
        out[m] = p[9 * pixels + m]
        if len(by_parameter) > 0:
            by_parameter[m, 9 * pixels + m] = 1.0
        for k in range(PATTERNS):
            out[m] += patterns[m, k] * x[NEAR + k]
            by_state[m, NEAR + k] = patterns[m, k]
    for part in range(int(data[PARTS])):
        disc_pose(part, x, p, data, pose, axis)
        for q in range(pixels):
            pixel_seen(q, p, data, table, pose, axis, seen, moved, apart, field, slope)
            for c in range(2):
                channel_reading(
                    part, 2 * q + c, x, p, data, pose, seen, moved, d, out, by_state,
                    by_parameter,
                )  # fmt: skip


@compiled
def disc_answers(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Loads (first) and places (l,) that were learned, as polynomials of the place."""
    base, unit, loads = PER_PIXEL * int(data[COUNT]) + SHARED, data[UNIT], data[LOADS]
    terms = data[data.size - TERM * int(data[TERMS]) :].reshape(int(data[TERMS]), TERM)
    u, v, w = x[0] / unit, x[1] / unit, x[2] / unit
    # power[i, e + 1] is the power e; below 0 there is none, which ends derivatives
    power = np.zeros((4, DEGREE + 2))
    for i, value in enumerate((u, v, w, u * u + v * v)):
        power[i, 1] = 1.0
        for e in range(DEGREE):
            power[i, e + 2] = power[i, e + 1] * value
    out[:] = 0.0
    softer, bend = p[base + SOFTER - SHARED], p[base + BEND - SHARED]
    soft, label = 1.0 + (softer + bend * x[MAGNET]) * x[MAGNET], 1.0 + x[LABEL]
    for t in range(terms.shape[0]):
        f, a, b, c = int(terms[t, 0]), int(terms[t, 1]), int(terms[t, 2]), int(terms[t, 3])
        r, q, scale = int(terms[t, 4]), base + int(terms[t, 5]), terms[t, 6]
        if f < loads:
            scale *= soft * label
        side, deep, around = power[0, a + 1] * power[1, b + 1], power[2, c + 1], power[3, r + 1]
        if len(by_parameter) > 0:
            by_parameter[f, q] += scale * side * deep * around
        weight = scale * p[q]
        out[f] += weight * side * deep * around
        weight /= unit
        wider = 2 * r * power[3, r] * side
        by_state[f, 0] += weight * deep * (a * power[0, a] * power[1, b + 1] * around + u * wider)
        by_state[f, 1] += weight * deep * (b * power[0, a + 1] * power[1, b] * around + v * wider)
        by_state[f, 2] += weight * c * power[2, c] * side * around
    for f in range(out.size):
        if f < loads:
            by_state[f, MAGNET] = out[f] * (softer + 2 * bend * x[MAGNET]) / soft
            by_state[f, LABEL] = out[f] / label
        if f < loads and len(by_parameter) > 0:
            by_parameter[f, base + SOFTER - SHARED] = out[f] * x[MAGNET] / soft
            by_parameter[f, base + BEND - SHARED] = out[f] * x[MAGNET] ** 2 / soft


@compiled
def frame_rows(
    values: Array, baseline: Array, now: Array, chips: Array, usual_c: float, variance: Array,
    usual: Array, usual_noise: Array, spread: float, thermal: bool, readings: Array, prior: Array,
    information: Array, noise: Array, free: Bools,
) -> None:  # fmt: skip
    """Write readings and noise (s, 2 t) (mT) of frames; mean, inverse variance (s, 19) of priors.

    `now` (s, 4) are the chip's and the magnet's temperature with their sigmas, `chips` (s, t) were
    measured at the tare, where both differ by `spread` if none was; `variance` (s,) is the tare's
    over a frame's. `usual` (19,) is the inverse variance of the rest of the state. States that are
    estimated in any frame become `free` (19,).
    """
    for s in range(len(prior)):
        information[s], prior[s] = usual, 0.0
        noise[s] = usual_noise * math.sqrt(1.0 + variance[s])
        for q in range(values.shape[1]):
            for c in range(2):
                readings[s, 2 * q + c] = (values[s, q, c] - baseline[s, q, c]) / MT
        then = mean_row(chips[s]) - usual_c
        known = math.isfinite(then)
        for part in range(2):
            i, sigma = MAGNET if part == 0 else CHIP, now[s, 3 - 2 * part]
            before = 0.0 if known else spread
            prior[s, i], prior[s, i + 1] = now[s, 2 - 2 * part], then if known else 0.0
            if part == 0 and not thermal:
                prior[s, i], prior[s, i + 1], sigma, before = 0.0, 0.0, 0.0, 0.0
            information[s, i] = 1.0 / max(sigma, FIXED) ** 2
            information[s, i + 1] = 1.0 / max(before, FIXED) ** 2
            free[i] |= sigma > FIXED
            free[i + 1] |= before > FIXED


def readings_of(model: ModelPrior, parameters: Array, states: Array) -> tuple[Array, Array]:
    """Readings (s, 2 t) (mT) of states (s, 19) and their slopes (s, 2 t, 19)."""
    count, unused = len(model.noise), np.empty((0, len(parameters)))
    read, slopes = np.empty((len(states), count)), np.zeros((len(states), count, STATES))
    for state, out, slope in zip(states, read, slopes, strict=True):
        disc_readings(state, parameters, model.data, out, slope, unused)
    return read, slopes


def difference_basis(slope: Array, measured: Bools) -> Array:
    """Projection (n, m), orthonormal, that no uniform field of slopes (n, 19) passes."""
    uniform = slope[:, UNIFORM:MAGNET][:, measured]
    left, size, _ = np.linalg.svd(np.eye(len(slope)) - uniform @ np.linalg.pinv(uniform))
    return np.ascontiguousarray(left[:, size > 0.5])


def chip_axes(config: GradiometerConfig) -> Array:
    """Axes of the chips in sensor axes, shape (t, 3, 3)."""
    count = len(config.positions)
    return np.tile(np.eye(3), (count, 1, 1)) if config.rotations is None else config.rotations


def near_fields(pixels: Array, count: int, rng: np.random.Generator) -> Array:
    """Fields (s, t, 3) (T) at pixels (t, 3) (m) of dipoles of 1 A m2, 10 to 20 mm away."""
    way = rng.normal(size=(2, count, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    place = pixels.mean(axis=0) + way[0] * rng.uniform(*NEAR_DISTANCE, (count, 1))
    points = np.broadcast_to(pixels, (count, *pixels.shape))
    return dipole_field(points, place[:, None], way[1][:, None])


def near_patterns(pixels: Array, axes: Array) -> Array:
    """Readings (2 t, 6) (mT) beside uniform ones of dipoles nearby, by their size.

    `pixels` (t, 3) (m), `axes` (2 t, 3) of channels.
    """
    field = near_fields(pixels, NEAR_DRAWN, np.random.default_rng(0))
    field = field / np.linalg.norm(field.mean(axis=1), axis=1)[:, None, None]
    read = np.einsum('mi,smi->sm', axes, np.repeat(field, 2, axis=1))
    uniform = np.linalg.qr(axes[:, [i for i in range(3) if (axes[:, i] != 0).any()]])[0]
    read = read - read @ uniform @ uniform.T
    _, size, shape = np.linalg.svd(read / np.sqrt(len(read)), full_matrices=False)
    found = np.zeros((len(axes), PATTERNS))
    count = min(PATTERNS, len(size))
    found[:, :count] = (shape[:count] * size[:count, None]).T
    return found


def terms_of(answers: Answers, scales: Array) -> tuple[Array, Array, Integers]:
    """Terms (t, 7) of answers of scales (l,), and sizes and kinds (k,) of their coefficients.

    The elastomer is round: force along x is x times a function of depth and radius, along y is y
    times the same, and torques are across. What is not round is of a low degree, and small where
    it is not alike on both sides: force along x is odd in x and even in y, and so on.
    """
    along = ((1, 0), (0, 1), (0, 0))
    side = {'force': along, 'torque': ((0, 1), (1, 0), (1, 1)), 'position': along}
    terms: list[list[float]] = []
    sizes: dict[tuple[str | int, ...], float] = {}

    def add(key: tuple[str | int, ...], size: float, term: tuple[int, ...], sign: float) -> None:
        sizes.setdefault(key, size * scales[term[0]] * SMOOTH ** (int(key[2]) - 1))
        terms.append([*term, list(sizes).index(key), sign])

    for index, (name, axis) in enumerate((str(name), int(axis)) for name, axis in answers):
        (x, y), least = side[name][axis], 0 if name == 'position' else 1
        for z, radius in product(range(DEGREE + 1), range(DEGREE // 2 + 1)):
            degree = x + y + z + 2 * radius
            if least <= degree <= DEGREE:
                sign = -1.0 if (name, axis) == ('torque', 0) else 1.0
                add((name, axis == 2, degree, z), ROUND, (index, x, y, z, radius), sign)
        for a, b, c in product(range(DEGREE + 1), repeat=3):
            degree, alike = a + b + c, (a % 2, b % 2) == (x, y)
            most = DEGREE if alike else WRONG_DEGREE
            if least <= degree <= most and not (axis == 2 and (a, b) == (x, y)):
                size = UNEVEN if alike else WRONG
                add((index, alike, degree, a, b, c), size, (index, a, b, c, 0), 1.0)
    kinds = list(dict.fromkeys(key[:3] for key in sizes))
    found = np.array([kinds.index(key[:3]) for key in sizes], np.int64)
    return np.array(terms).reshape(-1, TERM), np.array(list(sizes.values())), found


def disc_prior(
    config: GradiometerConfig, answers: Answers, scales: Array, unit: float, usual_c: float, *,
    tared: bool,
    shape: tuple[int, int] = SHAPE,
) -> ModelPrior:  # fmt: skip
    """Model of a config with its priors: how far specimens differ.

    Answers are names and components of what is answered, loads first, and `scales` (l,) their
    sizes. Places are scaled over `unit` (mm), temperatures count from `usual_c` (degrees Celsius;
    NaN: none is measured), readings are changes since a tare or not, `shape` is of the table of
    the disc's field.
    """
    pixels, count, axes = config.positions, len(config.positions), chip_axes(config)
    gap, channels, base = config.gap / MM, 2 * count, PER_PIXEL * count
    terms, sizes, _ = terms_of(answers, scales)
    reach = reach_under(pixels, config.gap, config.disc_height)
    table, grid = disc_table(config.disc_diameter, config.disc_height, reach, shape)
    measured = axes[:, :, [0, 2]].transpose(0, 2, 1).reshape(-1, 3)
    warm = bool(np.isfinite(usual_c))
    p0, p1, p2 = config.sensitivity
    shift = usual_c - CALIBRATED_AT if warm else 0.0
    hall = (p0 + (p1 + p2 * shift) * shift, p1 + 2 * p2 * shift, p2)
    head = [
        count, *grid, *table.shape[:2], config.disc_height, unit, *hall,
        sum(name != 'position' for name, _ in answers), 1 + tared, len(terms),
    ]  # fmt: skip
    data = np.concatenate([
        head, (pixels / MM).ravel(), axes.ravel(), near_patterns(pixels, measured).ravel(),
        table.ravel(), terms.ravel(),
    ])  # fmt: skip
    mean, sigma = np.zeros((2, base + SHARED + len(sizes)))
    sigma[: 3 * count] = PIXELS_OFF
    mean[3 * count : 5 * count] = 1.0
    sigma[3 * count : 9 * count] = GAINS_OFF
    sigma[9 * count : 11 * count] = OFFSET_WARM if warm else OFFSET
    sigma[9 * count : 11 * count] = sigma[9 * count : 11 * count] if tared else ABSOLUTE
    sigma[11 * count : base] = DRIFT if warm else 0.0
    for index, (middle, width) in {
        REST: (0.0, REST_OFF), REST + 1: (0.0, REST_OFF), LEVEL: (0.0, LEVEL_OFF),
        LEVEL + 1: (0.0, LEVEL_OFF), GAP: (gap, GAP_OFF * gap),
        STRENGTH: (config.remanence, STRENGTH_OFF * config.remanence), LEAN: (0.0, LEAN_OFF),
        DEEPER: (0.0, COURSE_OFF / gap), WIDER: (0.0, COURSE_OFF / gap**2),
        WEAKER: (REMANENCE_SLOPE, 0.5e-3 * warm), SOFTER: (-2e-3, 2e-3 * warm),
        RISE: (EXPANSION * gap, 0.7 * EXPANSION * gap * warm), SENSITIVITY: (0.0, 5e-4 * warm),
        CURVE: (0.0, 1e-5 * warm), BEND: (0.0, 1e-5 * warm),
    }.items():  # fmt: skip
        mean[base + index], sigma[base + index] = middle, width
    sigma[base + SHARED :] = sizes
    measurable = np.abs(measured).max(axis=0) > 0
    state = np.zeros(STATES)
    state[PLACE:TILT], state[TILT:UNIFORM] = ANY, TILT_OFF
    state[UNIFORM:MAGNET] = np.where(measurable, ANY, CROSSED_FIELD)
    state[LABEL] = LABEL_OFF
    return ModelPrior(
        disc_readings, disc_answers, np.ones(channels), 0.05 * scales, np.zeros(STATES), state,
        mean, sigma, data,
    )  # fmt: skip


def width_groups(pixels: int, answers: Answers) -> Integers:
    """Parameters (k,) whose priors share a width: pixels, gains, terms of a degree; -1: none."""
    channels = 2 * pixels
    counts = [3 * pixels, channels, channels, channels, 2 * channels + SHARED]
    kinds = 4 + terms_of(answers, np.ones(len(answers)))[2]
    return np.concatenate([np.repeat([0, 1, 2, 3, -1], counts), kinds])


def polynomial_fit(model: ModelPrior, states: Array, f: Array) -> tuple[Array, Array]:
    """Parameters (k,) with coefficients of references (s, l) at states, and what is left (l,)."""
    k, first = len(model.parameters), PER_PIXEL * int(model.data[COUNT]) + SHARED
    slopes = np.zeros((*f.shape, k))
    out, by_state = np.empty(f.shape[1]), np.zeros((f.shape[1], STATES))
    for state, slope in zip(states, slopes, strict=True):
        disc_answers(state, model.parameters, model.data, out, by_state, slope)
    known = np.isfinite(f)
    weight = np.where(known, 1.0, 0.0) / model.answer_noise
    width = model.parameter_sigma[first:]
    terms = (slopes[:, :, first:] * width * weight[..., None]).reshape(-1, k - first)
    right = (np.nan_to_num(f) * weight).ravel()
    found = np.linalg.solve(terms.T @ terms + np.eye(k - first), terms.T @ right)
    parameters = np.append(model.parameters[:first], width * found)
    left = np.where(known, f - slopes @ np.append(np.zeros(first), width * found), np.nan)
    return parameters, np.maximum(np.sqrt(np.nanmean(left**2, axis=0)), model.answer_noise / 50)


def described(parameters: Array, pixels: int) -> dict[str, float]:
    """Parameters of the disc in SI units."""
    base = PER_PIXEL * pixels
    named = {
        'gap': (GAP, MM), 'remanence': (STRENGTH, 1.0), 'rest_x': (REST, MM),
        'rest_y': (REST + 1, MM), 'tilt_per_shift': (LEAN, 1 / MM),
        'remanence_per_degree': (WEAKER, 1.0), 'stiffness_per_degree': (SOFTER, 1.0),
    }  # fmt: skip
    found = {name: unit * float(parameters[base + i]) for name, (i, unit) in named.items()}
    return {**found, 'gain_spread': float(parameters[3 * pixels : 5 * pixels].std())}
