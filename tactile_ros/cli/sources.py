"""What commands read: recordings by path or by shipped name, configs from yaml."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import LoadedRecording, load

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.sensors import SensorSpec
    from tactile_ros.types import Layout, SensorConfig

MOST_YAML_BYTES = 1_000_000


def find(
    name: str, spec: SensorSpec, layout: Layout | None, truth: Sequence[str] = ()
) -> tuple[list[LoadedRecording], list[str]]:
    """Recordings under a path, or the shipped one of that name, and what could not be read.

    Raises
    ------
    RecordingError
        If there is neither.
    """
    shipped = spec.recordings()
    if name in shipped and not Path(name).exists():
        return [LoadedRecording(name, shipped[name])], []
    if not Path(name).exists():
        msg = f'{name} does not exist, and {spec.key} ships only {", ".join(shipped) or "none"}'
        raise RecordingError(msg)
    found = load(name, layout, truth) if truth else load(name, layout)
    return list(found.recordings), found.sentences


def read_config(spec: SensorSpec, path: Path | None) -> SensorConfig:
    """Config of a sensor with the fields that a yaml file changes.

    Raises
    ------
    ValueError
        If the file is missing, too large, no mapping, or names a field that the config does not
        have or a value that it cannot have.
    """
    config = spec.config()
    if path is None:
        return config
    import yaml

    if not path.is_file():
        msg = f'config {path} must be a yaml file; there is none'
        raise ValueError(msg)
    if path.stat().st_size > MOST_YAML_BYTES:
        msg = (
            f'config {path} must be at most {MOST_YAML_BYTES} bytes; it has {path.stat().st_size}'
        )
        raise ValueError(msg)
    try:
        given = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        msg = f'config {path} is no plain yaml: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error
    known = {f.name for f in fields(config)}  # type: ignore[arg-type]
    if not isinstance(given, dict) or not set(given) <= known:
        stray = sorted(map(str, set(given) - known)) if isinstance(given, dict) else given
        msg = f'config {path} must map {", ".join(sorted(known))}; received {stray}'
        raise ValueError(msg)
    try:
        values = {name: _value(told, getattr(config, name)) for name, told in given.items()}
        return replace(config, **values)  # type: ignore[type-var]
    except (TypeError, ValueError) as error:
        msg = f'config {path}: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error


def _value(told: object, default: object) -> object:
    """A value of yaml as the config takes it: lists are arrays, and 4e4 is a number."""
    if isinstance(told, list):
        return np.asarray(told, float)
    if isinstance(told, str) and isinstance(default, float):  # yaml wants 4.0e+4
        with suppress(ValueError):
            return float(told)
    return told


def fit_layout(config: SensorConfig, layout: Layout) -> SensorConfig:
    """Config for a recording with another number of taxels: the recording's positions count."""
    if len(config.positions) == len(layout.positions):
        return config
    return replace(config, positions=layout.positions)  # type: ignore[type-var]
