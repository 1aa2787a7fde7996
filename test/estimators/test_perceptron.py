"""The ensemble against one member at a time, and its slopes against differences."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.perceptron import Perceptron


def test_mean_of_members_written_out() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(80, 3)), rng.normal(size=(80, 2))
    net = Perceptron(members=3, width=5, epochs=5).fit(x, y)
    z = net.inputs_(x)
    answers = []
    for m in range(3):
        part = slice(5 * m, 5 * m + 5)
        hidden = np.tanh(z @ net.first_[:, part] + net.first_level_[part])
        deeper = np.tanh(hidden @ net.second_[m] + net.second_level_[m])
        answers.append(deeper @ (3 * net.last_[part]))
    expected = net.targets_.inverse(np.mean(answers, axis=0) + net.last_level_)
    assert np.allclose(net.predict(x), expected, rtol=0, atol=1e-12)


def test_slopes_are_those_of_the_mean_soft_length() -> None:
    rng = np.random.default_rng(1)
    net = Perceptron(members=1, width=4, softness=0.1)
    x, y = rng.normal(size=(1, 6, 3)), rng.normal(size=(1, 6, 2))
    layers = [rng.normal(size=(1, a, b)) for a, b in ((3, 4), (4, 4), (4, 2))]
    layers += [rng.normal(size=(1, 1, b)) for b in (4, 4, 2)]

    def loss() -> float:
        seen = x
        for k in range(3):
            seen = seen @ layers[k] + layers[3 + k]
            seen = np.tanh(seen) if k < 2 else seen
        return float(np.sqrt(((seen - y) ** 2).sum(axis=-1) + 0.01).mean())

    slopes = [np.zeros_like(layer) for layer in layers]
    net._backward(x, y, layers, slopes)
    for layer, slope in zip(layers, slopes, strict=True):
        for index in np.ndindex(layer.shape):
            kept = layer[index]
            layer[index] = kept + 1e-5
            above = loss()
            layer[index] = kept - 1e-5
            below = loss()
            layer[index] = kept
            assert abs((above - below) / 2e-5 - slope[index]) < 1e-6


def test_pattern_sees_direction_and_length() -> None:
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(600, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    depth = rng.uniform(0.5, 5.0, (600, 1))
    x, y = 1e-4 * depth * direction, direction[:, :2]
    errors = {}
    for pattern in (False, True):
        net = Perceptron(members=2, width=16, epochs=60, pattern=pattern).fit(x[:400], y[:400])
        errors[pattern] = np.linalg.norm(net.predict(x[400:]) - y[400:], axis=1).mean()
    assert errors[True] < 0.5 * errors[False]
