"""Simulated sensors that a hand presses: their force is what the closing of a fake hand says.

Readings between rest and the strongest press of the sensor's own signal are interpolated by force.
The boards' bytes come from pseudo-terminals, so that drivers read them as hardware.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors import load_sensor
from tactile_ros.types import Closing

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Array, Recording, Twin

BINS = 24


def has_port(sensor: str) -> bool:
    """Whether a sensor is on a serial port, so that its twin may be in another process."""
    return 'serial' in load_sensor(sensor).transports[0]


class PressTable:
    """Readings of a sensor over the normal force of one press.

    Parameters
    ----------
    presses : Recording
        With truth of force; its strongest press is taken.
    """

    def __init__(self, presses: Recording) -> None:
        normal = np.nan_to_num(presses.truth['force'][:, 2])
        last = int(normal.argmax())
        first = int(np.flatnonzero(normal[:last] <= 0.0)[-1]) + 1
        rest = presses.values[normal == 0.0].mean(axis=0)
        edges = np.linspace(0.0, normal[last], BINS + 1)
        place = np.digitize(normal[first : last + 1], edges[1:-1])
        bins = np.unique(place)
        rows = presses.values[first : last + 1]
        self.force = np.array([0.0, *(normal[first : last + 1][place == b].mean() for b in bins)])
        self.values = np.stack([rest, *(rows[place == b].mean(axis=0) for b in bins)])

    def at(self, force: float) -> Array:
        """Readings (t, c) at a normal force (N); beyond the strongest those of it."""
        upper = int(np.clip(np.searchsorted(self.force, force), 1, len(self.force) - 1))
        low, high = self.force[upper - 1], self.force[upper]
        share = min(max((force - low) / (high - low), 0.0), 1.0)
        between: Array = (1.0 - share) * self.values[upper - 1] + share * self.values[upper]
        return between


class PressedTwins(Closing):
    """Twins of one sensor on serial ports, pressed from outside.

    Parameters
    ----------
    sensor : str
        Key of a sensor on a serial port.
    ports : sequence of str
        Path at which each appears.
    seed : int
        Of presses and noise, counted up.

    Attributes
    ----------
    force : list of float
        That presses each now (N).
    twins : list of Twin
        In their order, for faults.
    """

    def __init__(self, sensor: str, ports: Sequence[str], seed: int = 0) -> None:
        spec = load_sensor(sensor)
        config, connection = spec.config(), spec.connection()
        if not has_port(sensor):
            msg = f'a sensor that a fake hand presses must have a serial port; received {sensor!r}'
            raise ValueError(msg)
        self.force = [0.0] * len(ports)
        self._held = ExitStack()
        self.twins: list[Twin] = []
        table = PressTable(spec.presses(config, seed))
        for i, port in enumerate(ports):
            twin = spec.simulate(config, connection, self._signal(table, i), seed + i)
            self.twins.append(self._held.enter_context(twin))
            place = Path(port)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.unlink(missing_ok=True)
            place.symlink_to(twin.port)
            self._held.callback(place.unlink, missing_ok=True)

    def _signal(self, table: PressTable, index: int) -> Callable[[float], Array]:
        """Readings of a twin, whatever the time."""
        return lambda _: table.at(self.force[index])

    def close(self) -> None:
        """End the twins and remove their ports."""
        self._held.close()
