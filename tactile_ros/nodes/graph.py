"""What runs: one description for the launch files, for `tactile demo` and for the tests.

Plain data, no rclpy. `processes` starts a graph where there is no `ros2 launch`.
"""

from __future__ import annotations

import atexit
import json
import math
import shutil
import sys
import tempfile
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

PACKAGE = 'tactile_ros'

PORT = '/dev/ttyACM0'
SIMULATED_PORT = 'board'

Value = bool | int | float | str | list[float] | list[str]
Source = Literal['hardware', 'recorded', 'simulated']


@cache
def private_folder() -> Path:
    """Folder that only this user may enter, for this process; removed when it ends."""
    folder = tempfile.mkdtemp(prefix='tactile_')
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@dataclass(frozen=True)
class Process:
    """One executable of the package.

    Attributes
    ----------
    executable : str
        In lib/tactile_ros, and the module of the same name in tactile_ros/nodes.
    parameters : dict
        Of every node of the process that has a parameter of that name.
    namespace : str
        Of its nodes; empty: none.
    remappings : dict
        Topic or service names, from -> to.
    params_file : str
        YAML file of parameters; what `parameters` says wins.
    """

    executable: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    namespace: str = ''
    remappings: Mapping[str, str] = field(default_factory=dict)
    params_file: str = ''

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
        found = ['-r', f'__ns:=/{space}'] if space else []
        for old, new in self.remappings.items():
            found += ['-r', f'{old}:={new}']
        if self.params_file:
            found += ['--params-file', self.params_file]
        for name, value in self.parameters.items():
            found += ['-p', f'{name}:={yaml_text(value)}']
        return found

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
        for process in self.processes:
            if process.executable == executable:
                return process
        raise KeyError(executable)

    def name_of(self, process: Process) -> str:
        """Executable of a process, after its namespace where several run the same."""
        same = [other for other in self.processes if other.executable == process.executable]
        space = process.namespace.strip('/')
        return process.executable if len(same) < 2 else f'{space}/{process.executable}'

    def with_parameters(self, node: str, values: Mapping[str, Value]) -> Graph:
        """The same graph with further parameters of one node, wherever it runs.

        Raises
        ------
        KeyError
            If no process has that node.
        """
        home = next((p for p in self.processes if node in p.nodes), None)
        if home is None:
            raise KeyError(node)
        changed = replace(home, parameters={**home.parameters, **values})
        return Graph(tuple(changed if p is home else p for p in self.processes))


@dataclass(frozen=True)
class Setting:
    """What a user chooses about a graph.

    Attributes
    ----------
    sensor : str
        Key of the sensor.
    source : str
        'hardware': the sensor itself; 'recorded': a player of `recording` takes the place of its
        board; 'simulated': a twin answers its bytes and says the truth.
    port : str
        Serial port, where the sensor has one; of a player: where the simulated port appears.
    recording : str
        Name of a shipped recording, or a file (.npz).
    calibration : str
        File (.npz); empty: not calibrated.
    bag : str
        Folder to record into; empty: nothing is recorded.
    stack : bool
        Sensor and contact in one process by direct calls.
    tare : bool
        The player calls the tare before each touch.
    speed_up : float
        Recorded over played time; inf: as fast as the graph goes.
    loop : bool
        The player begins again at the end.
    seed : int
        Of a twin.
    fault : str
        That a twin suffers at the start, `name` or `name:count`; empty: none.
    """

    sensor: str = 'reskin_board'
    source: Source = 'hardware'
    port: str = PORT
    recording: str = 'spatial'
    calibration: str = ''
    bag: str = ''
    stack: bool = False
    tare: bool = True
    speed_up: float = 1.0
    loop: bool = False
    seed: int = 0
    fault: str = ''
    frame_id: str = 'tactile_sensor'
    namespace: str = ''
    params_file: str = ''
    use_sim_time: bool = False
    autostart: bool = True

    @property
    def place(self) -> str:
        """Path of the port: where a player's is not named, a private one for the namespace."""
        if self.source != 'recorded' or self.port != PORT:
            return self.port
        name = '_'.join([SIMULATED_PORT, *self.namespace.strip('/').split('/')]).rstrip('_')
        return str(private_folder() / name)

    def chosen(self, *names: str) -> dict[str, Value]:
        """What differs from the defaults; the rest is left to the parameter file."""
        asked = {name: getattr(self, name) for name in names}
        return {name: v for name, v in asked.items() if v != getattr(type(self), name)}


def yaml_text(value: Value) -> str:
    """A parameter's value as ROS reads it on a command line.

    Examples
    --------
    >>> [yaml_text(x) for x in (True, 3, 2.0, 'a b', [1.0, 2.5])]
    ['true', '3', '2.0', '"a b"', '[1.0, 2.5]']
    >>> yaml_text(float('inf'))
    '.inf'
    """
    if isinstance(value, float) and not math.isfinite(value):
        return '.nan' if math.isnan(value) else ('.inf' if value > 0 else '-.inf')
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(yaml_text(x) for x in value) + ']'
    return json.dumps(value)


def sensing(setting: Setting) -> Graph:
    """Sensor and contact, as two processes or as one; with player and recorder where asked.

    Whoever listens is there before the first frame: the recorder starts first, contact_node waits
    for those who hear it, sensor_node for those who hear it, and the player for all of them.
    """
    recorded = setting.source == 'recorded'
    hearing = int(bool(setting.bag)) + int(recorded)
    contact: dict[str, Value] = {
        **setting.chosen('sensor', 'calibration'),
        'listeners': hearing,
    }
    sensor: dict[str, Value] = {
        **setting.chosen('sensor', 'frame_id'),
        **({'port': setting.place} if setting.place != PORT else {}),
        'listeners': hearing + int(not setting.stack),
    }
    if recorded:
        # A recording has one resting row before a touch, and a hand that is known to be open.
        contact.update(tare_frames=1, allow_tare_in_contact=True)
        sensor.update(temperature_measured=False, discard_stale=False)
    if setting.source == 'simulated':
        sensor.update(simulated=True, **setting.chosen('seed', 'fault'))
    processes = [Process('record', {'bag': setting.bag})] if setting.bag else []
    if setting.stack:
        processes.append(Process('stack', {**contact, **sensor}))
    else:
        processes += [Process('contact_node', contact), Process('sensor_node', sensor)]
    if recorded:
        processes.append(_player(setting))
    return Graph(tuple(placed(process, setting) for process in processes))


def placed(process: Process, setting: Setting) -> Process:
    """A process with what holds for all."""
    return replace(
        process,
        parameters={**setting.chosen('use_sim_time', 'autostart'), **process.parameters},
        namespace=setting.namespace,
        params_file=setting.params_file,
    )


def _player(setting: Setting) -> Process:
    """The recording in the place of the board."""
    values: dict[str, Value] = {
        **setting.chosen('sensor'),
        'recording': setting.recording,
        'port': setting.place,
        'speed_up': float(setting.speed_up),
        'tare': setting.tare,
        'loop': setting.loop,
        'listeners': int(bool(setting.bag)),
    }
    return Process('player', values)
