"""A multipole skin as it is: its sheet, its chips, and the body between them."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.press_templates import PressBank
from tactile_ros.physics.elastomer import Layer, PunchDents
from tactile_ros.physics.magnet_sheet import Sheet
from tactile_ros.types import Array, Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array, Integers

PRESS_MISSED = 0.015  # of what a chip sees of a press: what no parameter of a skin explains
DEPTH = 0.1  # of the body, from which the search for a depth starts


@dataclass(frozen=True)
class KnownPress:
    """A press of a known head at a known place."""

    outline: Outline  # of the head
    pose: Array  # (3,) place (m) and turn (rad)
    # (t 3,) and (3,) as in `PressVectors`
    pattern: Array
    powers: Array


class PressMisfit:
    """What models of one skin make of known presses.

    Parameters
    ----------
    noise : float
        Of a pattern (T).
    """

    def __init__(self, noise: float) -> None:
        self.noise = noise
        self._loads: dict[int, tuple[Array, Array]] = {}

    def dent(self, model: SkinModel, press: KnownPress) -> tuple[Array, Array]:
        """Movements and turns of the sheet and its body (g, 3) per depth."""
        key = id(press.outline)
        if key not in self._loads:
            self._loads[key] = model.dents.loads(press.outline)
        images = model.dents.images(*self._loads[key], press.pose)
        flat = model.dents.on_sheet(model.sheet, images).T
        turned = np.zeros((len(flat), 3))
        turned[:, :2] = flat[:, 3:]
        return flat[:, :3], turned

    def series(self, model: SkinModel, dent: tuple[Array, Array]) -> Array:
        """Changes of field by bands for powers 1 to 3 of the depth, shape (3, b, t, 3)."""
        depths = 0.2 * model.body * np.array([1 / 3, 2 / 3, 1.0])
        found = [
            model.sheet.band_changes(model.chips, a * dent[0], a * model.turning * dent[1])
            for a in depths
        ]
        inverse = np.linalg.inv(depths[:, None] ** np.arange(1, 4))
        return np.tensordot(inverse, np.stack(found), axes=1)

    def depth(self, model: SkinModel, press: KnownPress, series: Array) -> tuple[float, Array]:
        """Depth (m) and modelled pattern by bands (b, t, 3) of a press."""
        whole = np.tensordot(model.strengths, np.moveaxis(series, 1, 0), axes=1)
        read = np.einsum('tij,ptj->pti', model.responses, whole).reshape(3, -1)
        basis = np.linalg.qr(model.common)[0]
        read = read - (read @ basis) @ basis.T
        wanted = press.pattern - (press.pattern @ basis) @ basis.T
        a = DEPTH * model.body
        for _ in range(8):
            raised = press.powers * a ** np.arange(1, 4)
            slope = (press.powers * np.arange(1, 4) * a ** np.arange(3)) @ read
            step = slope @ (wanted - raised @ read) / (slope @ slope)
            a = float(np.clip(a + step, 0.3 * a, 3 * a))
            a = min(a, model.body)
        raised = press.powers * a ** np.arange(1, 4)
        return a, np.tensordot(raised, series, axes=1)

    def miss(self, model: SkinModel, press: KnownPress) -> tuple[Array, float, float]:
        """Misfit of a press (t 3,), weighted cost, and share that is missed."""
        series = self.series(model, self.dent(model, press))
        _, bands = self.depth(model, press, series)
        field = np.tensordot(model.strengths, bands, axes=1)
        miss = press.pattern - np.einsum('tij,tj->ti', model.responses, field).ravel()
        basis = np.linalg.qr(model.common)[0]
        own = miss - basis @ (basis.T @ miss)
        sigma = self.sigma(press)
        size = np.square(sigma) - self.noise**2
        share = float(np.sqrt(max(np.square(own).mean() - self.noise**2, 0.0) / size.mean()))
        return miss, float(np.square(own / sigma).sum()), PRESS_MISSED * share

    def sigma(self, press: KnownPress) -> Array:
        """Deviation of a press's pattern."""
        chips = press.pattern.reshape(-1, 3)
        here = np.square(chips).mean(axis=1)
        share = PRESS_MISSED**2 * (here + 0.05 * here.max())
        return np.repeat(np.sqrt(self.noise**2 + share), 3)

    def made(self, model: SkinModel, outline: Outline, pose: Array) -> KnownPress:
        """A press of usual depth (m) as a model has it."""
        one = KnownPress(outline, pose, np.zeros(model.chips.size), np.ones(3))
        raised = (DEPTH * model.body) ** np.arange(1, 4)
        bands = np.tensordot(raised, self.series(model, self.dent(model, one)), axes=1)
        field = np.tensordot(model.strengths, bands, axes=1)
        return replace(one, pattern=np.einsum('tij,tj->ti', model.responses, field).ravel())


