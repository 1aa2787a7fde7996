"""What runs on a hand: the graph of its sensors, the grip, and a fake hand where asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tactile_ros.hands import load_hand
from tactile_ros.nodes.graph import (
    PORT,
    Graph,
    Process,
    Setting,
    Source,
    Value,
    placed,
    private_folder,
    sensing,
)
from tactile_ros.nodes.pressed_twins import has_port


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
