# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Films of a simulated hand and its forces, drawn by MuJoCo without a screen."""

import os
from ctypes.util import find_library
from pathlib import Path
from types import ModuleType

from PIL.Image import Image

from reference.hand_world import HandWorld
from tactile_ros.errors import MissingPackageError
from tactile_ros.evaluation.figures import nice_ticks
from tactile_ros.simulation.hands import load_engine

SIZE, COLOURS = (240, 320), 64  # rows and columns of a picture
BELOW, LEFT, RIGHT = 120, 30, 310  # rows below a picture for forces; columns of their axes
TOP, BOTTOM = 264, 340  # rows of the axes
INKS = ('#0060a8', '#c34f00', '#007d5f', '#a13d80')  # of the pads, as in the drawings
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
        self.forces: list[dict[str, float]] = []  # what each pad's sensor says (N), by picture

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
        states = {name: pad.state for name, pad in world.pads.items()}
        self.forces.append({n: float(s.force[2]) for n, s in states.items() if s.valid})

    def save(self, path: Path) -> Path:
        """Write the GIF and let the renderer go."""
        first, *others = (self._shown_at(i) for i in range(len(self.pictures)))
        shown_ms = 1e3 * self._shown
        first.save(path, save_all=True, append_images=others, duration=shown_ms, loop=0)
        if self._renderer is not None:
            self._renderer.close()
        return path

    def _shown_at(self, index: int) -> Image:
        """A picture over the forces until then."""
        pillow = _pillow()
        from PIL.ImageDraw import Draw

        names = list(dict.fromkeys(name for one in self.forces for name in one))
        end = max(len(self.forces) - 1, 1)
        top = 1.1 * max((f for one in self.forces for f in one.values()), default=1.0)
        shown = pillow.new('RGB', (SIZE[1], SIZE[0] + BELOW), 'white')
        shown.paste(pillow.fromarray(self.pictures[index]))
        pen = Draw(shown)
        pen.line([(LEFT, TOP), (LEFT, BOTTOM), (RIGHT, BOTTOM)], '#5c626b')
        for force in nice_ticks(0.0, top, 3):
            y = BOTTOM - (BOTTOM - TOP) * force / top
            pen.text((LEFT - 4, y), f'{force:g}', '#1b1d21', anchor='rm')
        pen.text((LEFT, BOTTOM + 3), f'{index * self._period:.1f} s', '#1b1d21')
        pen.text((RIGHT, BOTTOM + 3), 'force by the sensors (N)', '#1b1d21', anchor='ra')
        for i, name in enumerate(names):
            seen = [
                (k, one[name]) for k, one in enumerate(self.forces[: index + 1]) if name in one
            ]
            pen.line(
                [(LEFT + (RIGHT - LEFT) * k / end, BOTTOM - (BOTTOM - TOP) * max(f, 0.0) / top)
                 for k, f in seen], INKS[i % 4], 2,
            )  # fmt: skip
            now = self.forces[index].get(name)
            words = f'{name} not valid' if now is None else f'{name} {now:.2f} N'
            pen.text((LEFT + 90 * i, TOP - 17), words, INKS[i % 4])
        return shown.quantize(COLOURS)


def _pillow() -> ModuleType:
    """Pillow's images."""
    try:
        from PIL import Image
    except ImportError as error:
        msg = 'GIFs of scenes need Pillow: pip install pillow'
        raise MissingPackageError(msg) from error
    return Image
