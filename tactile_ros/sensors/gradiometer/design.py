# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Trade gap, magnet and averaging for range, noise and immunity to stray fields: [3], table I.

The disc moves linearly with force: full scale sinks it by 0.6 of the gap, the elastomer's other
dimensions and hardness stay. Noise is the bound of Cramer and Rao with the disc's place and a
uniform field unknown, so that a calibration can come close to it and not below.

example:
  tactile design gradiometer --force 3.5 --resolution 0.5
  tactile design gradiometer --stray 5 --spread 1 --json
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from tactile_ros.sensors.gradiometer import disc_model
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.gradiometer.estimation import NOISE
from tactile_ros.types import Array, Table

SINKS, SHEAR = 0.6, 0.2  # of the gap at full scale; stiffness aside over that in depth
ABOVE = 0.5e-3  # m, of elastomer over the disc
SAMPLE_MS = 0.22  # time constant of one sample [3]
GAPS = (1.5e-3, 2.0e-3, 2.5e-3, 3.0e-3, 4.0e-3)
DISCS = ((1.5e-3, 0.8e-3), (2e-3, 1e-3), (3e-3, 1e-3), (3e-3, 2e-3))
AVERAGES = (1, 4, 16, 64)
MILLI = 1e3


@dataclass(frozen=True)
class Figures:
    """Figures of merit of a design."""

    full_n: float  # force that sinks the disc by 0.6 of the gap (N)
    # noise of one sample along z at rest and at half load, and along x at rest (mN)
    rest_mn: float
    load_mn: float
    side_mn: float
    leak_percent: float  # worst force from the stray field, at rest (% of full scale)
    strongest_mt: float  # uniform field along z that clips no pixel up to full scale; < 0: clips


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile design gradiometer`."""
    parser.add_argument('--force', type=float, help='largest force (N); full scale of the config')
    parser.add_argument('--resolution', type=float, default=2.7, help='noise wanted (mN)')
    parser.add_argument('--stray', type=float, default=2.0, help='uniform field to bear (mT)')
    parser.add_argument('--spread', type=float, default=0.5, help='gains unknown by (%%)')


def tables(config: GradiometerConfig, options: argparse.Namespace) -> list[Table]:
    """Figures of the config, its trades, and a search."""
    force = config.full_scale if options.force is None else options.force
    if min(force, options.resolution, options.stray, options.spread) <= 0:
        msg = 'force, resolution, stray and spread of design must be positive'
        raise ValueError(msg)
    stray = options.stray, options.spread

    def of(gap: float, disc: tuple[float, float]) -> Figures:
        return figures(config, gap, disc, stray)

    own = (config.disc_diameter, config.disc_height)
    gaps = sorted({*GAPS, config.gap})
    discs = sorted({*DISCS, own})
    return [
        Table('gap', _columns('gap (mm)'), tuple(_row(f'{MILLI * g:g}', of(g, own)) for g in gaps),
              ('A smaller gap gives more signal and less range.',)),
        Table('magnet', _columns('disc (mm)'),
              tuple(_row(_name(d), of(config.gap, d)) for d in discs),
              (f'Remanence {config.remanence:g} T; noise goes with its inverse.',)),
        _averaging(of(config.gap, own)),
        _search({(g, d): of(g, d) for g, d in product(gaps, discs)}, force, options),
    ]  # fmt: skip


def _columns(first: str) -> tuple[str, ...]:
    return (
        first, 'full scale (N)', 'Fz noise (mN)', 'at half load (mN)', 'Fx noise (mN)',
        'leak (% of full scale)', 'field to clipping (mT)',
    )  # fmt: skip


def _row(name: str, found: Figures) -> tuple[str | float, ...]:
    return (
        name, found.full_n, found.rest_mn, found.load_mn, found.side_mn, found.leak_percent,
        found.strongest_mt,
    )  # fmt: skip


def _name(disc: tuple[float, float]) -> str:
    return f'{MILLI * disc[0]:g} x {MILLI * disc[1]:g}'


def _averaging(found: Figures) -> Table:
    """Noise against time constant."""
    rows = tuple((n, SAMPLE_MS * n, found.rest_mn / np.sqrt(n)) for n in AVERAGES)
    note = f'One sample has a time constant of {SAMPLE_MS} ms; [3] averages four: 2.7 mN.'
    return Table('averaging', ('samples', 'time constant (ms)', 'Fz noise (mN)'), rows, (note,))


def _search(
    found: dict[tuple[float, tuple[float, float]], Figures], force: float,
    options: argparse.Namespace,
) -> Table:  # fmt: skip
    """Designs that do what is wanted, the fastest first."""
    rows = []
    for (gap, disc), design in found.items():
        samples = max(1, int(np.ceil((design.rest_mn / options.resolution) ** 2)))
        if design.full_n >= force and design.strongest_mt >= options.stray:
            noise, delay = design.rest_mn / np.sqrt(samples), SAMPLE_MS * samples
            rows.append((MILLI * gap, _name(disc), samples, delay, noise, design.leak_percent))
    rows.sort(key=lambda row: (row[3], row[5], row[4]))
    wanted = f'{force:g} N, {options.resolution:g} mN and {options.stray:g} mT'
    none = f'Nothing here bears {wanted}: a harder elastomer, or a wider range of the pixels.'
    columns = (
        'gap (mm)', 'disc (mm)', 'samples', 'time constant (ms)', 'Fz noise (mN)',
        'leak (% of full scale)',
    )  # fmt: skip
    notes = (f'Designs that bear {wanted}.',) if rows else (none,)
    return Table('search', columns, tuple(rows[:6]) or ((None,) * len(columns),), notes)


def figures(
    config: GradiometerConfig, gap: float, disc: tuple[float, float], stray: tuple[float, float]
) -> Figures:
    """Figures of a gap (m) and a disc (m, m) for a stray field (mT) and a spread of gains (%)."""
    changed = replace(config, gap=gap, disc_diameter=disc[0], disc_height=disc[1])
    model = disc_model.disc_prior(
        changed, [], np.zeros(0), disc_model.MM, float('nan'), tared=False
    )
    usual, own = (c.gap + c.disc_height + ABOVE for c in (config, changed))
    deep = config.full_scale / (SINKS * config.gap) * usual / own  # N / m
    stiffness = deep * np.array([SHEAR, SHEAR, 1.0])
    states = np.zeros((3, disc_model.STATES))
    states[:, 2] = np.array([0.0, -SINKS / 2, -SINKS]) * gap / disc_model.MM
    field, slopes = disc_model.readings_of(model, model.parameters, states)
    measured = np.abs(disc_model.chip_axes(config)[:, :, [0, 2]]).max(axis=(0, 2)) > 0
    differences = disc_model.difference_basis(slopes[0], measured)
    noise = NOISE if config.noise is None else float(np.max(config.noise))
    # slopes are in mT / mm, which is T / m
    unit = np.array([_unit(slope[:, :3], differences) for slope in slopes]) * stiffness
    spoilt = 1e-3 * stray[0] * 1e-2 * stray[1] * unit[0].max()
    full = float(deep * SINKS * gap)
    limit = np.inf if config.saturation is None else float(np.max(config.saturation))
    rest, load = (MILLI * noise * unit[k] for k in (0, 1))
    clear = MILLI * limit - float(np.abs(field).max())
    return Figures(full, rest[2], load[2], rest[0], 100 * float(spoilt) / full, clear)


def _unit(slope: Array, differences: Array) -> Array:
    """Least deviations of a place (3,) (m) for readings with one of 1 T, of slopes (n, 3)."""
    seen = differences.T @ slope
    return np.asarray(np.sqrt(np.diag(np.linalg.pinv(seen.T @ seen))))
