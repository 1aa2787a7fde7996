# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""MuJoCo, imported where a scene runs: the frame of a model of a scene, and films of it."""

from __future__ import annotations

import importlib
import os
from ctypes.util import find_library
from typing import TYPE_CHECKING, Protocol

from tactile_ros.errors import MissingPackageError

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


TIME_STEP = 1e-3  # s
SIZE, COLOURS = (240, 320), 64  # rows and columns of a picture
EMPTY = '<mujoco><worldbody/></mujoco>'
NO_SCREEN = 'pictures of scenes need OpenGL without a screen: EGL or OSMesa of Mesa'


def load_engine() -> ModuleType:
    """MuJoCo's module, or a `MissingPackageError` that says how to install it."""
    try:
        return importlib.import_module('mujoco')
    except ImportError as error:
        msg = 'simulated hands need MuJoCo: pip install mujoco'
        raise MissingPackageError(msg) from error


def scene_text(bodies: str, rest: str) -> str:
    """MJCF of a scene: a light, `bodies` inside of `worldbody`, and what moves them beside it.

    Friction is Coulomb's cone (elliptic) and hardly creeps; a pad's own coefficient holds wherever
    it touches, since pads have priority.
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


def prefer_no_screen() -> None:
    """Let MuJoCo draw without a screen, where a library for that is here; before its import."""
    for name, library in (('egl', 'EGL'), ('osmesa', 'OSMesa')):
        if find_library(library):
            os.environ.setdefault('MUJOCO_GL', name)


def why_not() -> str:
    """Sentence why nothing can be drawn here; empty: it can."""
    engine = load_engine()
    try:
        _pillow()
        engine.Renderer(engine.MjModel.from_xml_string(EMPTY), 8, 8).close()
    except MissingPackageError as error:
        return str(error)
    except Exception:
        return NO_SCREEN
    return ''


class World(Protocol):
    """Running scene of MuJoCo."""

    @property
    def time(self) -> float:
        """Simulated time (s)."""

    @property
    def model(self) -> object:
        """Model of MuJoCo."""

    @property
    def data(self) -> object:
        """State of MuJoCo."""


class Film:
    """Pictures of a world, to be saved as a GIF.

    `rate_hz` is of simulated time, which is shown `speed_up` times as fast; the camera looks at
    `look_at` (m) from a distance (m), azimuth and elevation (degrees).
    """

    def __init__(
        self,
        rate_hz: float,
        look_at: tuple[float, float, float] = (0.0, 0.0, 0.0),
        distance: float = 0.35,
        azimuth: float = 120.0,
        elevation: float = -20.0,
        speed_up: float = 1.0,
    ) -> None:
        self._period, self._shown = 1.0 / rate_hz, 1.0 / rate_hz / speed_up
        self._view = (look_at, distance, azimuth, elevation)
        self._due = 0.0
        self._renderer: object = None
        self.pictures: list[object] = []

    def __call__(self, world: World) -> None:
        """Take a picture, if it is time; a `MissingPackageError` where nothing can draw."""
        if world.time < self._due:
            return
        self._due = world.time + self._period
        engine = load_engine()
        if self._renderer is None:
            try:
                self._renderer = engine.Renderer(world.model, *SIZE)
            except Exception as error:  # each library of OpenGL has errors of its own
                raise MissingPackageError(NO_SCREEN) from error
        camera = engine.MjvCamera()
        camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = self._view
        self._renderer.update_scene(world.data, camera)  # type: ignore[attr-defined]
        self.pictures.append(self._renderer.render())  # type: ignore[attr-defined]

    def save(self, path: Path) -> Path:
        """Write the GIF and let the renderer go."""
        image = _pillow()
        frames = [
            image.fromarray(picture).quantize(COLOURS)  # type: ignore[attr-defined]
            for picture in self.pictures
        ]
        frames[0].save(
            path, save_all=True, append_images=frames[1:], duration=1e3 * self._shown, loop=0
        )
        self.close()
        return path

    def close(self) -> None:
        """Let the renderer go."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None:
            renderer.close()  # type: ignore[attr-defined]


def _pillow() -> object:
    """Pillow's images."""
    try:
        from PIL import Image
    except ImportError as error:
        msg = 'GIFs of scenes need Pillow: pip install pillow'
        raise MissingPackageError(msg) from error
    return Image
