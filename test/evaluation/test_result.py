"""What a result says where nothing could be judged."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.evaluation.metrics import given_targets, target_errors, unjudged
from tactile_ros.types import ContactStates, Layout, Recording

BOARD = Layout(np.arange(6.0).reshape(2, 3), channels=('x', 'y', 'z'), unit='T')
NOTHING = 'none of position, force_x, force_y, force_z, torque_x, torque_y, torque_z'


def found(truth: dict[str, np.ndarray], **estimates: np.ndarray) -> tuple[str, ...]:
    """Sentences about four frames with some truth and some estimates."""
    recording = Recording.from_arrays(BOARD, np.zeros((4, 2, 3)), truth=truth)
    states = ContactStates.assemble(4, 2, {'valid': np.ones(4, bool), **estimates})
    counts = {target.name: target.spread.count for target in target_errors(recording, states)}
    return unjudged('ridge', counts, given_targets(states))


def axis(number: int, rows: slice = slice(None)) -> np.ndarray:
    """Vectors (4, 3) known along one axis in some rows."""
    vectors = np.full((4, 3), np.nan)
    vectors[rows, number] = 1.0
    return vectors


@pytest.mark.parametrize(
    ('truth', 'estimates', 'words'),
    [
        ({'force': axis(2)}, {'force': axis(0)}, 'it estimates force_x, truth has force_z'),
        ({'slip': np.ones(4, int)}, {'force': axis(0)}, f'force_x, truth has {NOTHING}'),
        ({'force': axis(2)}, {}, f'it estimates {NOTHING}, truth has force_z'),
        (
            {'force': axis(2, slice(2))},
            {'force': axis(2, slice(2, 4))},
            'no row with true force_z has an estimate',
        ),
    ],
    ids=['others', 'no truth', 'no estimate', 'other rows'],
)
def test_no_error_is_explained(
    truth: dict[str, np.ndarray], estimates: dict[str, np.ndarray], words: str
) -> None:
    (sentence,) = found(truth, **estimates)
    assert sentence.startswith('ridge has no error: ')
    assert sentence.endswith(words)


def test_one_error_is_enough() -> None:
    assert found({'force': axis(2), 'torque': axis(1)}, force=axis(2, slice(1))) == ()
