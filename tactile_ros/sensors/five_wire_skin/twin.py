# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The five-wire skin behind a microcontroller on a serial port, real or simulated.

It is no model of [5] to estimate with: the border conducts perfectly, so that potentials are
linear; the resistance to the border is a smooth bump, Velostat follows a power law, and creep is
left out. Some presses are drawn over the sheet like a finger. The foil has a weak pull-down:
untouched, all three readings are 0. A real one may float.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.connections import FramedConnection
from tactile_ros.devices.framed_protocol import Payload, five_wires
from tactile_ros.enrolment import REST_S, Programme, Touches, Truth, growing_loads, recorded
from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig, layout
from tactile_ros.types import Array, Layout, Recording
from tactile_ros.types.config_fields import whole

NOISE = 5e-4  # of the supply
AT_ONE_NEWTON, EXPONENT = 2000.0, 0.7  # Velostat (ohm, 1)
MIDDLE = 0.3  # resistance from the sheet's middle to its border, in squares
BORDER = 12.5e-3  # nothing is pressed nearer to the border
PRESSES = 40
EVERY, STROKE = 3, 25e-3  # every third press is drawn over the sheet, by about so much


@dataclass(frozen=True)
class Strokes(Programme):
    """Presses that move over the sheet while they last."""

    moved: Array = field(default_factory=lambda: np.zeros((1, 3)))  # (n, 3) to their ends (m)

    def at(self, times: npt.ArrayLike) -> Touches:
        """Touches at times (s,) in seconds since the start."""
        touches = super().at(times)
        t = np.mod(np.asarray(times, np.float64), self.duration_s) - REST_S
        share = np.clip((t % self.period_s) / (self.period_s - self.pause_s), 0.0, 1.0)
        row = np.clip(touches.press, 0, len(self.moved) - 1)
        position = touches.position + share[:, None] * self.moved[row]
        return Touches(touches.press, position, touches.force, touches.share)


def reading(config: FiveWireSkinConfig, touches: Touches) -> Array:
    """Readings (s, 1, c), fractions of the supply: u_AC, u_BD, R0 / (R0 + R).

    A third excitation has A and B at the supply and C and D at 0.
    """
    touched = touches.force[:, 2] > 0
    x, y = (np.nan_to_num(touches.position[:, :2]) / config.size).T
    u_ac, u_bd = 1 - (x + y) / 2, 0.5 + (x - y) / 2
    sheet = config.sheet_resistance * MIDDLE * 16 * x * (1 - x) * y * (1 - y)
    load = np.where(touched, touches.force[:, 2], 1.0)
    resistance = sheet + AT_ONE_NEWTON * load**-EXPONENT
    divider = config.reference_resistance / (config.reference_resistance + resistance)
    known = [u_ac, u_bd, divider, 1 - y][: len(config.channels)]
    read = np.stack(known, axis=-1) * touched[:, None]
    return np.broadcast_to(read[:, None], (len(read), len(config.positions), len(known)))


def truth(touches: Touches) -> Truth:
    """Place, and the force along z, the only one that is seen."""
    force = touches.force.copy()
    force[:, :2] = np.nan
    return {'position': touches.position, 'force': force}


def programme(config: FiveWireSkinConfig, seed: int, count: int) -> Strokes:
    """Presses of 1..15 N, as in [5], all over the sheet but for its border; some are drawn."""
    rng = np.random.default_rng(seed)
    margin = np.minimum(BORDER, config.size / 8)
    place = margin + (config.size - 2 * margin) * rng.uniform(0, 1, (count, 2))
    load = growing_loads(count, 1.0, 15.0, rng)
    turn, drawn = rng.uniform(0, 2 * np.pi, count), np.arange(count) % EVERY == EVERY - 1
    away = STROKE * np.column_stack([np.cos(turn), np.sin(turn)]) * drawn[:, None]
    end = np.clip(place + away, margin, config.size - margin)
    flat = np.zeros(count)
    return Strokes(
        np.column_stack([place, flat]),
        load[:, None] * np.array([0.0, 0.0, 1.0]),
        moved=np.column_stack([end - place, flat]),
    )


def presses(
    config: FiveWireSkinConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with position and normal force, one stream after a tare.

    `noise` is that of a channel (fraction of the supply); None: half a thousandth.
    """
    return recorded(
        layout(config), programme(config, seed, count), lambda touches: reading(config, touches),
        truth, NOISE if noise is None else noise, seed, (0.0, 1.0),
    )  # fmt: skip


@dataclass(frozen=True)
class FiveWireSkinConnection(FramedConnection):
    """A microcontroller that excites the corners in turn and sends its counts in frames.

    [5] used the 12 bits of a PIC18F25K80.
    """

    full_count: int = whole(4095, 'count of the converter at the supply', 1, 0xFFFF)

    def payload(self, layout: Layout) -> Payload:
        """Counts of all wires."""
        return five_wires(self.full_count, layout.shape[1])

    def scale(self) -> float:
        """Share of the supply per count."""
        return 1 / self.full_count
