"""The ensemble against one member at a time, and its slopes against differences."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.perceptron import Perceptron


def test_mean_of_members_written_out() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(80, 3)), rng.normal(size=(80, 2))
    net = Perceptron(members=3, width=5, epochs=5).fit(x, y)
    answers = []
    for m in range(3):
        hidden = np.tanh(x @ net.first_[m] + net.first_level_[m])
        deeper = np.tanh(hidden @ net.second_[m] + net.second_level_[m])
        answers.append(3 * deeper @ net.last_[m] + net.last_level_)
    assert np.allclose(net.predict(x), np.mean(answers, axis=0), rtol=0, atol=1e-12)


def test_slopes_are_those_of_the_mean_soft_length() -> None:
    rng = np.random.default_rng(1)
    net = Perceptron(members=1, width=4, softness=0.1)
    x, y = rng.normal(size=(1, 6, 3)), rng.normal(size=(1, 6, 2))
    trust = rng.uniform(0.5, 2, (1, 6, 1))
    layers = [rng.normal(size=(1, a, b)) for a, b in ((3, 4), (4, 4), (4, 2))]
    layers += [rng.normal(size=(1, 1, b)) for b in (4, 4, 2)]

    def loss() -> float:
        seen = x
        for k in range(3):
            seen = seen @ layers[k] + layers[3 + k]
            seen = np.tanh(seen) if k < 2 else seen
        size = np.sqrt(((seen - y) ** 2).sum(axis=-1) + 0.01)
        return float((trust[..., 0] * size).mean())

    slopes = [np.zeros_like(layer) for layer in layers]
    net._backward(x, y, trust, layers, slopes)
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


def test_faint_touches_weigh_less_and_no_touch_nothing() -> None:
    net = Perceptron(pattern=True)
    net.length_ = 1e-12
    trust = net._trust(np.array([0.0, 1e-4, 1e-3, 1e-2, 1e-1]))
    assert (np.diff(trust) > 0).all()
    assert trust[0] < 1e-9
    assert abs(trust.mean() - 1) < 1e-12
    assert abs(trust[3] / trust[2] - np.sqrt(2)) < 0.01


def test_sketch_has_fewer_members_and_leaves_its_model_alone() -> None:
    net = Perceptron(members=5, width=7, seed=3)
    sketch = net.sketch()
    assert (sketch.members, sketch.width, sketch.seed) == (3, 7, 3)
    assert net.members == 5
    assert Perceptron(members=1).sketch().members == 1
