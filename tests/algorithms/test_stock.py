"""Every algorithm of the catalogue, as executions build it, learns what the stock class learns: same parameters and seed, same
weights, to the bit.

On the policy executions take the fused Adam, which rounds otherwise: the stock class is told to here, and what that changes is
bounded by a test of its own. With advice that says nothing: test_advised.py, test_advised_off_policy.py. An execution's actor
draws from a generator of its own; that the curves over HTTP are those in process is measured by `benchmarks/parity.py`.
"""

from __future__ import annotations

import inspect
import tempfile
from pathlib import Path
from typing import Any

import pytest
import torch as th
from stable_baselines3.common.utils import LinearSchedule
from torch.nn.utils import parameters_to_vector

from agents_app.algorithms.builder import build, family_of
from agents_app.algorithms.policies import policy_name
from agents_app.algorithms.registry import ROWS, get_row
from tests.algorithms.games import Identity, Point
from tests.algorithms.specs import actions_of, make_spec
from tests.algorithms.test_learning import Free

STEPS, SEED = 128, 3
KINDS = [(row.name, isinstance(actions, int)) for row in ROWS for actions in actions_of(row)]
FUSED = ("PPO", "TRPO", "MaskablePPO", "PolicyGradient")


def ours(name: str, discrete: bool, end: float | None = None) -> Any:
    """The algorithm after some steps, as executions build it. `end`: what its learning rate falls to."""
    spec, env = make(name, discrete)
    if end is not None:
        spec.parameters.update(learning_rate_end=end)
    return build(spec, env, SEED).learn(STEPS)


def stock(name: str, discrete: bool, end: float | None = None, **policy_kwargs: Any) -> Any:
    """The stock class after as many steps."""
    spec, env = make(name, discrete)
    row, parameters = get_row(name), dict(spec.parameters)
    if end is not None:
        start = inspect.signature(row.load().__init__).parameters["learning_rate"].default
        parameters["learning_rate"] = LinearSchedule(start, end, 1.0)
    for ours_alone in ("total_timesteps", "action_noise"):
        parameters.pop(ours_alone, None)
    if sizes := parameters.pop("net_arch", None):
        policy_kwargs["net_arch"] = [int(sizes)]
    policy = policy_name(row, spec.observations(), "auto")
    return row.load()(policy, env, seed=SEED, device="cpu", policy_kwargs=policy_kwargs, **parameters).learn(STEPS)


def pair(name: str, discrete: bool, end: float | None = None) -> tuple[Any, Any]:
    """Ours and the stock class, with the same optimiser."""
    kwargs = family_of(make(name, discrete)[0]).POLICY_KWARGS if name != "A2C" else {}  # A2C has RMSprop
    return ours(name, discrete, end), stock(name, discrete, end, **kwargs)


def flat(algorithm: Any) -> th.Tensor:
    """What it has learned, (P,)."""
    return parameters_to_vector(algorithm.policy.parameters()).detach()


def make(name: str, discrete: bool) -> tuple[Any, Any]:
    """The agent and its game."""
    space: Any = 3 if discrete else [[1], -1, 1]
    spec = make_spec(name, space, space, parameters={"total_timesteps": STEPS})
    return spec, (Free() if name == "MaskablePPO" else Identity()) if discrete else Point()


@pytest.mark.parametrize("name", ["PPO", "DQN", "SAC", "ARS", "BDPI", "PolicyGradient", "RecurrentPPO"])
def test_it_learns_the_very_same_with_a_rate_that_falls(name: str) -> None:
    one, other = pair(name, name != "SAC", end=0.0)
    assert th.equal(flat(one), flat(other))
    assert not th.equal(flat(one), flat(ours(name, name != "SAC")))


@pytest.mark.parametrize(("name", "discrete"), KINDS, ids=[f"{n}, {'choice' if d else 'number'}" for n, d in KINDS])
def test_it_learns_the_very_same(name: str, discrete: bool) -> None:
    one, other = pair(name, discrete)
    assert one._n_updates == other._n_updates > 0
    state, expected = one.policy.state_dict(), other.policy.state_dict()
    assert state.keys() == expected.keys()
    assert all(th.equal(state[key], expected[key]) for key in expected)
    assert name == "ARS" or len(one.ep_info_buffer) >= STEPS // 10  # ARS keeps none
    assert [it["r"] for it in one.ep_info_buffer] == [it["r"] for it in other.ep_info_buffer]


def test_what_learns_leaves_no_folder_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    ours("PPO", True)
    assert list(tmp_path.iterdir()) == []
    stock("PPO", True)
    assert list(tmp_path.iterdir()), "as the stock class does for its logger"


@pytest.mark.parametrize("name", FUSED)
def test_fused_adam_differs_by_rounding_alone(name: str) -> None:
    state, expected = ours(name, True).policy.state_dict(), stock(name, True).policy.state_dict()
    assert max(float((state[key] - expected[key]).abs().max()) for key in expected) < 1e-5
