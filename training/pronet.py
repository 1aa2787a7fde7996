# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Train the networks of [1] (Table I) with the prototype loss, and write them as ONNX.

Pronet learns by eq. (4), Pronet-L by eq. (6). Presses come from a skin of the multipole world; of
25 places five are held out, and the five new heads are in no training. Two things are added to
[1], without which it is trained, too: windows enter with a size of one, since a deep press is no
other shape, and each task is mirrored at random as the sheet may be. Run from the sources, with
the packages of the extra `train`; it takes both at once, and seven minutes of two cores:

    python training/pronet.py --seed 1
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.types import Array

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT), str(ROOT / 'test')]
SHIPPED = ROOT / 'tactile_ros' / 'sensors' / 'multipole_skin'
UNIT = 1e-4  # T, of what enters the first layer
FAINT = 2e-6  # T, below which a window is not brought to a size of one
# Table II has one task a step at a rate of 1e-4 for 100 epochs, which takes seven times as long
RATE, TASKS, TOGETHER, BATCH = 1e-3, 100, 4, 32
APART = 0.1  # alpha of eq. (6)
TINY = 1e-12  # under roots: the slope of a root is infinite where two prototypes coincide
TESTED = 300  # tasks
CNN_EPOCHS = 10


class Size(nn.Module):
    """Windows over their root mean square."""

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """Windows (n, 1, 60, 10) of about one."""
        square = windows.square().mean(dim=(1, 2, 3), keepdim=True)
        return windows / (square + (FAINT / UNIT) ** 2).sqrt()


def network(printed: bool = False) -> nn.Sequential:
    """Table I: windows (n, 1, 60, 10) -> features (n, 320); of one size, unless as printed."""
    return nn.Sequential(
        nn.Identity() if printed else Size(),
        nn.Conv2d(1, 16, 2, stride=2, padding=1), nn.BatchNorm2d(16), nn.ReLU(),
        nn.MaxPool2d((2, 1)),
        nn.Conv2d(16, 32, 2, stride=2, padding=1), nn.ReLU(), nn.MaxPool2d((2, 1)),
        nn.Conv2d(32, 64, 2, stride=(2, 1), padding=1), nn.ReLU(), nn.MaxPool2d((2, 1)),
        nn.Flatten(),
    )  # fmt: skip


def tensor(windows: Array) -> torch.Tensor:
    """Windows (n, w, d) (T) as the network takes them."""
    return torch.from_numpy(np.ascontiguousarray(np.swapaxes(windows, 1, 2)[:, None]) / UNIT)


def mirrors(positions: Array) -> list[tuple[Array, Array]]:
    """Order and signs (60,) of readings under heads that are mirrored in x, turned by pi, or both.

    An M4 sheet of an even number of bands is the same then, and so are the places of the chips; a
    field is a pseudovector.
    """
    found = []
    for x, y, signs in ((1, 1, (1, 1, 1)), (-1, 1, (-1, 1, 1)), (-1, -1, (-1, -1, 1)),
                        (1, -1, (1, -1, 1))):  # fmt: skip
        away = np.linalg.norm(positions[:, None] * [x, y, 1] - positions, axis=2)
        order = 3 * away.argmin(axis=1)[:, None] + np.arange(3)
        found.append((order.ravel(), np.tile(np.float32(signs), len(positions))))
    return found