USUAL = {
    'place': 0.2e-3,  # m, of a chip
    'tilt': 0.03,  # rad
    'gain': 0.04,
    'band': 0.07,  # of remanence, band by band
    'common': 0.4,  # of remanence, all bands
    'shift': 0.4e-3,  # m, of all bands
    'gap': 0.2e-3,  # m, of all chips
    'stray': 5e-5,  # T, field of the Earth and offsets
    'turning': 0.3,  # share of the body's turns that magnets follow
}
MANY = ('place', 'tilt', 'gain', 'band')  # kinds that tell how far they usually are
TURNING = 0.0, 0.5, 1.0  # shares from which that of presses is sought
WORKSHOP = 10.0  # members, as which what is usual counts then
MISSED = 4e-3  # of the resting field: what no parameter explains
STEP, TURN = 2e-5, 0.05  # m and share, over which fields are differentiated
ROUNDS = 4
EXPLAINED = 0.85  # of the resting field, below which the drawing is of another skin


class SheetCalibration:
    """Parameters of one skin, from its drawing on.

    Parameters
    ----------
    drawn : SkinModel
        From the config.
    noise : float
        Of a resting reading that many frames gave (T).

    Attributes
    ----------
    found : SkinModel
        With the parameters of the last fit.
    turning_told : bool
        Whether presses have told how far magnets turn with the body.
    """

    def __init__(self, drawn: SkinModel, noise: float) -> None:
        self.drawn, self.noise = drawn, noise
        t, b = len(drawn.chips), len(drawn.strengths)
        sizes = [
            ('place', 3 * t), ('tilt', 3 * t), ('gain', 3 * t), ('band', b), ('common', 1),
            ('shift', 1), ('gap', 1), ('stray', 3), ('turning', 1),
        ]  # fmt: skip
        ends = np.cumsum([0] + [n for _, n in sizes])
        self.parts = {name: slice(ends[i], ends[i + 1]) for i, (name, _) in enumerate(sizes)}
        self.usual = np.concatenate([np.full(n, USUAL[name]) for name, n in sizes])
        self.prior = self.usual.copy()
        self.theta = np.zeros(len(self.prior))
        self.found = drawn
        self._before = self.theta
        self._system: tuple[Array, Array, list[tuple[Array, Array]]]
        self.press = PressMisfit(noise)
        self.turning_told = False

    def fit_rest(self, rest: Array) -> bool:
        """Fit resting readings (t, 3); False and nothing found if they are of another skin."""
        self._iterate(rest, [])
        missed = self._readings(self.found, rest)
        explained = 1 - float(np.square(missed).sum() / np.square(rest).sum())
        usual = self.theta / self.usual
        if explained < EXPLAINED or np.abs(usual).max() > 6:
            self.theta, self.found = np.zeros(len(self.prior)), self.drawn
            return False
        return True

    def fit_presses(self, rest: Array | None, presses: Sequence[KnownPress]) -> None:
        """Fit known presses together with resting readings (t, 3), or without."""
        costs = {}
        for turning in TURNING:
            self.found = replace(self.found, turning=turning)
            some = presses[:: len(presses) // 12 + 1]
            costs[turning] = sum(self.press.miss(self.found, one)[1] for one in some)
        best = min(costs, key=lambda turning: costs[turning])
        self.drawn = replace(self.drawn, turning=best)
        self.found = replace(self.found, turning=best)
        self._iterate(rest, presses, rounds=2)
        self.turning_told = True

    def left_out(self, presses: Sequence[KnownPress], fold: Integers) -> tuple[Array, Array]:
        """What fitted presses are like to skins that were fitted without them.

        Parameters
        ----------
        presses : sequence of KnownPress
            Those of the last `fit_presses` (n).
        fold : ndarray, shape (n,)
            Presses of one fold are left out together: the last round is made again without.

        Returns
        -------
        patterns : ndarray, shape (n, d)
            Presses that differ from templates of this skin by what theirs differ by from those of
            the other one (T).
        missed : ndarray, shape (n,)
            Share of each that the other skin does not explain, as a chip sees it.
        """
        patterns, missed = np.empty((len(presses), self.found.chips.size)), np.empty(len(presses))
        found = self.found
        own = [self.press.miss(self.found, one)[0] for one in presses]
        *system, parts = self._system
        for one in np.unique(fold):
            rows = np.flatnonzero(fold == one).tolist()
            left = (whole - sum(parts[i][k] for i in rows) for k, whole in enumerate(system))
            self.found = self._model(self._before + _solved(*left))
            for i in rows:
                miss, _, missed[i] = self.press.miss(self.found, presses[i])
                patterns[i] = presses[i].pattern + miss - own[i]
        self.found = found
        return patterns, missed

    def _iterate(
        self, rest: Array | None, presses: Sequence[KnownPress], rounds: int = ROUNDS
    ) -> None:
        """Gauss-Newton with the prior."""
        for _ in range(rounds):
            normal = np.diag(1 / self.prior**2)
            gradient = -self.theta / self.prior**2
            known = [] if rest is None else [_normal(*self._rest_block(rest))]
            parts = [_normal(*self._press_block(one)) for one in presses]
            for more, pull in known + parts:
                normal += more
                gradient += pull
            self._before, self._system = self.theta, (normal, gradient, parts)
            self.theta = self.theta + _solved(normal, gradient)
            self.found = self._model(self.theta)
            self._scale_priors(np.diag(self._covariance()))

    def _covariance(self) -> Array:
        """Of the parameters, as the last round knew them."""
        normal = self._system[0]
        scale = np.sqrt(np.diag(normal))
        return np.asarray(np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale))

    def _scale_priors(self, variance: Array) -> None:
        """Let kinds of parameters (p,) with many members tell how far these usually are.

        One step of expectation and maximisation; what workshops usually do counts as some members.
        """
        for name in MANY:
            part, usual = self.parts[name], USUAL[name] ** 2
            square = (np.square(self.theta[part]) + variance[part]).sum()
            found = (square + WORKSHOP * usual) / (part.stop - part.start + WORKSHOP)
            self.prior[part] = np.sqrt(found)

    def expected(self, presses: Sequence[KnownPress]) -> float:
        """Usual share of presses that errors of the parameters leave unexplained.

        As if it were known how far magnets turn, of which a rest tells nothing.
        """
        covariance, shares = self._covariance(), []
        covariance[self.parts['turning']] = 0.0
        for press in presses:
            slopes, sigma = self._press_block(press)[1], self.press.sigma(press)
            variance = np.einsum('pd,pq,qd->d', slopes, covariance, slopes) * np.square(sigma)
            size = (np.square(sigma) - self.noise**2).mean() / PRESS_MISSED**2
            shares.append(variance.mean() / size)
        return float(np.sqrt(np.median(shares) + PRESS_MISSED**2))

    def _model(self, theta: Array) -> SkinModel:
        """Skin with some parameters."""
        drawn, parts = self.drawn, self.parts
        chips = drawn.chips + theta[parts['place']].reshape(-1, 3)
        chips[:, 2] += theta[parts['gap']]
        tilt = theta[parts['tilt']].reshape(-1, 3)
        turned = np.eye(3) + np.cross(tilt[:, None], np.eye(3)[None])
        gain = 1 + theta[parts['gain']].reshape(-1, 3, 1)
        strengths = drawn.strengths * (1 + theta[parts['band']]) * (1 + theta[parts['common']])
        return replace(
            drawn, chips=chips, strengths=strengths,
            responses=gain * np.matmul(drawn.responses, turned),
            shift=float(drawn.shift + theta[parts['shift']][0]),
            turning=float(np.clip(drawn.turning + theta[parts['turning']][0], 0.0, 1.0)),
        )  # fmt: skip

    def _readings(self, model: SkinModel, rest: Array) -> Array:
        """What resting readings differ by from a model's, with the stray field of now."""
        stray = self.theta[self.parts['stray']]
        return np.asarray(rest - model.rest() - np.einsum('tij,j->ti', model.responses, stray))

    def _rest_block(self, rest: Array) -> tuple[Array, Array, Array]:
        """Misfit (t 3,), its slopes (parameters, t 3) and deviation at rest."""
        model = self.found
        bands = model.sheet.band_fields(model.chips)
        field = np.tensordot(model.strengths, bands, axes=1)
        stray = self.theta[self.parts['stray']]
        along = [
            (model.sheet.field(model.chips + STEP * e) - model.sheet.field(model.chips)) / STEP
            for e in np.eye(3)
        ]
        moved = replace(model, shift=model.shift + STEP)
        shift = (moved.sheet.field(model.chips) - field) / STEP
        slopes = self._slopes(model, field + stray, bands, along, shift)
        slopes[self.parts['stray']] = model.responses.reshape(-1, 3).T
        size = np.linalg.norm(field, axis=1).max()
        sigma = np.hypot(self.noise, MISSED * size)
        return self._readings(model, rest).ravel(), slopes, np.full(rest.size, sigma)

    def _slopes(
        self, model: SkinModel, field: Array, bands: Array, along: list[Array], shift: Array
    ) -> Array:
        """Slopes (parameters, t 3) of readings of a field (t, 3) with known derivatives."""
        t = len(model.chips)
        slopes = np.zeros((len(self.prior), t, 3))
        read = model.responses
        chip = np.arange(t)
        for i, unit in enumerate(np.eye(3)):
            place = np.einsum('tij,tj->ti', read, along[i])
            slopes[self.parts['place']].reshape(t, 3, t, 3)[chip, i, chip] = place
            tilt = np.einsum('tij,tj->ti', read, np.cross(field, unit))
            slopes[self.parts['tilt']].reshape(t, 3, t, 3)[chip, i, chip] = tilt
            one = np.einsum('tj,tj->t', read[:, i], field)
            slopes[self.parts['gain']].reshape(t, 3, t, 3)[chip, i, chip, i] = one
            if i == 2:
                slopes[self.parts['gap']] = place
        each = np.einsum('tij,btj->bti', read, bands * model.strengths[:, None, None])
        slopes[self.parts['band']] = each
        slopes[self.parts['common']] = each.sum(axis=0)
        slopes[self.parts['shift']] = np.einsum('tij,tj->ti', read, shift)
        return slopes.reshape(len(self.prior), -1)

    def _press_block(self, press: KnownPress) -> tuple[Array, Array, Array]:
        """Misfit, slopes and deviation of a press; depth and uniform field are free."""
        model, own = self.found, self.press
        dent = own.dent(model, press)
        depth, bands = own.depth(model, press, own.series(model, dent))
        field = np.tensordot(model.strengths, bands, axes=1)

        def change(sheet_model: SkinModel, chips: Array) -> Array:
            turned = depth * sheet_model.turning * dent[1]
            found = sheet_model.sheet.band_changes(chips, depth * dent[0], turned)
            return np.asarray(np.tensordot(model.strengths, found, axes=1))

        now = change(model, model.chips)
        along = [(change(model, model.chips + STEP * e) - now) / STEP for e in np.eye(3)]
        shift = (change(replace(model, shift=model.shift + STEP), model.chips) - now) / STEP
        slopes = self._slopes(model, field, bands, along, shift)
        more = change(replace(model, turning=model.turning + TURN), model.chips) - now
        turning = np.einsum('tij,tj->ti', model.responses, more / TURN)
        slopes[self.parts['turning']] = turning.ravel()
        read = np.einsum('tij,tj->ti', model.responses, field).ravel()
        sigma = own.sigma(press)
        # depth and a uniform field are not known: what they do is taken out
        free = np.column_stack([read, model.common]) / sigma[:, None]
        basis = np.linalg.qr(free)[0]
        miss = (press.pattern - read) / sigma
        slopes = slopes / sigma
        slopes = slopes - (slopes @ basis) @ basis.T
        return miss - basis @ (basis.T @ miss), slopes, np.ones(len(sigma))


