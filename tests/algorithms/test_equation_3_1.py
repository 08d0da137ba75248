"""The corrected loss is that of equation 3.1 of the thesis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th

from tests.algorithms.pairs import METHODS, SAID, Pair
from tests.algorithms.specs import CONTINUOUS, DISCRETE

SAID_DISCRETE = np.array([0.1, 0.2, 0.7])
RETURNS = np.array([2.0, -1.0, 0.5, 3.0])


def gaussian(actions: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Densities of vectors, (B,)."""
    return np.exp(-0.5 * (((actions - mean) / deviation) ** 2).sum(-1)) / np.prod(deviation * np.sqrt(2 * np.pi))


def equation(name: str, actions: np.ndarray, own: np.ndarray) -> np.ndarray:
    """What the learning rule sees of the actions, (B,), written as in the thesis. `own`: (B, A) probabilities or means."""
    if own.shape[1] == 3:
        product, together = own * SAID_DISCRETE, own + SAID_DISCRETE
        reused = 0.7 * SAID_DISCRETE + 0.3 * own
        mean = own**0.7 * SAID_DISCRETE**0.3
        mixed = {"intersection": product, "geometric": mean, "union": together, "reuse": reused}[name]
        return (mixed / mixed.sum(-1, keepdims=True))[np.arange(4), actions]
    mean, spread, deviation = SAID[:2], SAID[2:], np.ones(2)
    if name == "intersection":
        return gaussian(actions, (own + mean) / 2, deviation)
    if name == "geometric":
        return gaussian(actions, 0.7 * own + 0.3 * mean, deviation)
    if name == "reuse":
        return 0.7 * gaussian(actions, mean, spread) + 0.3 * gaussian(actions, own, deviation)
    # The product of two Gaussians is their product over its integral, which is the density of the means' distance.
    integral = [gaussian(mean, one, np.sqrt(spread**2 + deviation**2)) for one in own]
    return gaussian(actions, own, deviation) * gaussian(actions, mean, spread) / np.array(integral)


@pytest.mark.parametrize(
    ("actions", "name"),
    [(DISCRETE, name) for name in ("intersection", "geometric", "union", "reuse")]
    + [(CONTINUOUS, name) for name in ("intersection", "geometric", "sampling", "reuse")],
)
def test_the_gradient_of_the_corrected_loss_is_that_of_equation_3_1(actions: Any, name: str) -> None:
    """-sum_t R_t log pi(a_t|s_t), by finite differences of the equation in the biases of the last layer."""
    pair = Pair("vector", actions, {}, True, "PPO", **METHODS[name])
    policy, batch = pair.advised, pair.with_advice((SAID_DISCRETE if actions == DISCRETE else SAID).astype(np.float32))
    with th.no_grad():
        if actions == CONTINUOUS:
            policy.log_std.zero_()
        raw = policy.action_net(policy._latents(batch)[0]).double().numpy()

    def loss(shift: np.ndarray) -> float:
        own = raw + shift
        if actions == DISCRETE:
            own = np.exp(own) / np.exp(own).sum(-1, keepdims=True)
        return float(-(RETURNS * np.log(equation(name, pair.actions.numpy(), own))).sum())

    log_prob = policy.evaluate_actions(batch, pair.actions)[1]
    ours = -(th.tensor(RETURNS) * log_prob).sum()
    ours.backward()
    steps = 1e-6 * np.eye(raw.shape[1])
    slopes = [(loss(step) - loss(-step)) / 2e-6 for step in steps]
    assert ours.item() == pytest.approx(loss(np.zeros(raw.shape[1])), abs=1e-4)
    assert policy.action_net.bias.grad.numpy() == pytest.approx(slopes, abs=1e-4)
