# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The one registry: a folder that has a SENSOR is a sensor named like it.

It lies beside this file, or in a folder that TACTILE_SENSORS names.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType

from tactile_ros.calibration import digest, flatten
from tactile_ros.devices.connections import SerialConnection
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.enrolment import Signal, playing
from tactile_ros.errors import CalibrationError, TactileError
from tactile_ros.pipeline import Pipeline
from tactile_ros.types.contracts import Device, Estimation, Twin
from tactile_ros.types.frame import Layout, SensorConfig
from tactile_ros.types.recording import Recording

ALIASES = {'anyskin': 'reskin_board', 'eflesh': 'reskin_board', 'reskin': 'reskin_board'}


@dataclass(frozen=True)
class EnrolmentScene:
    """A scene of a twin with something in it that its calibration does not know."""

    label: str  # name of the new class; in truth its number follows those of `config.objects`
    presses: int  # from which it is learned
    calibration: Callable[..., Recording]  # with truth, for a config and a seed
    scene: Callable[..., Recording]  # with truth, for a config, a seed and the noise of a channel


@dataclass(frozen=True)
class SensorSpec:
    """Everything that belongs to one kind of sensor."""

    key: str  # name of its folder
    paper: str  # where it was published
    summary: str  # what it is, in a line
    transports: tuple[str, ...]  # how it can be connected, in words
    # frozen dataclasses with all defaults: geometry and materials; port and protocol
    config: Callable[..., SensorConfig]
    connection: Callable[..., SerialConnection]
    layout: Callable[..., Layout]  # of a config
    estimation: Callable[..., Estimation]  # of a config, and the name of an estimator or None
    estimator_names: tuple[str, ...]  # what that name may be
    noise: float  # of a reading of a twin (unit of the layout) where the config says none
    presses: Callable[..., Recording]  # of a simple programme, with truth, for a config and a seed
    classes: tuple[type, ...]  # what a calibration file of this sensor may hold
    # of a real one, carried by the package
    recordings: Callable[[], Mapping[str, Recording]] = dict
    # chip temperatures of `presses` for a config: time (s) -> (t,) (degrees Celsius)
    temperature: Callable[..., Signal] | None = None
    # fields with which `tactile demo` runs its twin, such as ROS parameters can hold
    demo: Mapping[str, object] = field(default_factory=dict)
    new_class: EnrolmentScene | None = None  # what its twin can play instead of `presses`

    def __repr__(self) -> str:
        """Key, summary and estimators in a line."""
        names = ', '.join(self.estimator_names)
        return f'{type(self).__name__}({self.key}: {self.summary}; estimators: {names})'

    def open(
        self, config: SensorConfig, connection: SerialConnection, clock_ns: Callable[[], int]
    ) -> Device:
        """Driver of `config` at `connection`, with stamps from `clock_ns`; not entered yet."""
        return connection.open(self.layout(config), clock_ns)

    def simulate(
        self, config: SensorConfig, connection: SerialConnection,
        signal: Signal | None = None, seed: int = 0,
        clock: VirtualClock | None = None,
    ) -> Twin:  # fmt: skip
        """Twin that plays a signal; not entered yet.

        `signal` is a function of time (s) that returns values (t, c) in the sensor's unit; None:
        that of `presses` with the same seed, without its noise. `clock` None: the machine's.
        """
        temperature_c = None
        if signal is None:
            signal = playing(self.presses(config, seed, noise=0.0))
            temperature_c = None if self.temperature is None else self.temperature(config)
        noise = self.noise if config.noise is None else config.noise
        return connection.simulate(self.layout(config), signal, noise, seed, clock, temperature_c)

    def pipeline(
        self, config: SensorConfig | None = None, estimator: str | None = None
    ) -> Pipeline:
        """Pipeline to be fitted, or run on its nominal model where there is one.

        The default config is that of the board as sold; `estimator` is one of `estimator_names`,
        else ValueError; default: chosen in `fit`.
        """
        if estimator is not None and estimator not in self.estimator_names:
            msg = (
                f'estimator of {self.key} must be one of {", ".join(self.estimator_names)}; '
                f'received {estimator!r}'
            )
            raise ValueError(msg)
        config = self.config() if config is None else config
        return Pipeline(self.key, config, self.layout(config), self.estimation(config, estimator))

    def design(self) -> ModuleType:
        """Module that trades geometry and materials; ValueError if the sensor has none.

        It has `add_arguments(parser)`, and `tables(config, options)`, a list of `types.Table`.
        """
        if self.key not in designable():
            keys = ', '.join(designable())
            msg = f'sensor must be one that can be designed ({keys}); received {self.key!r}'
            raise ValueError(msg)
        return importlib.import_module(f'tactile_ros.sensors.{self.key}.design')

    def load(self, path: str | Path) -> Pipeline:
        """Pipeline from a calibration file of this sensor; CalibrationError if it is none."""
        pipeline = Pipeline.load(path, self.key, {c.__name__: c for c in self.classes})
        found, own = flatten(pipeline.layout, ''), flatten(self.layout(pipeline.config), '')
        if digest(found) != digest(own):
            msg = f'calibration {path} has another layout than its config; calibrate again'
            raise CalibrationError(msg)
        return pipeline


def fit_layout(config: SensorConfig, layout: Layout) -> SensorConfig:
    """Config for a recording with another number of taxels: the recording's positions count."""
    if len(config.positions) == len(layout.positions):
        return config
    return replace(config, positions=layout.positions)  # type: ignore[type-var]


def _with_file(name: str) -> list[str]:
    """Names of the folders of sensors that hold a file."""
    folders = importlib.import_module('tactile_ros.sensors').__path__
    return sorted({path.parent.name for f in folders for path in Path(f).glob(f'*/{name}')})


def list_sensors() -> list[str]:
    """Keys of all sensors, in alphabetical order."""
    return _with_file('__init__.py')


def designable() -> list[str]:
    """Keys of the sensors that have a `tactile design`, in alphabetical order."""
    return [key for key in _with_file('design.py') if key in list_sensors()]


def load_sensor(key: str) -> SensorSpec:
    """Sensor of a key; ValueError: there is none, TactileError: it cannot be loaded."""
    key = ALIASES.get(str(key), key)
    if key not in list_sensors():
        close = get_close_matches(str(key), [*list_sensors(), *ALIASES], 1)
        meant = f'; did you mean {close[0]}?' if close else ''
        msg = f'sensor must be one of {", ".join(list_sensors())}; received {key!r}{meant}'
        raise ValueError(msg)
    try:
        spec = getattr(importlib.import_module(f'tactile_ros.sensors.{key}'), 'SENSOR', None)
    except (Exception, SystemExit) as err:  # a file of the user's may do anything
        msg = f'sensor {key} cannot be loaded ({type(err).__name__}: {err})'
        raise TactileError(msg) from err
    if not isinstance(spec, SensorSpec):
        msg = f'sensors/{key}/__init__.py must define SENSOR, a SensorSpec'
        raise TactileError(msg)
    return spec
