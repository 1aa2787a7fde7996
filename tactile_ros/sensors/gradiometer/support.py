"""What a calibration's recordings could not support, a sentence for each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.uniform_field import ENTRY
from tactile_ros.sensors.gradiometer.thermal import LEAST_RANGE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.sensors.gradiometer.features import Features
    from tactile_ros.sensors.gradiometer.reach import Reach
    from tactile_ros.sensors.gradiometer.target import Target
    from tactile_ros.types import Array

WHOLE = 0.9  # of full scale
FEW_GROUPS = 8
WANTED = ('force', 'torque')


def unsupported(
    config: GradiometerConfig,
    features: Features,
    targets: Sequence[Target],
    reach: Reach | None,
) -> list[str]:
    """Sentences on what was not told by the recordings of a fit; none before one."""
    if not features.readings_.fitted_:
        return []
    told = {target.name for target in targets}
    missing = ' and '.join(name for name in WANTED if name not in told)
    said = [f'{missing}: no truth told it, and the config has no stiffness'] if missing else []
    if targets:
        said += _range(config, targets) + _places(reach) + _groups(targets)
        said += _temperature(features.readings_.span_) + _warmth(features)
    if features.uniform_.uncertainty >= ENTRY:
        said.append('gains and crossed axes: no rest in known fields')
    return said


def _range(config: GradiometerConfig, targets: Sequence[Target]) -> list[str]:
    """Forces that were pressed, where full scale is farther."""
    spans = [
        (float(low), float(high), f'{low:.2g}..{high:.2g} N along {"xyz"[axis]}')
        for target in targets
        if target.name == 'force'
        for axis, low, high in zip(target.columns, *target.span_, strict=True)
    ]
    full = WHOLE * config.full_scale
    named = ', '.join(name for low, high, name in spans if max(-low, high) < full)
    return [f'force beyond {named}; full scale is {config.full_scale:.2g} N'] if named else []


def _places(reach: Reach | None) -> list[str]:
    if reach is None or reach.directions_ == 3:
        return []
    return [f'forces along other ways than the {reach.directions_} that presses moved the disc']


def _groups(targets: Sequence[Target]) -> list[str]:
    groups = int(min(target.report_['groups'] for target in targets))
    return [f'errors of presses unlike the {groups} told'] if groups < FEW_GROUPS else []


def _temperature(span: Array) -> list[str]:
    low, high = (float(end) for end in span)
    if not np.isfinite([low, high]).all():
        return ['temperature: no chip told one']
    if high - low > LEAST_RANGE:
        return [f'temperatures beyond {low:.0f}..{high:.0f} C']
    return [f'temperatures other than about {0.5 * (low + high):.0f} C']


def _warmth(features: Features) -> list[str]:
    """How the disc follows the chip, and rows without a temperature of their own."""
    said = []
    if not features.lag_is_told:
        said.append('how the disc lags behind the chip: no stamps tell it, nor thermal_lag')
    if features.silent_:
        said.append(f'temperatures in {features.silent_} rows, which were not learned from')
    return said
