"""A sensor read for a few seconds: rate, jitter, noise, damage, and what to do about them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli.machine import BAD, NOTE, OK, WARN, Finding
from tactile_ros.errors import DeviceTimeout, TactileError
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Array, Device, Frame, Layout

READ_S = 0.5
SLOW, IRREGULAR = 0.8, 0.5
NOISY = 10.0
TO_SIGMA = 1.4826 / np.sqrt(6)  # median of |second differences| -> standard deviation
TROUBLES = {
    'nacks': 'check the wires and the addresses of the chips',
    'resets': 'check the supply: chips lose it for moments',
    'bus_errors': 'check pull-ups and wires of the bus',
    'stalls': 'check the supply and the wires',
    'crc_errors': 'check cable and baud rate: bytes arrive damaged',
    'framing_errors': 'check cable and baud rate: bytes arrive damaged',
    'dropped': 'close what else uses the processor, or lower the rate: frames are lost',
    'reconnects': 'check the plug: the port comes and goes',
    'clock_jumps': 'check the supply of the board: its clock jumps',
}
# a quiet chip repeats itself now and then
RARELY = 0.05
MARKS = {
    TaxelStatus.SATURATED: 'lower the gain, or keep magnets away',
    TaxelStatus.WRAPPED: 'lower the gain, or keep magnets away',
    TaxelStatus.STUCK: 'switch the sensor off and on; replace what stays stuck',
    TaxelStatus.ERROR: 'check the wires and the supply of these taxels',
    TaxelStatus.STALE: 'lower the rate of the board: it outruns its chips',
}


@dataclass(frozen=True)
class Trial:
    """What was read.

    Attributes
    ----------
    layout : Layout
        Of the sensor.
    frames : list of Frame
        In their order.
    failure : str
        Why it could not be opened or fell silent; empty: it did not.
    counters : dict of str to int
        Of the driver.
    """

    layout: Layout
    frames: list[Frame]
    failure: str
    counters: dict[str, int]


def watch(
    device: Device, seconds: float, monotonic: Callable[[], float] = time.monotonic
) -> Trial:
    """Open a device and read it for so many seconds; no failure is raised."""
    frames: list[Frame] = []
    failure = ''
    try:
        with device:
            end = monotonic() + seconds
            while monotonic() < end:
                try:
                    frames.append(device.read(READ_S))
                    failure = ''
                except DeviceTimeout as err:
                    failure = str(err)
    except TactileError as err:
        failure = str(err)
    counted = getattr(device, 'counters', None)
    counters: dict[str, int] = {} if counted is None else dict(counted())
    return Trial(device.layout, frames, failure, counters)


def findings(trial: Trial) -> list[Finding]:
    """What a trial says and what to do."""
    if len(trial.frames) < 4:
        what = f'{len(trial.frames)} frames came'
        remedy = trial.failure or 'check that the sensor is powered and is this kind of sensor'
        return [Finding('frames', BAD, what, remedy), *_troubles(trial)]
    broken = [Finding('connection', BAD, 'fell silent', trial.failure)] if trial.failure else []
    return [*broken, *_pace(trial), _noise(trial), _temperature(trial), *_marks(trial),
            *_troubles(trial)]  # fmt: skip


def _pace(trial: Trial) -> list[Finding]:
    """Rate and jitter, from the stamps."""
    gaps = np.diff([frame.stamp_ns or 0 for frame in trial.frames]) * 1e-9
    rate, jitter = 1.0 / gaps.mean(), float(gaps.std())
    nominal = trial.layout.rate_hz
    what = f'{rate:.4g} Hz, nominal {nominal:g} Hz'
    slow = rate < SLOW * nominal
    remedy = 'set rate_hz to what the sensor does, or find what holds it up (latency timer, bus)'
    irregular = jitter * nominal > IRREGULAR
    calm = 'close what else uses the processor, lower the latency timer of the port'
    return [
        Finding('rate', WARN if slow else OK, what, remedy if slow else ''),
        Finding(
            'jitter',
            WARN if irregular else OK,
            f'{1e3 * jitter:.3g} ms',
            calm if irregular else '',
        ),
    ]


def noise_of(trial: Trial) -> Array:
    """Noise of every taxel and channel, shape (t, c) (unit of values), whatever moves slowly."""
    values = np.array([frame.values for frame in trial.frames])
    noise: Array = TO_SIGMA * np.nanmedian(np.abs(np.diff(values, 2, axis=0)), axis=0)
    return noise


def _step(trial: Trial) -> float:
    """Smallest change of any reading, that of the converter where it is coarse; inf: none."""
    steps = np.abs(np.diff([frame.values for frame in trial.frames], axis=0))
    return float(np.min(steps, where=steps > 0, initial=np.inf))


def _noise(trial: Trial) -> Finding:
    """Noise of the taxels, and those that differ from the others."""
    with np.errstate(all='ignore'):
        noise = noise_of(trial)
    unit = trial.layout.unit if trial.layout.unit != '1' else 'of full scale'
    usual = np.nanmedian(noise, axis=0)
    told = ', '.join(f'{c} {x:.2g}' for c, x in zip(trial.layout.channels, usual, strict=True))
    step = _step(trial)
    odd = np.flatnonzero((noise > NOISY * np.maximum(usual, step)).any(axis=1))
    # readings of a coarse converter may stand still at rest
    fine = bool((usual > 2 * step).any())
    silent = np.flatnonzero((noise == 0).all(axis=1)).tolist() if fine else []
    what = f'{told} {unit} (standard deviation, median of the taxels)'
    if len(odd):
        remedy = f'check taxels {odd.tolist()}: they are over {NOISY:g} times as noisy as the rest'
        return Finding('noise', WARN, what, remedy)
    if silent:
        return Finding('noise', WARN, what, f'check taxels {silent}: their readings never change')
    return Finding('noise', OK, what)


def _temperature(trial: Trial) -> Finding:
    """Temperature of the chips."""
    warm = trial.frames[-1].temperature_c
    if warm is None or not np.isfinite(warm).any():
        return Finding('temperature', NOTE, 'not measured')
    return Finding('temperature', OK, f'{np.nanmin(warm):.1f} to {np.nanmax(warm):.1f} C')


def _marks(trial: Trial) -> list[Finding]:
    """Taxels that were marked."""
    bits = np.array([np.zeros(trial.layout.shape[0], np.uint8) if f.status is None else f.status
                     for f in trial.frames])  # fmt: skip
    found = []
    for bit, remedy in MARKS.items():
        share = (bits & int(bit) > 0).mean(axis=0)
        taxels = np.flatnonzero(share > (RARELY if bit == TaxelStatus.STALE else 0)).tolist()
        if taxels:
            state = BAD if share.max() > 0.5 else WARN
            what = f'taxels {taxels}, in up to {100 * share.max():.2g} % of the frames'
            found.append(Finding(str(bit.name).lower(), state, what, remedy))
    return found


def _troubles(trial: Trial) -> list[Finding]:
    """What the driver counted."""
    return [
        Finding(name.replace('_', ' '), WARN, str(trial.counters[name]), remedy)
        for name, remedy in TROUBLES.items()
        if trial.counters.get(name)
    ]
