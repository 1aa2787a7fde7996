"""One multipole skin as it was made, and what heads of any outline do to it.

No skin is as its drawing: chips lie and point aside and differ in gain, the sheet is uneven and
its bands are not quite where they should be. The body is a bonded layer under a rigid punch,
solved wave by wave, and the sheet the carpet of dipoles that is needed at the noise of the chips
(`fidelity`): what the templates of `press_templates` approximate by series on a coarser grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.estimators.sheet_calibration import bands_of
from tactile_ros.physics.elastomer import FlatPunch, Layer, PunchedCarpet
from tactile_ros.physics.fidelity import BLOCK_COST, DIPOLE_COST, Choice, Model, choose, region
from tactile_ros.physics.magnet_sheet import Sheet, carpet, harmonics
from tactile_ros.physics.magnetics import dipole_field, in_chip_axes

if TYPE_CHECKING:
    from collections.abc import Callable

    from scipy.interpolate import CubicSpline

    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Bools, Outline

RADIUS, DEEPEST, FARTHEST = 6e-3, 0.6e-3, 10e-3
PLAY = 0.5e-3  # m, of the sheet at rest, to any side
FIDELITY_LEVELS = 2
# pitch (m) and Gauss points along each side of a part
CARPETS = (
    (5e-3, 1), (2.5e-3, 1), (1.25e-3, 1), (0.625e-3, 1), (5e-3, 2), (2.5e-3, 2), (1.875e-3, 2),
    (1.25e-3, 2),
)  # fmt: skip
FINEST = (1.25e-3, 3)  # on twice as many levels
MARGIN = 1.5  # of the sheet, that a map of the layer is wide
DEEP = 10.0  # thicknesses of a layer that stands for a half-space
HARMONICS = (1, 2, 4)
ROUNDING = 1e-12  # m


def sheet_of(config: MultipoleSkinConfig) -> Sheet:
    """The magnetised sheet at rest."""
    low = float(config.positions[:, 2].mean()) + config.gap
    even = np.full(2, config.remanence)
    return Sheet(
        np.asarray(config.sheet_size), low, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, even,
    )  # fmt: skip


def rest_model(config: MultipoleSkinConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice for the sheet at rest, which may sit off its place, and all models."""
    chips, sheet = config.positions, sheet_of(config)
    count = len(chips)

    def shifted(field: Callable[[Array], Array]) -> Callable[[Array], Array]:
        return lambda states: field(chips - states[:, None])

    def dipoles(pitch: float, levels: int) -> Model:
        places, moments = carpet(sheet, pitch, levels)
        return Model(
            f'{len(places)} dipoles',
            shifted(lambda at: dipole_field(at, places, moments)),
            DIPOLE_COST * len(places) * count,
            size=(len(places),),
        )

    blocks = len(sheet.bands)
    exact = Model('exact bands', shifted(sheet.field), BLOCK_COST * blocks * count)
    models = [dipoles(5e-3, 1), dipoles(2.5e-3, 1), dipoles(2.5e-3, 2), dipoles(1.25e-3, 2)]
    if config.magnetisation == 'M4':
        models += [
            Model(
                f'{n} harmonics',
                shifted(lambda at, n=n: harmonics(sheet, at, n)),  # type: ignore[misc]
                40.0 * n * count,
                size=(n,),
            )
            for n in HARMONICS
        ]
    states = region(-PLAY * np.ones(3), PLAY * np.ones(3), 4)
    return choose(models, exact, states, noise, every=True), [*models, exact]


