# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Graphs of processes: one description for the launch files and `tactile`, without rclpy."""

from __future__ import annotations

import atexit
import json
import math
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path

from tactile_ros.hands import list_hands, load_hand
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types.config_fields import number, switch, text_of, whole

PACKAGE = 'tactile_ros'
PORT = '/dev/ttyACM0'
SIMULATED_PORT = 'board'
NAMESPACE = re.compile(r'/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*/?)?', re.ASCII)
MOST_CHARACTERS = 200

Value = bool | int | float | str | list[float] | list[str]
SOURCES = ('hardware', 'recorded', 'simulated')


@cache
def private_folder() -> Path:
    """Folder that only this user may enter, for this process; removed when it ends."""
    folder = tempfile.mkdtemp(prefix='tactile_')
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@dataclass(frozen=True)
class Process:
    """One executable of the package.

    `parameters` hold for every node of the process that has one of that name, and win over those
    of `params_file`.
    """

    executable: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    namespace: str = ''
    params_file: str = ''

    def __post_init__(self) -> None:
        if not NAMESPACE.fullmatch(self.namespace) or len(self.namespace) > MOST_CHARACTERS:
            msg = (
                f'namespace must be at most {MOST_CHARACTERS} letters, digits and _ parted by /, '
                f'no digit first; received {self.namespace[:60]!r}'
            )
            raise ValueError(msg)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of its nodes."""
        if self.executable != 'stack':
            return (self.executable,)
        grip = ('grip_node',) if self.parameters.get('hand') else ()
        return (*grip, 'contact_node', 'sensor_node')

    def ros_arguments(self) -> list[str]:
        """Command line after --ros-args."""
        space = self.namespace.strip('/')
        arguments = ['-r', f'__ns:=/{space}'] if space else []
        arguments += ['--params-file', self.params_file] if self.params_file else []
        for name, value in self.parameters.items():
            arguments += ['-p', f'{name}:={yaml_text(value)}']
        return arguments

    def command(self) -> list[str]:
        """Command line with this interpreter, which finds the package as it found this module."""
        run = [sys.executable, '-m', f'{PACKAGE}.nodes', self.executable]
        arguments = self.ros_arguments()
        return [*run, '--ros-args', *arguments] if arguments else run


@dataclass(frozen=True)
class Graph:
    """Processes in the order in which they start."""

    processes: tuple[Process, ...]

    def __getitem__(self, executable: str) -> Process:
        """Process of an executable; KeyError if it is not part."""
        return {process.executable: process for process in reversed(self.processes)}[executable]

    def name_of(self, process: Process) -> str:
        """Executable of a process, after its namespace where several run the same."""
        same = [other for other in self.processes if other.executable == process.executable]
        space = f'{process.namespace.strip("/")}/' if len(same) > 1 else ''
        return space + process.executable

    def with_parameters(self, node: str, values: Mapping[str, Value]) -> Graph:
        """The same graph with further parameters of one node; KeyError if none has that node."""
        home = next((p for p in self.processes if node in p.nodes), None)
        if home is None:
            raise KeyError(node)
        changed = replace(home, parameters={**home.parameters, **values})
        return Graph(tuple(changed if p is home else p for p in self.processes))


def list_names(text: str) -> list[str]:
    """Names in a text that are parted by commas."""
    return [name.strip() for name in text.split(',') if name.strip()]


@dataclass(frozen=True, kw_only=True)
class Everywhere:
    """Choices that hold for all processes of a graph; their defaults stay unsaid."""

    namespace: str = text_of(
        '', 'namespace of nodes, topics and services; below that of a hand lie its fingers'
    )
    params_file: str = text_of('', 'YAML file of parameters, as those in config; empty: none')
    use_sim_time: bool = switch(False, 'take time from /clock')
    autostart: bool = switch(True, 'configure and activate the nodes at start')
    respawn: bool = switch(True, 'start nodes of sensors again that end by themselves')

    def chosen(self, *names: str) -> dict[str, Value]:
        """Values that differ from the defaults; the rest is left to the parameter file."""
        return {n: getattr(self, n) for n in names if getattr(self, n) != getattr(type(self), n)}

    def placed(self, process: Process) -> Process:
        """A process with what holds for all."""
        values = {**self.chosen('use_sim_time', 'autostart'), **process.parameters}
        place = {'namespace': self.namespace, 'params_file': self.params_file}
        return replace(process, parameters=values, **place)


@dataclass(frozen=True, kw_only=True)
class EverySensor(Everywhere):
    """Choices that hold for every sensor of a graph."""

    sensor: str = text_of('reskin_board', 'key of the sensors', tuple(list_sensors()))
    source: str = text_of(
        'hardware',
        'where frames come from: sensors, recordings in place of boards, simulated twins',
        SOURCES,
    )
    stack: bool = switch(
        False, 'sensors and contacts, of a hand also its grip, in one process by direct calls'
    )
    seed: int = whole(
        0, 'of simulated twins: signal, noise and faults; counted up from finger to finger', low=0
    )
    frame_prefix: str = text_of(
        '', 'before the names of sensor frames in tf, as robot_state_publisher has it; empty: none'
    )


@dataclass(frozen=True)
class SensorSetup(EverySensor):
    """Graph of one sensor."""

    port: str = text_of(PORT, 'serial port; where no board is used, one in a private folder')
    recording: str = text_of(
        'spatial', 'recording to play: a name of a shipped one, or a file (.npz)'
    )
    calibration: str = text_of('', 'calibration file (.npz); empty: contacts say NOT_CALIBRATED')
    bag: str = text_of('', 'folder to record into; empty: nothing is recorded')
    tare: bool = switch(True, 'the player calls the tare before each touch')
    speed_up: float = number(
        1.0, 'recorded time over played time; inf: as fast as the graph goes', high=math.inf
    )
    loop: bool = switch(False, 'the player begins again at the end')
    fault: str = text_of('', 'that a simulated twin suffers at the start, as name or name:count')
    frame_id: str = text_of(
        '', 'name of the sensor frame in tf; empty: tactile_sensor, or after the namespace'
    )

    @property
    def place(self) -> str:
        """Path of the port: where a player's is not named, a private one for the namespace."""
        if self.source != 'recorded' or self.port != PORT:
            return self.port
        name = '_'.join([SIMULATED_PORT, *self.namespace.strip('/').split('/')]).rstrip('_')
        return str(private_folder() / name)


