"""Which model of its physics a calibration chose, and what terms of its scene cost and buy."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.signals import Report

KINDS = ('model: ', 'term: ')


def sentences(report: Report) -> list[str]:
    """What a report says of models and terms, a sentence for each."""
    said = []
    for name, found in report.items():
        if name.startswith('model: '):
            said.append(
                f'{name}; it errs by {found["worst_error"]:.2g} at most, '
                f'noise is {found["noise"]:.2g}'
            )
        elif name.startswith('term: '):
            said.append(
                f'{name}; estimated it widens errors {found["costs"]:.3g} times, '
                f'left out it would {found["buys"]:.3g} times'
            )
    return said
