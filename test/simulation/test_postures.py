# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Postures of the shipped Allegro hands: pads of fingers and thumb face each other."""

import numpy as np
import pytest

from tactile_ros.hands import load_hand
from tactile_ros.simulation.hands import PAD, allegro_bodies
from tactile_ros.types import Array

mujoco = pytest.importorskip('mujoco')

FINGERS = ('index', 'middle', 'ring', 'thumb')  # in the order of the model's joints
# hand, degrees within which pads face each other, and the gaps between which they do (m)
HANDS = [
    ('allegro_v4', 12.0, (0.08, 0.04)),
    ('allegro_v5', 8.0, (0.08, 0.04)),
    ('allegro_v5_pinch', 16.0, (0.08, 0.04)),
    ('allegro_v5_sense', 12.0, (0.08, 0.04)),
    ('allegro_plexus', 25.0, (0.08, 0.055)),
]


@pytest.fixture(scope='module')
def model() -> object:
    text = f'<compiler angle="radian"/><worldbody>{allegro_bodies(1.0)}</worldbody>'
    return mujoco.MjModel.from_xml_string(f'<mujoco>{text}</mujoco>')


def pads(model: object, name: str, closure: float) -> dict[str, tuple[Array, Array]]:
    """Place (3,) (m) and normal (3,) of each finger's pad at a closure of all."""
    hand, data = load_hand(name), mujoco.MjData(model)
    for finger, entry in hand.fingers.items():
        at = 4 * FINGERS.index(finger)
        data.qpos[at : at + 4] = entry.posture(closure)
    mujoco.mj_kinematics(model, data)
    sites = {finger: model.site(f'{finger}_pad').id for finger in hand.fingers}
    normals = data.site_xmat.reshape(-1, 3, 3)[:, :, 2]
    return {finger: (data.site_xpos[i], normals[i]) for finger, i in sites.items()}


def opposition(found: dict[str, tuple[Array, Array]]) -> tuple[float, float]:
    """Gap (m) before the thumb's pad, and the largest angle (degrees) that pads are off."""
    thumb, normal = found.pop('thumb')
    middle = np.mean([place for place, _ in found.values()], axis=0) - thumb
    cosines = [-(other @ normal) for _, other in found.values()]
    cosines.append(normal @ middle / np.linalg.norm(middle))
    return float(normal @ middle) - 2 * PAD[2], float(np.degrees(np.arccos(min(cosines))))


@pytest.mark.parametrize(('name', 'most', 'between'), HANDS)
def test_pads_face_each_other_while_they_close(
    model: object, name: str, most: float, between: tuple[float, float]
) -> None:
    fingers = load_hand(name).fingers.values()
    first = next(iter(fingers)).corner
    gaps, angles = np.array(
        [opposition(pads(model, name, closure)) for closure in np.linspace(first, 1.0, 41)]
    ).T
    assert gaps[0] > between[0]
    assert gaps[-1] < between[1]
    assert (np.diff(gaps) < 0).all()
    assert angles[(gaps <= between[0]) & (gaps >= between[1])].max() < most
    # fingers leave the pre-grasp together, and open beyond it
    np.testing.assert_allclose([finger.corner for finger in fingers], first, atol=0.01)
    assert first <= 0 or opposition(pads(model, name, 0.0))[0] > gaps[0] + 0.01
