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

from tactile_ros.hands import load_hand
from tactile_ros.sensors import load_sensor

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


@dataclass(frozen=True)
class Grasping:
    """What a user chooses about a hand with sensors.

    Attributes
    ----------
    hand : str
        Name of a hand in config/hands, or a .yaml that describes one.
    mock_hand : bool
        A fake takes the place of the hand's driver.
    fingers : str
        Sensors that take part, parted by commas; empty: all that the hand carries.
    sensor, source : str
        Key of the sensors, and where their frames come from, as in `Setting`.
    ports : str
        Serial ports in the order of the fingers, parted by commas; empty: /dev/ttyACM0 and on.
    calibrations : str
        Folder with a file <finger>.npz for each; empty: not calibrated.
    stack : bool
        Sensors, contacts and grip in one process by direct calls.
    use_robot_description : bool
        Limits and pads come from the topic `robot_description`, where there is one.
    wait_for_robot_description : bool
        Nothing is sent before it has come.
    """

    hand: str = 'allegro_v5'
    mock_hand: bool = False
    fingers: str = ''
    sensor: str = 'reskin_board'
    source: Source = 'hardware'
    ports: str = ''
    calibrations: str = ''
    stack: bool = False
    use_robot_description: bool = True
    wait_for_robot_description: bool = False
    seed: int = 0
    namespace: str = ''
    params_file: str = ''
    use_sim_time: bool = False
    autostart: bool = True

    def finger(self, index: int, name: str) -> Setting:
        """What holds for the sensor of one finger."""
        ports = [port.strip() for port in self.ports.split(',') if port.strip()]
        own = ports[index] if index < len(ports) else PORT[:-1] + str(index)
        real = ports or (self.source == 'hardware' and not self.params_file)
        file = Path(self.calibrations) / f'{name}.npz' if self.calibrations else ''
        return Setting(
            sensor=self.sensor,
            source=self.source,
            port=own if real else PORT,
            calibration=str(file),
            stack=self.stack,
            seed=self.seed + index,
            frame_id=f'{name}_tactile_link',
            namespace='/'.join(filter(None, (self.namespace.strip('/'), name))),
            params_file=self.params_file,
            use_sim_time=self.use_sim_time,
            autostart=self.autostart,
        )


def has_port(sensor: str) -> bool:
    """Whether a sensor is on a serial port, so that its twin may be in another process."""
    return 'serial' in load_sensor(sensor).transports[0]


def sensors_of(choice: Grasping) -> list[str]:
    """Names of the sensors that take part.

    Raises
    ------
    ValueError
        If there is no such hand, or it carries no such sensor.
    """
    hand = load_hand(choice.hand)
    carried = [name for finger in hand.fingers.values() for name in finger.sensors]
    wanted = [name.strip() for name in choice.fingers.split(',') if name.strip()]
    if not set(wanted) <= set(carried):
        msg = f'fingers must be of {", ".join(carried)}; received {choice.fingers!r}'
        raise ValueError(msg)
    return wanted or carried


def stack_of(choice: Grasping) -> list[Process]:
    """For each finger the process that would run its sensor alone by direct calls."""
    settings = [replace(choice, stack=True).finger(i, n) for i, n in enumerate(sensors_of(choice))]
    return [sensing(setting)['stack'] for setting in settings]


def grasping(choice: Grasping) -> Graph:
    """The sensors of every finger, grip_node, and a fake hand where asked.

    Raises
    ------
    ValueError
        If there is no such hand, or it carries no such sensor.
    """
    sensors = sensors_of(choice)
    hand: dict[str, Value] = {'hand': choice.hand}
    if choice.mock_hand and choice.source == 'simulated' and has_port(choice.sensor):
        places = [str(private_folder() / f'pressed_{name}') for name in sensors]
        hand.update(sensor=choice.sensor, fingers=sensors, ports=places, seed=choice.seed)
        choice = replace(choice, source='hardware', ports=','.join(places))
    settings = [choice.finger(i, name) for i, name in enumerate(sensors)]
    grip: dict[str, Value] = {'hand': choice.hand}
    if choice.fingers.strip(', '):
        grip['fingers'] = sensors
    for name in ('use_robot_description', 'wait_for_robot_description'):
        if getattr(choice, name) != getattr(Grasping, name):
            grip[name] = getattr(choice, name)
    own = [Process('mock_hand', hand)] if choice.mock_hand else []
    if choice.stack:
        own.append(Process('stack', {**grip, **_of_a_stack(choice, settings)}))
    else:
        own.append(Process('grip_node', grip))
    everywhere = Setting(
        namespace=choice.namespace,
        params_file=choice.params_file,
        use_sim_time=choice.use_sim_time,
        autostart=choice.autostart,
    )
    reading = [
        process
        for setting in settings
        for process in sensing(setting).processes
        if process.executable != 'stack'
    ]
    return Graph((*(placed(process, everywhere) for process in own), *reading))


def _of_a_stack(choice: Grasping, settings: list[Setting]) -> dict[str, Value]:
    """Parameters of a stack: what differs from its defaults."""
    defaults = Grasping()
    values: dict[str, Value] = {
        name: getattr(choice, name)
        for name in ('sensor', 'source', 'calibrations', 'seed')
        if getattr(choice, name) != getattr(defaults, name)
    }
    places = [setting.place for setting in settings]
    if choice.source != 'simulated' and set(places) != {PORT}:
        values['ports'] = places
    return values


@dataclass(frozen=True)
class Playing:
    """What a user chooses about a bag that is played.

    Attributes
    ----------
    bag : str
        Folder of the bag.
    calibration, sensor, namespace, params_file, autostart
        As in `Setting`; the namespace is that of the sensor in the bag.
    rate : float
        Recorded time over played time.
    delay : float
        Time before the first message (s), in which player and node find each other.
    """

    bag: str = ''
    calibration: str = ''
    sensor: str = 'reskin_board'
    namespace: str = ''
    rate: float = 1.0
    delay: float = 3.0
    params_file: str = ''
    autostart: bool = True

    @property
    def topics(self) -> tuple[str, ...]:
        """What is played: frames and layout; everything else is said anew."""
        space = self.namespace.strip('/')
        return tuple(f'/{space}/{leaf}'.replace('//', '/') for leaf in ('frame', 'layout'))

    def command(self) -> list[str]:
        """Command line of the player, which publishes /clock.

        Raises
        ------
        ValueError
            If no bag is named, the rate is not above 0 or the delay is below.
        """
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


def replaying(choice: Playing) -> Graph:
    """contact_node on simulated time; the player is no executable of this package."""
    setting = Setting(
        sensor=choice.sensor,
        calibration=choice.calibration,
        namespace=choice.namespace,
        params_file=choice.params_file,
        use_sim_time=True,
        autostart=choice.autostart,
    )
    contact = Process('contact_node', setting.chosen('sensor', 'calibration'))
    return Graph((placed(contact, setting),))
