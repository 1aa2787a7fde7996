"""MuJoCo, imported where a scene runs, and the frame of a scene's model."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from tactile_ros.errors import MissingPackageError

if TYPE_CHECKING:
    from types import ModuleType

TIME_STEP = 1e-3  # s


def load_engine() -> ModuleType:
    """MuJoCo's module.

    Raises
    ------
    MissingPackageError
        If it is not installed; the sentence says how to install it.
    """
    try:
        return importlib.import_module('mujoco')
    except ImportError as error:
        msg = 'simulated hands need MuJoCo: pip install mujoco'
        raise MissingPackageError(msg) from error


def scene_text(bodies: str, rest: str) -> str:
    """MJCF of a scene: a light, bodies, and what moves them.

    Parameters
    ----------
    bodies : str
        Inside of `worldbody`.
    rest : str
        Sections beside it: actuators, tendons, equalities.

    Returns
    -------
    str
        Friction is Coulomb's cone (elliptic) and hardly creeps; a pad's own coefficient holds
        wherever it touches, since pads have priority.
    """
    return f"""<mujoco model="grasp">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{TIME_STEP}" integrator="implicitfast" cone="elliptic" impratio="20"
    noslip_iterations="3"/>
  <visual>
    <global offwidth="640" offheight="480"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0.93 0.94 0.96" rgb2="0.93 0.94 0.96"
      width="8" height="8"/>
  </asset>
  <worldbody>
    <light pos="0.3 -0.4 1" dir="-0.3 0.4 -1" diffuse="0.4 0.4 0.4" castshadow="false"/>
    {bodies}
  </worldbody>
  {rest}
</mujoco>"""