@dataclass(frozen=True)
class HandSetup(EverySensor):
    """Graph of a hand with sensors."""

    hand: str = text_of(
        'allegro_v5', f'one of {", ".join(list_hands())}, or a .yaml that describes a hand'
    )
    mock_hand: bool = switch(False, "a fake takes the place of the hand's driver")
    fingers: str = text_of('', 'sensors that take part, parted by commas; empty: all of the hand')
    ports: str = text_of(
        '', 'serial ports in the order of the fingers, with commas; empty: /dev/ttyACM0 and on'
    )
    calibrations: str = text_of('', 'folder with <finger>.npz; empty: contacts say NOT_CALIBRATED')
    use_robot_description: bool = switch(
        True, 'take limits, and pads whose frame is a link, from robot_description where it comes'
    )
    wait_for_robot_description: bool = switch(False, 'send nothing before it has come')

    def sensors(self) -> list[str]:
        """Names of the sensors that take part; ValueError if the hand carries no such one."""
        carried = [name for f in load_hand(self.hand).fingers.values() for name in f.sensors]
        wanted = list_names(self.fingers)
        if not set(wanted) <= set(carried):
            msg = f'fingers must be of {", ".join(carried)}; received {self.fingers!r}'
            raise ValueError(msg)
        return wanted or carried

    def finger_setups(self) -> list[SensorSetup]:
        """Graph of the sensor of each finger."""
        ports = list_names(self.ports)
        real = ports or (self.source == 'hardware' and not self.params_file)
        names = self.sensors()
        own = [*ports, *(PORT[:-1] + str(i) for i in range(len(ports), len(names)))]
        below, files = self.namespace.strip('/'), self.calibrations
        common = {f.name: getattr(self, f.name) for f in fields(EverySensor)}
        return [
            SensorSetup(
                **{**common, 'namespace': f'{below}/{name}'.lstrip('/'), 'seed': self.seed + i},
                port=own[i] if real else PORT,
                calibration=str(Path(files) / f'{name}.npz') if files else '',
            )
            for i, name in enumerate(names)
        ]


@dataclass(frozen=True)
class BagPlayback(Everywhere):
    """contact_node on the clock of a bag that `ros2 bag play` plays, in the bag's namespace."""

    bag: str = text_of('', 'folder of the bag')
    calibration: str = text_of('', 'calibration file (.npz); empty: contacts say NOT_CALIBRATED')
    sensor: str = text_of('reskin_board', 'key of the sensor', tuple(list_sensors()))
    rate: float = number(1.0, 'recorded time over played time')
    delay: float = number(
        3.0, 'time before the first message (s), in which player and node find each other'
    )
    use_sim_time: bool = field(default=True, init=False)
    respawn: bool = field(default=False, init=False)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics that are played: frames and layout; everything else is said anew."""
        space = f'/{self.namespace.strip("/")}'.rstrip('/')
        return f'{space}/frame', f'{space}/layout'

    def command(self) -> list[str]:
        """Command line of the player, which publishes /clock; ValueError where it cannot be."""
        if not self.bag:
            msg = 'bag must be the folder of a bag; received none'
            raise ValueError(msg)
        if not (self.rate > 0 and self.delay >= 0):
            msg = f'rate must be above 0 and delay 0 or more; received {self.rate}, {self.delay}'
            raise ValueError(msg)
        pace = ['--clock', '--rate', str(self.rate)]
        pace += ['--delay', str(self.delay)] if self.delay else []  # the player refuses 0
        pace += ['--wait-for-all-acked', '5000']  # ms: Fast DDS asks for it every 3 s
        return ['ros2', 'bag', 'play', self.bag, *pace, '--topics', *self.topics]


def frame_of(namespace: str, frame_id: str = '', frame_prefix: str = '') -> str:
    """Name in tf of the frame of a sensor: as stated, otherwise after its namespace.

    Examples
    --------
    >>> [frame_of(space) for space in ('/', '/thumb', '/left/thumb')]
    ['tactile_sensor', 'thumb_tactile_link', 'left/thumb_tactile_link']
    >>> frame_of('/left/thumb', 'tip'), frame_of('/left/thumb', frame_prefix='robot_')
    ('tip', 'robot_thumb_tactile_link')
    """
    hand, _, finger = namespace.strip('/').rpartition('/')
    prefix = frame_prefix or (f'{hand}/' if hand and not frame_id else '')
    return prefix + (frame_id or (f'{finger}_tactile_link' if finger else 'tactile_sensor'))


def yaml_text(value: Value) -> str:
    """A parameter's value as ROS reads it on a command line."""
    if isinstance(value, float) and not math.isfinite(value):
        return '.nan' if math.isnan(value) else ('.inf' if value > 0 else '-.inf')
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(yaml_text(x) for x in value) + ']'
    return json.dumps(value)


