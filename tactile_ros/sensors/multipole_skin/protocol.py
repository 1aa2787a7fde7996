"""The data collection of [1]: which heads come down where, and how often.

Nine heads (square, triangle and circle of 10, 15 and 20 mm) at twenty-five places evenly over the
skin, thirty presses each; three bars in six postures. [1] gives neither the places nor the sizes
of the bars, and of its twelve heads (rectangles, too) no drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.multipole_skin.config import layout
from tactile_ros.sensors.multipole_skin.signal import DEPTH, NOISE
from tactile_ros.sensors.multipole_skin.specimen import POWERS, Specimen
from tactile_ros.types import Outline, Recording

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.types import Array

SIZES = (10e-3, 15e-3, 20e-3)  # m
SAMPLES = 30  # presses of a head at a place
POSTURES = tuple(np.radians([0.0, 30.0, 60.0, 90.0, 120.0, 150.0]))
TARE = 5  # frames before each press
RISE = (4.0, 12.0)  # frames in which a head comes down
PAUSE_S = 2.0


def _regular(name: str, corners: int, radius: float, turn: float = 0.0) -> Outline:
    """A regular polygon."""
    angle = turn + 2 * np.pi * np.arange(corners) / corners
    return Outline(name, (radius * np.column_stack([np.cos(angle), np.sin(angle)]),))


def _box(name: str, length: float, width: float) -> Outline:
    """A rectangle."""
    return Outline(name, (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length, width] / 2,))


def nine_heads() -> tuple[Outline, ...]:
    """Squares, triangles and circles of three sizes: edge, edge and diameter."""
    found = []
    for size in SIZES:
        mm = round(1e3 * size)
        found.append(_box(f'square_{mm}', size, size))
        found.append(_regular(f'triangle_{mm}', 3, size / np.sqrt(3), np.pi / 2))
        found.append(_regular(f'circle_{mm}', 48, size / 2))
    return tuple(found)


def bars() -> tuple[Outline, ...]:
    """Three bars, which press in six postures."""
    sizes = ((30e-3, 5e-3), (25e-3, 6e-3), (35e-3, 4e-3))
    return tuple(_box(f'bar_{1e3 * a:.0f}x{1e3 * b:.0f}', a, b) for a, b in sizes)


def stations() -> Array:
    """Twenty-five places evenly over the skin, shape (25, 2) (m)."""
    line = 11e-3 * np.arange(-2, 3)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def collected(
    specimen: Specimen,
    heads: Sequence[Outline],
    places: Array,
    seed: int,
    samples: int = SAMPLES,
    turns: Sequence[float] = (0.0,),
    noise: float = NOISE,
) -> Recording:
    """Every head at every place and turn, some presses each.

    Parameters
    ----------
    specimen : Specimen
        That is pressed.
    heads : sequence of Outline
        `label` is an index into them.
    places : ndarray, shape (p, 2)
        Of their origins (m).
    seed : int
        Of depths, speeds and noise.
    samples : int
        Presses of a head at a place and turn.
    turns : sequence of float
        Of the heads (rad).
    noise : float
        Of a channel (T).

    Returns
    -------
    Recording
        A stream for each press: tare rows, then a window of its frames; head by head, place by
        place, turn by turn.
    """
    config, rng = specimen.config, np.random.default_rng([47, seed])
    what = np.array([
        [label, *place, turn] for label in range(len(heads)) for place in places for turn in turns
    ])  # fmt: skip
    terms = np.array([specimen.terms(heads[int(row[0])], row[1:]) for row in what])
    presses = np.repeat(np.arange(len(what)), samples)
    depths = _courses(rng, len(presses), config.window)
    change = np.einsum('nwp,nptc->nwtc', depths[..., None] ** POWERS, terms[presses])
    rows = TARE + config.window
    values = np.tile(specimen.rest(), (len(presses), rows, 1, 1))
    values[:, TARE:] += change
    values += noise * rng.normal(size=values.shape)
    stiffness = np.array([specimen.stiffness(head) for head in heads])
    return _recording(specimen, what[presses], values, stiffness, depths)


def _courses(rng: np.random.Generator, count: int, window: int) -> Array:
    """Depths (n, w) of heads that come down at some speed and then hold (m)."""
    begun, rise = rng.uniform(0.3, 1.0, (count, 1)), rng.uniform(*RISE, (count, 1))
    whole = rng.uniform(*DEPTH, (count, 1))
    return np.asarray(whole * np.clip((np.arange(window) + begun) / rise, 0.0, 1.0))


def _recording(
    specimen: Specimen, what: Array, values: Array, stiffness: Array, depths: Array
) -> Recording:
    """Streams of presses (n) of label, place and turn (n, 4), with their truth."""
    count, rows = values.shape[:2]
    pressed = np.arange(rows) >= TARE
    touched = np.tile(pressed, count)

    def every(column: Array, blank: float) -> Array:
        each = np.repeat(column, rows, axis=0)
        shape = (-1,) + (1,) * (each.ndim - 1)
        return np.where(touched.reshape(shape), each, blank)

    force = np.zeros((count, rows, 3))
    force[:, pressed, 2] = stiffness[what[:, 0].astype(int), None] * depths
    place = np.column_stack([what[:, 1:3], np.full(count, specimen.top)])
    truth: dict[str, npt.ArrayLike] = {
        'label': every(what[:, 0], -1).astype(np.int64),
        'position': every(place, np.nan),
        'yaw': every(what[:, 3], np.nan),
        'force': force.reshape(-1, 3),
        'in_contact': touched.astype(np.int8),
        'repetition': np.repeat(np.arange(count), rows),
    }
    step = 1e9 / specimen.config.rate_hz
    pause = np.repeat(np.arange(count), rows) * (1e9 * PAUSE_S)
    return Recording.from_arrays(
        layout(specimen.config),
        values.reshape(count * rows, *values.shape[2:]),
        stamp_ns=np.round(np.arange(count * rows) * step + pause).astype(np.int64),
        stream=np.repeat(np.arange(count), rows),
        tare=~touched,
        truth=truth,
    )


def windows_of(recording: Recording, window: int) -> Array:
    """Changes of field since the tare of every press, shape (n, window, d) (T)."""
    values = recording.values.reshape(-1, TARE + window, recording.values[0].size)
    return np.asarray(values[:, TARE:] - values[:, :TARE].mean(axis=1, keepdims=True))
