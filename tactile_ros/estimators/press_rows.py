"""The steps of `press_descent`, channel by channel, for a compiler."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Bools, Integers

    Singles = npt.NDArray[np.float32]


@compiled
def spline_rows(t: float, value: Singles, slope: Singles) -> None:
    """Weights (4,) of a cubic spline's coefficients, and their slopes; both are filled."""
    u = 1.0 - t
    value[0], value[3] = u * u * u / 6.0, t * t * t / 6.0
    value[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    value[2] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    slope[0], slope[3] = -3.0 * u * u / 6.0, 3.0 * t * t / 6.0
    slope[1] = (9.0 * t * t - 12.0 * t) / 6.0
    slope[2] = (12.0 * u - 9.0 * u * u) / 6.0


@compiled
def faint(weight: float, slope: float) -> bool:
    """Whether a row's share is lost in the rounding of singles: at nodes one in four is."""
    return abs(weight) + abs(slope) < 1e-15


@compiled
def plane_rows(
    flat: Singles, first: int, stride: int, weight: Singles, slope: Singles, work: Singles
) -> None:
    """Sixteen neighbouring rows of a table as one, and its slopes; `work` (3, r) is filled."""
    v0, v1, v2, v3 = weight[1, 0], weight[1, 1], weight[1, 2], weight[1, 3]
    u0, u1, u2, u3 = slope[1, 0], slope[1, 1], slope[1, 2], slope[1, 3]
    work[:] = 0
    for j in range(4):
        w, s = weight[0, j], slope[0, j]
        if faint(w, s):
            continue
        row = first + j * stride
        a, b, c, d = flat[row], flat[row + 1], flat[row + 2], flat[row + 3]
        for k in range(work.shape[1]):
            value = v0 * a[k] + v1 * b[k] + v2 * c[k] + v3 * d[k]
            work[0, k] += w * value
            work[1, k] += s * value
            work[2, k] += w * (u0 * a[k] + u1 * b[k] + u2 * c[k] + u3 * d[k])


@compiled
def template_rows(
    flat: Singles, grid: Array, about: Array, pose: Array, work: Singles, parts: Singles
) -> None:
    """One template and its slopes, as of `PressBank.at`; `parts` (4, 3 d) is filled."""
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    turn = pose[2] * about[1]
    x = min(max(pose[0] / grid[0] + grid[2], 1.0), 2.0 * grid[2] - 1.0 - 1e-9)
    y = min(max(pose[1] / grid[1] + grid[3], 1.0), 2.0 * grid[3] - 1.0 - 1e-9)
    low_turn, low_x, low_y = np.floor(turn), np.floor(x), np.floor(y)
    spline_rows(turn - low_turn, weight[0], slope[0])
    spline_rows(x - low_x, weight[1], slope[1])
    spline_rows(y - low_y, weight[2], slope[2])
    for k in range(4):
        slope[0, k] *= np.float32(about[1])
        slope[1, k] *= np.float32(1.0 / grid[0])
        slope[2, k] *= np.float32(1.0 / grid[1])
    nx, ny, turns = 2 * int(grid[2]) + 1, 2 * int(grid[3]) + 1, int(about[2])
    parts[:] = 0
    last = -1
    for i in range(4):
        w, s = weight[0, i], slope[0, i]
        if faint(w, s):
            continue
        row = int(about[0]) + (int(low_turn) + i - 1) % turns
        if row != last:  # round heads have one
            first = (row * nx + int(low_x) - 1) * ny + int(low_y) - 1
            plane_rows(flat, first, ny, weight[1:], slope[1:], work)
        last = row
        for k in range(work.shape[1]):
            parts[0, k] += w * work[0, k]
            parts[1, k] += w * work[1, k]
            parts[2, k] += w * work[2, k]
            parts[3, k] += s * work[0, k]


@compiled
def cleared_rows(rows: Array, span: Array) -> None:
    """What a uniform field could have added (3, d) is taken out of rows (n, d), in place."""
    for j in range(len(rows)):
        a, b, c = 0.0, 0.0, 0.0
        for k in range(rows.shape[1]):
            a += rows[j, k] * span[0, k]
            b += rows[j, k] * span[1, k]
            c += rows[j, k] * span[2, k]
        for k in range(rows.shape[1]):
            rows[j, k] -= a * span[0, k] + b * span[1, k] + c * span[2, k]


@compiled
def depth_rows(
    parts: Singles, powers: Array, usual: float, weight: Array, span: Array, wanted: Array
) -> float:
    """Depth over the usual one at which a template is as strong as the press."""
    d = len(wanted)
    p, q, r = powers[0] * usual, powers[1] * usual**2, powers[2] * usual**3
    row = np.empty((1, d))
    for k in range(d):
        row[0, k] = p * parts[0, k] + q * parts[0, d + k] + r * parts[0, 2 * d + k]
        row[0, k] *= weight[k]
    cleared_rows(row, span)
    told, size = 0.0, 0.0
    for k in range(d):
        told += row[0, k] * wanted[k]
        size += row[0, k] * row[0, k]
    return told / size


@compiled
def plain_rows(parts: Singles, powers: Array, a: float, plain: Array) -> None:
    """Pattern at a depth and its slopes with place, turn and depth; `plain` (5, d) is filled."""
    d = plain.shape[1]
    p, q, r = powers[0] * a, powers[1] * a**2, powers[2] * a**3
    for j in range(4):
        for k in range(d):
            plain[j, k] = p * parts[j, k] + q * parts[j, d + k] + r * parts[j, 2 * d + k]
    p, q, r = powers[0], 2 * powers[1] * a, 3 * powers[2] * a**2
    for k in range(d):
        plain[4, k] = p * parts[0, k] + q * parts[0, d + k] + r * parts[0, 2 * d + k]


@compiled
def solved_rows(normal: Array, right: Array, move: Array) -> None:
    """Solution (4,) of equations with a symmetric matrix, by Cholesky; `move` is filled."""
    low = np.zeros((4, 4))
    for i in range(4):
        for j in range(i + 1):
            total = normal[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(total) if i == j else total / low[j, j]
    for i in range(4):
        move[i] = right[i]
        for k in range(i):
            move[i] -= low[i, k] * move[k]
        move[i] /= low[i, i]
    for i in range(3, -1, -1):
        for k in range(i + 1, 4):
            move[i] -= low[k, i] * move[k]
        move[i] /= low[i, i]


@compiled
def misfit_rows(
    plain: Array, weight: Array, span: Array, wanted: Array, damping: float, rows: Array,
    normal: Array, scale: Array, move: Array,
) -> tuple[float, float]:  # fmt: skip
    """Cost, and what a step promises; normal matrix, its scale and the step are filled."""
    d = len(wanted)
    for j in range(5):
        for k in range(d):
            rows[j, k] = plain[j, k] * weight[k]
    cleared_rows(rows, span)
    cost, right, scaled = 0.0, np.zeros(4), np.zeros(4)
    normal[:] = 0.0
    for k in range(d):
        miss = wanted[k] - rows[0, k]
        cost += miss * miss
        for i in range(4):
            right[i] += rows[i + 1, k] * miss
            for j in range(i + 1):
                normal[i, j] += rows[i + 1, k] * rows[j + 1, k]
    for i in range(4):
        scale[i] = np.sqrt(normal[i, i]) + 1e-30
        scaled[i] = right[i] / scale[i]
    for i in range(4):
        for j in range(i + 1):
            normal[i, j] /= scale[i] * scale[j]
            normal[j, i] = normal[i, j]
        normal[i, i] += damping
    solved_rows(normal, scaled, move)
    promised = 0.0
    for i in range(4):
        promised += scaled[i] * move[i]
        move[i] /= scale[i]
    return cost, promised


@compiled
def moved_rows(pose: Array, move: Array, limit: Array, tried: Array) -> None:
    """A pose after a step, as of `press_descent.moved`; `tried` (4,) is filled."""
    for i in range(3):
        tried[i] = pose[i] + min(max(move[i], -limit[i]), limit[i])
    ratio = min(max(1.0 + move[3] / pose[3], limit[3]), limit[4])
    tried[3] = min(max(pose[3] * ratio, limit[5]), limit[6])


@compiled
def begun_rows(
    flat: Singles, grid: Array, about: Array, head: Integers, limit: Array, stop: Array,
    weight: Array, span: Array, wanted: Array, powers: Array, work: Singles, parts: Singles,
    rows: Array, pose: Array, cost: Array, normal: Array, scale: Array, plain: Array,
    move: Array, promised: Array,
) -> None:  # fmt: skip
    """Descents (s) at their beginning, at depths that fit; all from `pose` on is filled."""
    for i in range(len(head)):
        template_rows(flat, grid, about[head[i]], pose[i], work, parts)
        ratio = depth_rows(parts, powers, pose[i, 3], weight, span, wanted)
        pose[i, 3] = min(max(pose[i, 3] * max(ratio, stop[2]), limit[5]), limit[6])
        plain_rows(parts, powers, pose[i, 3], plain[i])
        cost[i], promised[i] = misfit_rows(
            plain[i], weight, span, wanted, stop[3], rows, normal[i], scale[i], move[i]
        )


@compiled
def worth_rows(
    cost: Array, promised: Array, head: Integers, stop: Array, own: Array, active: Bools
) -> bool:
    """Whether any descent may still change what is said, and which: `active` is updated."""
    best = cost.min()
    own[:] = np.inf
    for i in range(len(cost)):
        own[head[i]] = min(own[head[i]], cost[i])
    for i in range(len(cost)):
        lively = promised[i] > max(stop[0], stop[1] * (cost[i] - best))
        active[i] = active[i] and lively and cost[i] - 2.0 * promised[i] <= own[head[i]]
    return bool(active.any())


@compiled
def kept_rows(normal: Array, scale: Array, whole: Array, change: Array) -> float:
    """Share of what a whole step promises that a change of the pose keeps."""
    gain, top = 0.0, 0.0
    for i in range(4):
        pull, back = 0.0, 0.0
        for j in range(4):
            pull += normal[i, j] * whole[j] * scale[j]
            back += normal[i, j] * change[j] * scale[j]
        gain += change[i] * scale[i] * (2 * pull - back)
        top += whole[i] * scale[i] * pull
    return gain / max(top, 1e-300)


@compiled
def finished_rows(
    promised: Array, move: Array, limit: Array, stop: Array, normal: Array, scale: Array,
    pose: Array, cost: Array, plain: Array,
) -> None:  # fmt: skip
    """Last steps, so short that a straight line tells what they do; from `pose` on is updated."""
    tried = np.empty(4)
    for i in range(len(cost)):
        if promised[i] > stop[0]:
            continue
        moved_rows(pose[i], move[i], limit, tried)
        cost[i] -= promised[i] * kept_rows(normal[i], scale[i], move[i], tried - pose[i])
        for j in range(4):
            change = tried[j] - pose[i, j]
            for k in range(plain.shape[2]):
                plain[i, 0, k] += change * plain[i, j + 1, k]
        pose[i] = tried


@compiled
def descend_rows(
    flat: Singles, grid: Array, about: Array, head: Integers, limit: Array, stop: Array,
    rounds: int, weight: Array, span: Array, wanted: Array, powers: Array,
    pose: Array, cost: Array, normal: Array, scale: Array, plain: Array,
) -> None:  # fmt: skip
    """Descents (s) of one press: `press_descent.descend`; all from `pose` on is filled."""
    s, d = len(head), len(wanted)
    work, parts = np.empty((3, 3 * d), np.float32), np.empty((4, 3 * d), np.float32)
    rows, flatter, own = np.empty((5, d)), np.empty((5, d)), np.empty(len(about))
    move, promised, active = np.empty((s, 4)), np.empty(s), np.ones(s, np.bool_)
    steep, size, step, tried = np.empty((4, 4)), np.empty(4), np.empty(4), np.empty(4)
    begun_rows(
        flat, grid, about, head, limit, stop, weight, span, wanted, powers, work, parts, rows,
        pose, cost, normal, scale, plain, move, promised,
    )  # fmt: skip
    for _ in range(rounds):
        if not worth_rows(cost, promised, head, stop, own, active):
            break
        for i in np.flatnonzero(active):
            moved_rows(pose[i], move[i], limit, tried)
            template_rows(flat, grid, about[head[i]], tried, work, parts)
            plain_rows(parts, powers, tried[3], flatter)
            new, more = misfit_rows(
                flatter, weight, span, wanted, stop[3], rows, steep, size, step
            )
            if new < cost[i]:
                pose[i], move[i], cost[i], promised[i] = tried, step, new, more
                normal[i], scale[i], plain[i] = steep, size, flatter
            else:
                move[i] *= stop[4]
                promised[i] *= stop[4]
    finished_rows(promised, move, limit, stop, normal, scale, pose, cost, plain)
