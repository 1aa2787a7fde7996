# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Films of a simulated hand, drawn by MuJoCo without a screen."""

from __future__ import annotations

import os
from ctypes.util import find_library
from typing import TYPE_CHECKING

from tactile_ros.errors import MissingPackageError
from tactile_ros.simulation.hand_world import load_engine

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

    from tactile_ros.simulation.hand_world import HandWorld

SIZE, COLOURS = (240, 320), 64  # rows and columns of a picture
EMPTY = '<mujoco><worldbody/></mujoco>'
NO_SCREEN = 'pictures of scenes need OpenGL without a screen: EGL or OSMesa of Mesa'


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


class Film:
    """Pictures of a world, to be saved as a GIF.

    `rate_hz` is of simulated time, which is shown `speed_up` times as fast; the camera looks at
    `look_at` (m) from a distance (m), azimuth and elevation (degrees).
    """

    def __init__(
        self, rate_hz: float, look_at: tuple[float, float, float], distance: float,
        azimuth: float, elevation: float, speed_up: float = 1.0,
    ) -> None:  # fmt: skip
        self._period, self._shown = 1.0 / rate_hz, 1.0 / rate_hz / speed_up
        self._view = (look_at, distance, azimuth, elevation)
        self._due = 0.0
        self._renderer = None
        self.pictures = []

    def __call__(self, world: HandWorld) -> None:
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
        self._renderer.update_scene(world.data, camera)
        self.pictures.append(self._renderer.render())

    def save(self, path: Path) -> Path:
        """Write the GIF and let the renderer go."""
        image = _pillow()
        first, *others = (image.fromarray(one).quantize(COLOURS) for one in self.pictures)
        shown_ms = 1e3 * self._shown
        first.save(path, save_all=True, append_images=others, duration=shown_ms, loop=0)
        if self._renderer is not None:
            self._renderer.close()
        return path


def _pillow() -> ModuleType:
    """Pillow's images."""
    try:
        from PIL import Image
    except ImportError as error:
        msg = 'GIFs of scenes need Pillow: pip install pillow'
        raise MissingPackageError(msg) from error
    return Image