class PressedSheet:
    """Change of the readings by a round head, on squares of one pitch.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the skin.
    pitch : float
        Of the carpet and of the map of the layer (m).
    law : str
        'bonded', 'half-space', 'springs', or 'even' for a bonded layer under even pressure.
    points, levels : int
        Gauss points along each side of a square, and over the thickness.
    """

    def __init__(
        self, config: MultipoleSkinConfig, pitch: float, law: str = 'bonded', points: int = 1,
        levels: int = FIDELITY_LEVELS,
    ) -> None:  # fmt: skip
        self.config, self.law, self.pitch = config, law, pitch
        self.body = config.layer_thickness + config.sheet_thickness
        deep = DEEP if law == 'half-space' else 1.0
        shear = config.youngs_modulus / (2 * (1 + config.poisson_ratio))
        self.layer = Layer(deep * self.body, shear, config.poisson_ratio)
        sheet = sheet_of(config)
        self.places, self.moments = carpet(sheet, pitch, levels, points)
        count = 2 * int(np.ceil(MARGIN * sheet.size.max() / pitch / 2)) + 1
        line = pitch * (np.arange(count) - count // 2)
        self.line, self.levels = line, np.unique(self.places[:, 2])
        self.rest = dipole_field(config.positions, self.places, self.moments)

    def readings(self, states: Array) -> Array:
        """Changes (s, n) (T) of heads at x, y, sunk by a depth: states (s, 3) (m)."""
        return np.stack([self.change(*state) for state in states])

    def change(self, x: float, y: float, depth: float) -> Array:
        """Change (n,) (T) of one head."""
        moved = self.movement(x, y, depth)
        field = dipole_field(self.config.positions, self.places + moved, self.moments)
        return in_chip_axes(field - self.rest, self.config.rotations).reshape(-1)

    def movement(self, x: float, y: float, depth: float) -> Array:
        """Displacement (g, 3) (m) of the dipoles."""
        if self.law == 'bonded':
            return self._exact(x, y, depth)
        # the map is centred on the head, so that its squares cover it alike everywhere
        covered = np.hypot(*np.meshgrid(self.line, self.line)) <= RADIUS
        pressure = self._pressure(covered, depth)
        moved = np.zeros_like(self.places)
        for level in self.levels:
            here = np.isclose(self.places[:, 2], level)
            shift = self._map(pressure, self.layer.thickness - self._below(float(level)))
            moved[here] = self._between(shift, self.places[here, :2] - np.array([x, y]))
        return moved

    def _below(self, level: float) -> float:
        """Depth of a level of dipoles below the surface (m)."""
        top = float(self.levels.mean()) + self.config.sheet_thickness / 2
        return round(top - level, 12)

    def _exact(self, x: float, y: float, depth: float) -> Array:
        """The same under a rigid head on the bonded layer."""
        apart = self.places[:, :2] - np.array([x, y])
        distance = np.hypot(*apart.T)
        farthest = float(np.hypot(*self.config.sheet_size) / 2 + np.sqrt(2) * FARTHEST)
        moved = np.empty_like(self.places)
        for level in self.levels:
            here = np.isclose(self.places[:, 2], level)
            away, up = _punched(self.layer, farthest, self._below(float(level)))(distance[here]).T
            side = apart[here] / np.maximum(distance[here], ROUNDING)[:, None]
            moved[here] = depth * np.column_stack([side * away[:, None], up])
        return moved

    def _pressure(self, covered: Bools, depth: float) -> Array:
        """Pressure of a head on squares (ny, nx) (Pa); for springs how deep they sink (m)."""
        if self.law == 'half-space':
            return self.layer.punch(covered, self.pitch, depth)
        even = np.asarray(depth * covered, np.float64)
        if self.law == 'springs':
            return even
        sunk = self.layer.displacement(even, self.pitch, self.layer.thickness)
        return np.asarray(-depth / sunk[covered][:, 2].mean() * even)

    def _map(self, pressure: Array, z: float) -> Array:
        """Displacement (ny, nx, 3) at a height (m) over the base."""
        if self.law == 'springs':
            return np.asarray(-pressure[..., None] * np.array([0.0, 0.0, z / self.body]))
        return self.layer.displacement(pressure, self.pitch, z)

    def _between(self, shift: Array, at: Array) -> Array:
        """A map (ny, nx, 3) at places (g, 2) from its middle, linear between squares."""
        last = len(self.line) - 1
        position = np.clip(at / self.pitch + len(self.line) // 2, 0, last - 1e-9)
        first = np.floor(position).astype(np.int64)
        u = position - first
        found = np.zeros((len(at), 3))
        for a in (0, 1):
            for b in (0, 1):
                weight = (u[:, 0] if a else 1 - u[:, 0]) * (u[:, 1] if b else 1 - u[:, 1])
                found += weight[:, None] * shift[first[:, 1] + b, first[:, 0] + a]
        return found


@lru_cache
def _punched(layer: Layer, farthest: float, below: float) -> CubicSpline:
    """Movement at a depth (m) under the head, over the distance from its axis."""
    return FlatPunch(layer, RADIUS, farthest).movement(below)


def pressed_model(
    config: MultipoleSkinConfig, pitch: float, law: str = 'bonded', points: int = 1,
    levels: int = FIDELITY_LEVELS,
) -> Model:  # fmt: skip
    """Model of the pressed sheet, its cost counted without the layer's."""
    pressed = PressedSheet(config, pitch, law, points, levels)
    count = len(pressed.places)
    named = {'bonded': 'bonded layer', 'even': 'even pressure'}.get(law, law)
    several = f' with {points} x {points} points' if points > 1 else ''
    cost = DIPOLE_COST * count * len(config.positions)
    name = f'{1e3 * pitch:g} mm{several}, {named}'
    return Model(name, pressed.readings, cost, size=(count,))


def pressed_choice(
    config: MultipoleSkinConfig, noise: float, states: Array
) -> tuple[Choice, list[Model], Model]:
    """Choice among carpets that a bonded layer carries, all of them, and the finest."""
    models = [pressed_model(config, pitch, points=points) for pitch, points in CARPETS]
    pitch, points = FINEST
    finest = pressed_model(config, pitch, points=points, levels=2 * FIDELITY_LEVELS)
    return choose(models, finest, states, noise, every=True), models, finest


def pressed_states(count: int, corners: int = 0, seed: int = 0) -> Array:
    """Heads of the scene, of which deep ones at corners come first: x, y, depth, (n, 3) (m)."""
    low = np.array([-FARTHEST, -FARTHEST, 0.2 * DEEPEST])
    states = region(low, np.array([FARTHEST, FARTHEST, DEEPEST]), count, seed)
    return np.concatenate([states[1:8:2][:corners], states[8:]])


PITCH, LEVELS, POINTS = 1.25e-3, 2, 2  # of the carpet that `fidelity` chooses at 4 uT
POWERS = np.arange(1, 4)  # of the depth, in which the change of field is a sum
UNDULATION = 60e-3  # m, wavelength of what is uneven along a band
MOST = 0.4999  # Poisson ratio


@dataclass(frozen=True)
class Flaws:
    """What a skin has and its drawing does not say: standard deviations."""

    # of each chip to any side, of all bands along y, of all chips along z (m)
    misplaced: float = 0.15e-3
    aside: float = 0.2e-3
    gap: float = 0.1e-3
    tilt: float = 0.02  # of each chip about any axis (rad)
    gain: float = 0.03  # of each channel, as a share
    # from band to band and along them, and of the whole sheet, as shares of the remanence
    uneven: float = 0.05
    remanence: float = 0.1
    stray: float = 30e-6  # resting field of the Earth, in each component (T)
    turning: float = 0.0  # share of the body's turns that magnets follow: no deviation


NONE = Flaws(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Specimen:
    """A skin with flaws.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Its drawing.
    flaws : Flaws
        How large they are.
    seed : int
        Which skin it is.

    Attributes
    ----------
    chips : ndarray, shape (t, 3)
        Hall elements (m).
    responses : ndarray, shape (t, 3, 3)
        Field in sensor axes -> reading.
    sheet : Sheet
        With the strengths and the place of its bands, even along them.
    """

    def __init__(
        self, config: MultipoleSkinConfig, flaws: Flaws | None = None, seed: int = 0
    ) -> None:
        flaws, rng = Flaws() if flaws is None else flaws, np.random.default_rng([43, seed])
        self.config, self.flaws = config, flaws
        count = len(config.positions)
        self.chips = config.positions + flaws.misplaced * rng.normal(size=(count, 3))
        self.chips[:, 2] += flaws.gap * rng.normal()
        self.responses = _responses(config, flaws, rng)
        self.sheet = _sheet(config, flaws, rng)
        self.places, moments = carpet(self.sheet, PITCH, LEVELS, POINTS)
        wave = np.sin(2 * np.pi * self.places[:, 0] / UNDULATION + rng.uniform(0, 2 * np.pi))
        more = flaws.uneven * wave[:, None] * moments
        self.moments, stray = moments + more, flaws.stray * rng.normal(size=3)
        # blocks are exact where a carpet is coarse; what is uneven along them is small
        self.still = self.sheet.field(self.chips) + self._field(more) + stray
        nodes = (np.unique(axis) for axis in self.places.T)
        self.punched = PunchedCarpet(self._layer(), *nodes)
        self._unpressed = self._field(self.moments)
        self._loads: dict[int, tuple[Outline, Array, Array]] = {}

    @property
    def top(self) -> float:
        """Height of the face that is touched (m)."""
        return self.config.layer_thickness + self.config.sheet_thickness

    def rest(self) -> Array:
        """Readings at rest (T), shape (t, 3)."""
        return self._read(self.still)

    def stray(self, field: Array) -> Array:
        """What a uniform field (3,) (T) adds to the readings (t, 3)."""
        return self._read(np.broadcast_to(field, self.chips.shape))

    def stiffness(self, outline: Outline) -> float:
        """Force over depth (N / m) of a head."""
        return float(self._punch(outline)[1].sum())

    def terms(self, outline: Outline, pose: Array, deepest: float = 1e-3) -> Array:
        """Change of the readings under a head, by powers of its depth.

        Parameters
        ----------
        outline : Outline
            Of the head, flat inside it.
        pose : ndarray, shape (3,)
            Place of the outline's origin (m), and its turn (rad).
        deepest : float
            Depth up to which the sum holds (m).

        Returns
        -------
        ndarray, shape (3, t, 3)
            T / m, T / m2, T / m3.
        """
        moved, turned = self.punched.under(*self._punch(outline), pose)
        depths = deepest * POWERS / POWERS[-1]
        change = [self._carried(depth * moved, depth * turned) for depth in depths]
        flat = np.reshape(change, (len(depths), -1))
        found = np.linalg.solve(depths[:, None] ** POWERS, flat)
        return self._read(found.reshape(len(depths), *self.chips.shape))

    def press(self, outline: Outline, pose: Array, depths: Array) -> Array:
        """Readings (s, t, 3) (T) while a head stands at depths (s,) (m); see `terms`."""
        terms = self.terms(outline, pose, max(float(np.max(depths)), PITCH))
        powers = np.asarray(depths)[:, None] ** POWERS
        return np.asarray(self.rest() + np.tensordot(powers, terms, axes=1))

    def _punch(self, outline: Outline) -> tuple[Array, Array]:
        """Points and loads of a head, made once."""
        key = id(outline)
        if key not in self._loads:
            self._loads[key] = (outline, *self.punched.loads(outline))
        return self._loads[key][1:]

    def _carried(self, moved: Array, turned: Array) -> Array:
        """Change of the field (t, 3) where the body has carried the dipoles."""
        turned = self.flaws.turning * turned
        moments = self.moments + np.cross(turned, self.moments) if turned.any() else self.moments
        return dipole_field(self.chips, self.places + moved, moments) - self._unpressed

    def _field(self, moments: Array) -> Array:
        """Field (t, 3) of the carpet at rest."""
        return dipole_field(self.chips, self.places, moments)

    def _read(self, field: Array) -> Array:
        """What chips say of fields (..., t, 3)."""
        return np.asarray(np.einsum('tij,...tj->...ti', self.responses, field))

    def _layer(self) -> Layer:
        """Layer and sheet, one elastic body."""
        poisson = min(self.config.poisson_ratio, MOST)
        return Layer(self.top, self.config.youngs_modulus / (2 * (1 + poisson)), poisson)


def _responses(config: MultipoleSkinConfig, flaws: Flaws, rng: np.random.Generator) -> Array:
    """Field in sensor axes -> readings of chips that are tilted and of unlike gain (t, 3, 3)."""
    count = len(config.positions)
    tilted = Rotation.from_rotvec(flaws.tilt * rng.normal(size=(count, 3))).as_matrix()
    gain = 1 + flaws.gain * rng.normal(size=(count, 3, 1))
    axes = tilted if config.rotations is None else tilted @ config.rotations
    return np.asarray(gain * np.swapaxes(axes, 1, 2))


def _sheet(config: MultipoleSkinConfig, flaws: Flaws, rng: np.random.Generator) -> Sheet:
    """Sheet of bands of unlike strength that lie aside."""
    size = np.asarray(config.sheet_size, np.float64)
    bands = bands_of(size, config.pole_pitch, config.magnetisation)
    whole = config.remanence * (1 + flaws.remanence * rng.normal())
    strengths = whole * (1 + flaws.uneven * rng.normal(size=bands))
    return Sheet(
        size, config.layer_thickness, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, strengths, flaws.aside * rng.normal(),
    )  # fmt: skip


def snr(change: Array, noise: float) -> Array:
    """Signal over noise (dB), [1] Eq. (1).

    Parameters
    ----------
    change : ndarray, shape (...)
        Reading in contact less that without it (T).
    noise : float
        Standard deviation of a reading without load (T).

    Examples
    --------
    >>> snr(np.array([-4e-5]), 4e-6).round(9).tolist()
    [20.0]
    """
    return np.asarray(20 * np.log10(np.abs(change) / noise))
