"""A hand in a MuJoCo scene: its bodies, what its driver takes, where its sensors lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.hands import HandDescription


@dataclass(frozen=True)
class HandModel:
    """A hand and how it answers.

    Attributes
    ----------
    description : HandDescription
        Driver, fingers and their sensors; joints and position actuators of the model have the
        names of the driver's joints.
    bodies, rest : str
        MJCF inside of `worldbody`, and beside it.
    pads : mapping of str to str
        For each sensor the pad's geom. A site of the same name is the sensor frame, z out of the
        skin.
    dead_time : float
        From a command's arrival until the drives follow it (s).
    lag : float
        Time constant of the drives (s).
    centre, across : tuple of float
        Where things are grasped (m), and along which direction.
    stiffness : float
        Largest force over closure of a finger on a stiff object (N).
    """

    description: HandDescription
    bodies: str
    rest: str
    pads: Mapping[str, str]
    dead_time: float
    lag: float
    centre: tuple[float, ...]
    across: tuple[float, ...]
    stiffness: float


def pad_friction(friction: float) -> str:
    """MJCF attributes of a soft pad: its coefficient, and what resists a turn about the normal."""
    return f'condim="4" priority="1" friction="{friction} 0.003 0.0001" solref="0.006 1"'


def servo(joint: str, gain: float, lag: float, most: float) -> str:
    """MJCF of a drive: a position loop behind a first-order lag.

    Parameters
    ----------
    joint : str
        Its name and the actuator's.
    gain : float
        Of the loop (N/m or N m/rad).
    lag : float
        Time constant of the target (s).
    most : float
        Largest force or torque (N or N m).
    """
    return (
        f'<general name="{joint}" joint="{joint}" biastype="affine" gainprm="{gain}" '
        f'biasprm="0 -{gain} 0" dyntype="filterexact" dynprm="{lag}" '
        f'forcerange="-{most} {most}"/>'
    )