def loss_of(
    known: torch.Tensor, asked: torch.Tensor, ways: int, shots: int, apart: float
) -> torch.Tensor:
    """Loss of eq. (6) with -d in eq. (3), the mean of tasks (b, rows, p) ordered by class."""
    means = known.reshape(len(known), ways, shots, -1).mean(dim=2)
    away = (asked[:, :, None] - means[:, None]).square().sum(dim=3)
    label = torch.arange(ways).repeat_interleave(asked.shape[1] // ways).repeat(len(asked))
    first = nn.functional.cross_entropy(-away.flatten(0, 1), label)
    if apart == 0:
        return first
    pairs = (means[:, :, None] - means[:, None]).square().sum(dim=3)
    pairs = pairs[:, ~torch.eye(ways, dtype=torch.bool)]
    return first + apart * (1 / (1 + (pairs + TINY).sqrt())).sum(dim=1).mean()


def trained(
    trials: ModuleType, samples: object, shots: int, ways: int, apart: float, epochs: int,
    seed: int, printed: bool = False,
) -> nn.Sequential:  # fmt: skip
    """Network after some epochs of tasks; with what is added to [1], unless as printed."""
    torch.manual_seed(seed)
    rng = np.random.default_rng([31, seed])
    net, windows = network(printed), samples.windows  # type: ignore[attr-defined]
    steps = epochs * TASKS // TOGETHER
    optimizer = torch.optim.Adam(net.parameters(), lr=RATE)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    same = mirrors(trials.world.SENSOR.config().positions)[: 1 if printed else None]
    net.train()
    for _ in range(steps):
        known, asked = [], []
        for _ in range(TOGETHER):
            order, signs = same[rng.integers(len(same))]
            for rows, some in zip(trials.task(samples, shots, ways, rng), (known, asked),
                                  strict=True):  # fmt: skip
                some.append(windows[rows][:, :, order] * signs)
        # one after the other, so that no query is in the statistics of the supports
        first, second = (
            net(tensor(np.concatenate(some))).reshape(TOGETHER, -1, 320) for some in (known, asked)
        )
        loss = loss_of(first, second, ways, shots, apart)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        slower.step()
    return net.eval()


def classified(known: object, asked: list[object], epochs: int, seed: int) -> list[float]:
    """Shares of presses that the same network with a layer of classes names rightly."""
    torch.manual_seed(seed)
    classes, label = np.unique(known.label, return_inverse=True)  # type: ignore[attr-defined]
    net = nn.Sequential(*network(printed=True), nn.Linear(320, len(classes)))
    windows, wanted = tensor(known.windows), torch.from_numpy(label)  # type: ignore[attr-defined]
    optimizer = torch.optim.Adam(net.parameters(), lr=RATE)
    rng = np.random.default_rng([37, seed])
    net.train()
    for _ in range(epochs):
        for rows in np.array_split(rng.permutation(len(label)), len(label) // BATCH):
            loss = nn.functional.cross_entropy(net(windows[rows]), wanted[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    net.eval()
    found = [classes[features(net, one).argmax(axis=1)] for one in asked]
    return [float((f == one.label).mean()) for f, one in zip(found, asked, strict=True)]  # type: ignore[attr-defined]


def features(net: nn.Sequential, samples: object) -> Array:
    """Features (n, p) of windows."""
    with torch.no_grad():
        return np.asarray(net(tensor(samples.windows)).numpy(), float)  # type: ignore[attr-defined]


def write(net: nn.Sequential, path: Path, told: dict[str, str]) -> None:
    """Write a network as ONNX; its batch norm is part of the first layer then."""
    convolutions = [layer for layer in net if isinstance(layer, nn.Conv2d)]
    norm = next(layer for layer in net if isinstance(layer, nn.BatchNorm2d))
    gain = (norm.weight / (norm.running_var + norm.eps).sqrt()).detach()
    nodes, weights, last = _sized()
    for i, layer in enumerate(convolutions):
        weight, bias = layer.weight.detach(), layer.bias.detach()
        if i == 0:
            weight = weight * gain[:, None, None, None]
            bias = (bias - norm.running_mean) * gain + norm.bias.detach()
        weights += [
            numpy_helper.from_array(weight.numpy().astype(np.float32), f'weight_{i}'),
            numpy_helper.from_array(bias.numpy().astype(np.float32), f'bias_{i}'),
        ]
        nodes += [
            helper.make_node('Conv', [last, f'weight_{i}', f'bias_{i}'], [f'conv_{i}'],
                             kernel_shape=[2, 2], strides=list(layer.stride), pads=[1, 1, 1, 1]),
            helper.make_node('Relu', [f'conv_{i}'], [f'relu_{i}']),
            helper.make_node('MaxPool', [f'relu_{i}'], [f'pool_{i}'], kernel_shape=[2, 1],
                             strides=[2, 1]),
        ]  # fmt: skip
        last = f'pool_{i}'
    nodes.append(helper.make_node('Flatten', [last], ['features']))
    one = TensorProto.FLOAT
    graph = helper.make_graph(
        nodes, path.stem, [helper.make_tensor_value_info('windows', one, ['n', 1, 60, 10])],
        [helper.make_tensor_value_info('features', one, ['n', 320])], weights,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid('', 13)])
    model.ir_version = 8
    helper.set_model_props(model, told)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def _sized() -> tuple[list[object], list[object], str]:
    """Nodes and weights of `Size` for windows (T), and the name of what they give."""
    weights = [
        numpy_helper.from_array(np.float32(value).reshape(1), name)
        for name, value in (('one', 1 / UNIT), ('faint', (FAINT / UNIT) ** 2))
    ]
    nodes = [
        helper.make_node('Mul', ['windows', 'one'], ['scaled']),
        helper.make_node('Mul', ['scaled', 'scaled'], ['squares']),
        helper.make_node('ReduceMean', ['squares'], ['square'], axes=[1, 2, 3], keepdims=1),
        helper.make_node('Add', ['square', 'faint'], ['whole']),
        helper.make_node('Sqrt', ['whole'], ['size']),
        helper.make_node('Div', ['scaled', 'size'], ['sized']),
    ]
    return nodes, weights, 'sized'


def shapes(trials: ModuleType, skin: object, options: argparse.Namespace) -> None:
    """Table III, and the new heads; Pronet-L of one shot is written."""
    world = trials.world
    places = world.stations()
    learn, held = trials.split_places(options.seed)
    whole = trials.collection(skin, world.nine_heads(), places, options.seed)
    new = trials.collection(skin, world.new_heads(), places, options.seed + 1, trials.TAKEN)
    known = whole.rows(np.flatnonzero(np.isin(whole.place, learn)))
    asked = whole.rows(np.flatnonzero(np.isin(whole.place, held)))
    say('presses of shapes are collected')
    for name, apart, printed in (
        ('Pronet-L as printed', APART, True), ('Pronet', 0.0, False), ('Pronet-L', APART, False)
    ):  # fmt: skip
        for shots in trials.SHOTS:
            net = trained(
                trials, known, shots, trials.WAYS, apart, options.epochs, options.seed, printed
            )
            right = [
                trials.few_shot(features(net, one), one, shots, trials.WAYS, TESTED, options.seed)
                for one in (asked, new)
            ]
            say(f'{name} ({shots}-shot): held-out places, new heads', *right)
            if name == 'Pronet-L' and shots == 1:
                write(net, SHIPPED / 'pronet_shapes.onnx', told(options, learn))
    for shots in trials.SHOTS:
        right = [
            trials.few_shot(trials.plain(one), one, shots, trials.WAYS, TESTED, options.seed)
            for one in (asked, new)
        ]
        say(f'plain windows ({shots}-shot)', *right)
    say('nearest neighbours at held-out places', trials.neighbours(known, asked, trials.plain))
    say('CNN at held-out places', *classified(known, [asked], CNN_EPOCHS, options.seed))


def postures(trials: ModuleType, skin: object, options: argparse.Namespace) -> None:
    """Table V and figure 9: two bars teach, the third is asked; then at random places."""
    world = trials.world
    rng = np.random.default_rng([41, options.seed])
    somewhere = rng.uniform(-trials.SPAN, trials.SPAN, (6, 2))
    heads, turns = world.bars(), trials.POSTURES
    whole = trials.collection(skin, heads, world.stations(), options.seed, trials.TAKEN, turns)
    there = trials.collection(skin, heads, somewhere, options.seed + 1, trials.TAKEN, turns)
    say('presses of postures are collected')
    for third in (2, 1, 0):
        known = whole.rows(np.flatnonzero(whole.source != third))
        asked = [one.rows(np.flatnonzero(one.source == third)) for one in (whole, there)]
        for name, apart in (('Pronet', 0.0), ('Pronet-L', APART)):
            for shots in trials.SHOTS:
                net = trained(trials, known, shots, 6, apart, options.epochs // 4, options.seed)
                right = [
                    trials.few_shot(features(net, one), one, shots, 6, TESTED, options.seed)
                    for one in asked
                ]
                say(f'bar {third + 1}, {name} ({shots}-shot): 25 places, random places', *right)
                if name == 'Pronet-L' and shots == max(trials.SHOTS) and third == len(heads) - 1:
                    write(net, SHIPPED / 'pronet_postures.onnx', told(options, np.arange(25)))
        near = [trials.neighbours(known, one, trials.plain) for one in asked]
        say(f'bar {third + 1}, nearest neighbours', *near)
        cnn = classified(known, asked, CNN_EPOCHS, options.seed)
        say(f'bar {third + 1}, CNN', *cnn)


def told(options: argparse.Namespace, places: Array) -> dict[str, str]:
    """What a file says of its making."""
    return {
        'made by': f'training/pronet.py --seed {options.seed} --epochs {options.epochs}',
        'places learned from': ' '.join(str(place) for place in places),
    }


def say(what: str, *shares: float) -> None:
    """Print a line with shares in percent."""
    line = '  '.join(f'{100 * share:.1f} %' for share in shares)
    sys.stdout.write(f'{time.process_time():6.0f} s  {what}  {line}\n')
    sys.stdout.flush()


def side_by_side() -> int:
    """Both networks at once, each in a process of one thread; 1 if either fails."""
    command = [sys.executable, *sys.argv, '--what']
    parts = [subprocess.Popen([*command, what]) for what in ('shapes', 'postures')]
    return int(any([part.wait() for part in parts]))


def main() -> None:
    """Train, print the tables, write the networks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--epochs', type=int, default=60)
    parser.add_argument('--what', choices=('shapes', 'postures', 'both'), default='both')
    options = parser.parse_args()
    if options.what == 'both':
        sys.exit(side_by_side())
    torch.set_num_threads(1)
    from benchmarks.worlds import multipole_trials as trials

    skin = trials.world.World(trials.SKIN)
    train = shapes if options.what == 'shapes' else postures
    train(trials, skin, options)


if __name__ == '__main__':
    main()
