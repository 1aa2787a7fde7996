"""One vector from the frames of a press: its course is told apart from its pattern.

All frames of a press show the same pattern at growing depth. Weighted by how far each frame has
come, their mean has the least noise; what is left of the course are its moments, by which the
powers of the depth enter. How fast a press comes down is thus discounted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array

QUIET, QUIETS = 0.15, 0.1891  # this part of readings is nearer to 0 than so many deviations
LATE = 0.34  # of a window: frames that tell the pattern first
TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class PressVectors:
    """Presses (n) of one skin.

    Attributes
    ----------
    pattern : ndarray, shape (n, d)
        Change of field at the deepest frame (T), from all frames.
    powers : ndarray, shape (n, 3)
        Of the course, by which powers 1, 2, 3 of the largest depth enter the pattern.
    frames : ndarray, shape (n,)
        As many frames at full depth have as little noise.
    """

    pattern: Array
    powers: Array
    frames: Array

    def variance(self, noise: Array, still: float) -> Array:
        """Variance of patterns (n, d) from noise (d,) of frames and errors that do not average.

        Baselines have noise of their own and drift: `still` (T) is the deviation of all that.
        """
        frames = np.maximum(self.frames, TINY)[:, None]
        return np.asarray(np.square(noise) / frames + still**2)

    def still(self, noise: Array) -> float:
        """Deviation that does not average (T), from the quietest readings of presses.

        Readings far from a press show nothing but this and noise (d,); two deviations of a frame
        are the most that it may be.
        """
        quiet = np.quantile(np.abs(self.pattern), QUIET, axis=1) / QUIETS
        usual = np.square(noise).mean() / np.maximum(self.frames, TINY)
        found = np.quantile(np.square(quiet) - usual, QUIET)
        return float(np.sqrt(np.clip(found, 0.0, 4 * np.square(noise).mean())))

    def rows(self, rows: npt.NDArray[np.intp]) -> PressVectors:
        """Some of the presses."""
        return PressVectors(self.pattern[rows], self.powers[rows], self.frames[rows])


def press_vector(window: Array, common: Array) -> tuple[Array, Array, float]:
    """Pattern, powers and count of frames of one press.

    Parameters
    ----------
    window : ndarray, shape (w, d)
        Changes of field in its frames; rows with NaN are left out.
    common : ndarray, shape (d, 3)
        Orthonormal patterns of a uniform field, which tell nothing of the course.

    Returns
    -------
    pattern, powers, frames
        Rows of `PressVectors`; NaN where no frame is whole.
    """
    whole = window[np.isfinite(window).all(axis=1)]
    if not len(whole):
        return np.full(window.shape[1], np.nan), np.full(3, np.nan), 0.0
    count = max(1, int(np.ceil(LATE * len(whole))))
    late = whole[-count:].sum(axis=0) / count
    late -= common @ (late @ common)  # frames are measured along it: no need to clear them too
    course = np.maximum(whole @ late, 0.0)
    course /= max(float(course.max()), TINY)
    if not course.any():
        course[:] = 1.0
    square = course * course
    squared = float(square.sum())
    powers = np.array([1.0, square @ course / squared, square @ square / squared])
    return course @ whole / squared, powers, squared


def press_vectors(windows: list[Array], common: Array) -> PressVectors:
    """Of several presses, each of frames (w, d)."""
    parts = [press_vector(window, common) for window in windows]
    d = len(common)
    return PressVectors(
        np.array([part[0] for part in parts]).reshape(-1, d),
        np.array([part[1] for part in parts]).reshape(-1, 3),
        np.array([part[2] for part in parts]),
    )
