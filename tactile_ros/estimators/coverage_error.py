"""How far a model of coverage is from a finer one, and what that makes of a pose.

Every layout and outline has its own: it is measured when templates are built, at poses between
all steps of the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
    from tactile_ros.types import Array

MOST_POSES, FEWEST_POSES = 96, 16
LOOKS = 4_000_000  # at points, of all poses together, about
PLAY = 0.2  # of the reach: how far from the middle objects are tried
SEED = 6
FINER = 8  # times as many points
WIDE = (0.3, 0.9)  # least and largest width of a tube's contact, in radii
TOLERANCE = 1e-3  # of its area: what a taxel's outline is known by
LEAST = 1e-3  # of the largest cover: what a taxel errs by at least, whatever touches it
SLIGHT = 1e-4  # of the largest squared slope: no edge touches
FLAT = 0.25  # of the taxels under edges: those whose cover changes least
MIDDLE = 0.455  # median of the square of what is normal
NEVER = 1e-9  # what no taxel tells stays where it is


@dataclass(frozen=True)
class ModelError:
    """Of one object on one set of points.

    Attributes
    ----------
    edge : float
        Variance of where an edge seems to lie under a taxel, in squares of a step.
    floor : float
        Variance of the cover of a taxel under edges that move it against one another, in squares
        of the largest cover.
    shared : ndarray, shape (m,)
        Standard deviation of x, y, yaw and width beyond what taxels that err each by itself
        make of them, in units of the variant.
    """

    edge: float
    floor: float
    shared: Array


def tried_poses(variant: Variant, middle: Array, reach: float, points: int) -> Array:
    """Parameters (n, m) of a variant about the middle of an array, fewer for more points."""
    count = int(np.clip(LOOKS // points, FEWEST_POSES, MOST_POSES))
    rng = np.random.default_rng(SEED)
    place = middle + PLAY * reach * rng.uniform(-1, 1, (count, 2))
    turn = rng.uniform(-np.pi, np.pi, count)
    width = variant.radius * rng.uniform(*WIDE, count)
    return np.column_stack([place, turn, width])[:, : variant.free]


def model_error(
    seen: Callable[[Array], Array], finer: TaxelPoints, sharp: Variant, poses: Array
) -> ModelError:
    """Measure a model beside finer points.

    Parameters
    ----------
    seen : callable
        Slopes and cover (m + 1, k, t) of poses (k, m), as of `TaxelPoints.seen`.
    finer, sharp : TaxelPoints, Variant
        Points several times as many, and the object for discs of their size.
    poses : ndarray, shape (k, m)
        Where to look.
    """
    stacks, misses = [], []
    for pose in poses:
        stack = seen(pose[None])[:, 0]
        stacks.append(stack)
        misses.append(finer.cover(sharp, pose[None])[0] - stack[-1])
    rises = np.square(np.array(stacks)[:, :2]).sum(axis=1)
    top = max(float(stack[-1].max()) for stack in stacks)
    edge, floor = _parts(np.square(misses), rises)
    floor += float(np.square(TOLERANCE * finer.areas).mean())
    moved, own = [], []
    for stack, miss, rise in zip(stacks, misses, rises, strict=True):
        weight = 1.0 / (edge * rise + floor + (LEAST * top) ** 2)
        inverse = np.linalg.inv((stack * weight) @ stack.T + NEVER * np.eye(len(stack)))
        moved.append(inverse @ ((stack * weight) @ miss))
        own.append(np.diag(inverse))
    # by medians: few poses hang over the border of the array
    beyond = np.median(np.square(moved), axis=0) / MIDDLE - np.median(own, axis=0)
    beyond[:2] = beyond[:2].mean()
    return ModelError(edge, floor / top**2, np.sqrt(np.maximum(beyond, 0.0))[:-1])


def _parts(squared: Array, rises: Array) -> tuple[float, float]:
    """What squared errors (n, t) are per squared slope (n, t), and where edges cancel."""
    touched = rises > SLIGHT * rises.max()
    squared, rises = squared[touched], rises[touched]
    flat = rises <= np.quantile(rises, FLAT)
    floor = float(squared[flat].mean())
    edge = float((squared.sum() - floor * len(squared)) / rises.sum())
    # where the flat ones err most, all err alike
    return (edge, floor) if edge > 0 else (0.0, float(squared.mean()))