def sensing(setup: SensorSetup) -> Graph:
    """Sensor and contact, as two processes or as one; with player and recorder where asked.

    Whoever listens is there before the first frame: each waits for as many as hear it.
    """
    recorded = setup.source == 'recorded'
    if recorded and not load_sensor(setup.sensor).recordings():
        msg = f'source must be hardware or simulated; {setup.sensor} has no recordings to play'
        raise ValueError(msg)
    recorders = int(bool(setup.bag))
    contact = {**setup.chosen('sensor', 'calibration'), 'listeners': recorders + recorded}
    sensor = setup.chosen('sensor', 'frame_id', 'frame_prefix')
    sensor.update({'port': setup.place} if setup.place != PORT else {})
    sensor['listeners'] = recorders + recorded + int(not setup.stack)
    player: dict[str, Value] = {}
    if recorded:
        # A recording has one resting row before a touch, and a hand that is known to be open.
        contact.update(tare_frames=1, allow_tare_in_contact=True)
        sensor.update(temperature_measured=False, discard_stale=False)
        names = ('recording', 'tare', 'loop')
        player = {**setup.chosen('sensor'), **{name: getattr(setup, name) for name in names}}
        speed_up = float(setup.speed_up)
        player.update(port=setup.place, speed_up=speed_up, listeners=recorders)
    if setup.source == 'simulated':
        sensor.update(simulated=True, **setup.chosen('seed', 'fault'))
    processes = [Process('record', {'bag': setup.bag})] if setup.bag else []
    if setup.stack:
        processes.append(Process('stack', {**contact, **sensor}))
    else:
        processes += [Process('contact_node', contact), Process('sensor_node', sensor)]
    processes += [Process('player', player)] if recorded else []
    return Graph(tuple(setup.placed(process) for process in processes))


def replaying(playback: BagPlayback) -> Graph:
    """contact_node on simulated time; the player is no executable of this package."""
    values = {**playback.chosen('sensor', 'calibration'), 'use_sim_time': True}
    return Graph((playback.placed(Process('contact_node', values)),))


def has_port(sensor: str) -> bool:
    """Sensors on a serial port, whose twins may be in another process."""
    return 'serial' in load_sensor(sensor).transports[0]


def stack_of(setup: HandSetup) -> list[Process]:
    """For each finger the process that would run its sensor alone by direct calls."""
    return [sensing(finger)['stack'] for finger in replace(setup, stack=True).finger_setups()]


def grasping(setup: HandSetup) -> Graph:
    """The sensors of every finger, grip_node, and a fake hand where asked."""
    sensors, processes = setup.sensors(), []
    if setup.mock_hand:
        hand: dict[str, Value] = {'hand': setup.hand}
        if setup.source == 'simulated' and has_port(setup.sensor):
            places = [str(private_folder() / f'pressed_{name}') for name in sensors]
            hand.update(sensor=setup.sensor, fingers=sensors, ports=places, seed=setup.seed)
            setup = replace(setup, source='hardware', ports=','.join(places))
        processes.append(Process('mock_hand', hand))
    grip: dict[str, Value] = {'hand': setup.hand}
    if list_names(setup.fingers):
        grip['fingers'] = sensors
    grip.update(setup.chosen('use_robot_description', 'wait_for_robot_description'))
    fingers = setup.finger_setups()
    if setup.stack:
        grip.update(setup.chosen('sensor', 'source', 'calibrations', 'seed', 'frame_prefix'))
        ports = [finger.place for finger in fingers]
        if setup.source != 'simulated' and set(ports) != {PORT}:
            grip['ports'] = ports
    processes.append(Process('stack' if setup.stack else 'grip_node', grip))
    processes = [setup.placed(process) for process in processes]
    for finger in fingers:
        processes += [p for p in sensing(finger).processes if p.executable != 'stack']
    return Graph(tuple(processes))
