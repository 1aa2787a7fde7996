"""Which model a calibration chose, what terms of its scene buy, what recordings told and lack."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.types import Report

LACK, FOUND = 'not told: ', 'found: '
KINDS = ('model: ', 'term: ', LACK, FOUND)


def sentences(report: Report) -> list[str]:
    """What a report says of models and terms, and what it lacks, a sentence for each."""
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
        elif name.startswith((LACK, FOUND)):
            figures = ', '.join(f'{what} {value:.3g}' for what, value in found.items())
            said.append(f'{name}; {figures}' if figures else name)
    return said
