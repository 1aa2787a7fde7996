"""Joint states that are fresh and yet tell nothing: frozen, or of a hand that was moved away."""

from __future__ import annotations

import numpy as np

from tactile_ros.hands.joints import HandWatch

SLACK = np.array([0.05, 0.05])


def watch() -> HandWatch:
    return HandWatch(('a', 'b'), SLACK, 0.3)


def test_the_same_posture_again_and_again_while_commands_move_is_frozen() -> None:
    made, still = watch(), np.array([0.2, 0.5])
    for k in range(50):
        made.hear(still)
        made.send(still + np.array([0.01 * k, 0.0]), 0.01 * k)
        assert bool(made.frozen(0.01 * k)) == (k > 36)  # further than the slack since 0.06 s
    assert made.frozen(0.5) == 'joint states are frozen (0.440 s) while commands move'
    made.hear(still + np.array([0.0, 1e-6]))
    assert not made.frozen(0.51)
    made.forget()
    assert not made.frozen(9.0)


def test_a_hand_at_rest_and_one_that_flickers_are_not() -> None:
    rest, blocked = watch(), watch()
    for k in range(500):
        rest.hear(np.array([0.2, 0.5]))
        rest.send(np.array([0.2, 0.5]) + 0.02 * np.sin(k), 0.01 * k)
        blocked.hear(np.array([0.2, 0.5 + 1e-6 * (k % 2)]))
        blocked.send(np.array([0.6, 0.5]), 0.01 * k)
        assert not rest.frozen(0.01 * k)
        assert not blocked.frozen(0.01 * k)


def test_a_hand_that_was_moved_by_others_is_named_and_one_on_its_way_is_not() -> None:
    made = watch()
    assert not made.strayed()
    made.hear(np.array([0.2, 0.5]))
    made.send(np.array([0.4, 0.5]), 0.0)
    for on_its_way in ([0.3, 0.5], [0.4, 0.54], [0.44, 0.5]):
        made.hear(np.array(on_its_way))
        assert not made.strayed()
    made.hear(np.array([0.4, 1.38]))
    assert made.strayed() == 'b came back 0.880 from its last command: it was moved by others'