def _normal(miss: Array, slopes: Array, sigma: Array) -> tuple[Array, Array]:
    """What misfits (d,) with slopes (parameters, d) and deviations add to normal equations."""
    j = slopes / sigma
    return j @ j.T, j @ (miss / sigma)


def _solved(normal: Array, gradient: Array) -> Array:
    """Solution of normal equations whose parameters have unlike units."""
    scale = np.sqrt(np.diag(normal))
    return np.asarray(np.linalg.solve(normal / np.outer(scale, scale), gradient / scale) / scale)


MOST_KEPT = 2  # banks, which cost seconds each and tens of megabytes
_KEPT: dict[bytes, PressBank] = {}
_KEPT_LOCK = threading.Lock()  # a class is learned beside the stream


@dataclass(frozen=True)
class SkinModel:
    """Everything that the answer of a multipole skin to a flat head depends on."""

    size: Array  # (2,) of the sheet (m)
    # soft layer under the sheet, and the sheet (m); the base is at z = 0
    layer: float
    thickness: float
    # width of a band (m); 'M1' to 'M4'
    pole_pitch: float
    magnetisation: str
    # of the body (Pa, 1)
    youngs: float
    poisson: float
    strengths: Array  # (b,) remanence of the bands (T)
    shift: float  # of the bands along y (m)
    chips: Array  # (t, 3) hall elements (m)
    responses: Array  # (t, 3, 3) field in sensor axes -> reading
    turning: float  # share of the body's turns that the magnets follow

    @property
    def body(self) -> float:
        """Height of layer and sheet (m)."""
        return self.layer + self.thickness

    @cached_property
    def sheet(self) -> Sheet:
        """The sheet at rest."""
        return Sheet(
            self.size, self.layer, self.thickness, self.pole_pitch, self.magnetisation,
            self.strengths, self.shift,
        )  # fmt: skip

    @cached_property
    def dents(self) -> PunchDents:
        """Of the body."""
        shear_modulus = self.youngs / (2 * (1 + self.poisson))
        return PunchDents(self.sheet, 0.0, Layer(self.body, shear_modulus, self.poisson))

    @property
    def common(self) -> Array:
        """What a uniform field does to all readings, shape (t 3, 3)."""
        return self.responses.reshape(-1, 3)

    def rest(self) -> Array:
        """Readings at rest (T), shape (t, 3)."""
        return np.asarray(np.einsum('tij,tj->ti', self.responses, self.sheet.field(self.chips)))

    def bank(self, outlines: tuple[Outline, ...]) -> PressBank:
        """Templates of heads; the last ones made are kept."""
        key = self._key(outlines)
        with _KEPT_LOCK:
            if key not in _KEPT:
                made = PressBank(
                    self.sheet, self.dents, self.chips, self.responses, self.turning, outlines
                )
                while len(_KEPT) >= MOST_KEPT:
                    _KEPT.pop(next(iter(_KEPT)))
                _KEPT[key] = made
            return _KEPT[key]

    def _key(self, outlines: tuple[Outline, ...]) -> bytes:
        """What a bank is made from."""
        numbers = [
            self.size, self.strengths, self.chips, self.responses,
            np.array([
                self.layer, self.thickness, self.pole_pitch, self.youngs, self.poisson,
                self.shift, self.turning,
            ]),
            *(np.asarray(loop) for outline in outlines for loop in outline.loops),
        ]  # fmt: skip
        loops = repr([len(outline.loops) for outline in outlines]).encode()
        whole = b'|'.join(np.ascontiguousarray(n, np.float64).tobytes() for n in numbers)
        return self.magnetisation.encode() + loops + whole


def bands_of(size: Array, pole_pitch: float, magnetisation: str) -> int:
    """How many bands a sheet has."""
    if magnetisation == 'M4':
        return int(np.ceil(float(size[1]) / pole_pitch - 1e-9)) + 1
    return 2 if magnetisation == 'M3' else 1
