"""The prototype of teams learns as Stable-Baselines3 does, and its learners advise each other as executions do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO as StockPPO

from agents_app.algorithms.advice import mix_logits
from agents_app.algorithms.mixing import ALL, BEST, RANDOM, SEVERAL, Mixing
from experiments.lockstep.networks import Networks
from experiments.lockstep.ppo import PPO, Rollout, Settings, advantages
from experiments.lockstep.teams import Rules, Teams, log_softmax_rows

SETTINGS = Settings(n_steps=128, batch_size=32, n_epochs=2, ent_coef=0.01)
ENVIRONMENT = "CartPole-v1"


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small products are slower on several, as the runner knows."""
    threads = th.get_num_threads()
    th.set_num_threads(1)
    yield
    th.set_num_threads(threads)


def stock() -> StockPPO:
    """PPO with those settings, that has collected a rollout and not yet learned from it."""
    names = {"n_steps", "batch_size", "n_epochs", "ent_coef"}
    given = {name: getattr(SETTINGS, name) for name in names}
    algorithm = StockPPO("MlpPolicy", ENVIRONMENT, seed=1, device="cpu", **given)
    algorithm._setup_learn(SETTINGS.n_steps)
    callback = algorithm._init_callback(None)
    algorithm.collect_rollouts(algorithm.env, callback, algorithm.rollout_buffer, SETTINGS.n_steps)
    return algorithm


def layers_of(algorithm: StockPPO) -> list[th.Tensor]:
    """Weights (in, out) and biases in the order of Networks.parameters."""
    policy = algorithm.policy
    modules = [*policy.mlp_extractor.policy_net, policy.action_net, *policy.mlp_extractor.value_net, policy.value_net]
    return [part for it in modules if isinstance(it, th.nn.Linear) for part in (it.weight.T, it.bias[None])]


def rollout_of(algorithm: StockPPO, learners: int) -> Rollout:
    """What it collected, as if each of several learners had."""
    buffer = algorithm.rollout_buffer
    parts = (buffer.actions[..., 0].astype(int), buffer.rewards, buffer.episode_starts, buffer.values, buffer.log_probs)
    advice = np.ones((SETTINGS.n_steps, 1, 2), np.float32)
    return Rollout(*(np.repeat(part, learners, axis=1) for part in (buffer.observations, *parts, advice)))


def test_who_waits_for_others_learns_nothing() -> None:
    rollout, networks = rollout_of(stock(), 2), Networks(2, 4, 2)
    before = [part.detach().clone() for part in networks.parameters()]
    gains = advantages(rollout, np.zeros(2, np.float32), np.zeros(2, np.float32), SETTINGS)
    PPO(networks, SETTINGS, Mixing()).train(rollout, gains, np.random.RandomState(0), np.array([True, False]))
    moved = [
        (part.detach() != old).flatten(1).any(1).tolist()
        for part, old in zip(networks.parameters(), before, strict=True)
    ]
    assert moved == [[True, False]] * len(before)


def test_an_update_is_that_of_stable_baselines3_for_each_learner() -> None:
    algorithm = stock()
    networks = Networks(2, 4, 2)
    with th.no_grad():
        for ours, theirs in zip(networks.parameters(), layers_of(algorithm), strict=True):
            ours.copy_(theirs.expand_as(ours))
    rollout = rollout_of(algorithm, 2)
    with th.no_grad():
        last = algorithm.policy.predict_values(th.tensor(algorithm._last_obs)).numpy()[:, 0].repeat(2)
    gains = advantages(rollout, last, algorithm._last_episode_starts.repeat(2), SETTINGS)
    assert gains[:, :1] == pytest.approx(algorithm.rollout_buffer.advantages, abs=1e-4)
    np.random.seed(3)
    algorithm.train()
    PPO(networks, SETTINGS, Mixing()).train(rollout, gains, Repeated(3))
    for ours, theirs in zip(networks.parameters(), layers_of(algorithm), strict=True):
        assert ours.detach().numpy() == pytest.approx(theirs.expand_as(ours).detach().numpy(), abs=1e-4)


class Repeated(np.random.RandomState):
    """Gives each permutation twice: two learners draw the same minibatches."""

    def permutation(self, x: Any) -> Any:  # type: ignore[override]
        """As the first time, or a new one."""
        self.kept, kept = None, getattr(self, "kept", None)
        if kept is None:
            self.kept = kept = super().permutation(x)
        return kept


def team(advisors: str, size: int = 3) -> Teams:
    """Learners that are sure of different things."""
    teams = Teams(Rules(ENVIRONMENT, size, advisors=advisors, settings=SETTINGS), [1, 2])
    with th.no_grad():
        teams.networks.actor[-1][0].mul_(100)
    return teams


def spoken(teams: Teams) -> tuple[np.ndarray, np.ndarray]:
    """The advice (S, K, A), and what each would have said to each: (S, K who speaks, K who is there, A)."""
    advice = teams._policies()[1].reshape(teams.count, teams.size, -1)
    seen = th.tensor(teams._observations).reshape(teams.count, 1, teams.size, -1)
    actor = [(w.unflatten(0, (teams.count, -1)), b.unflatten(0, (teams.count, -1))) for w, b in teams.networks.actor]
    with th.no_grad():
        for weight, bias in actor:
            seen = seen @ weight + bias
            seen = seen if weight is actor[-1][0] else seen.tanh()
    return advice, seen.softmax(-1).numpy()


@pytest.mark.parametrize("advisors", [RANDOM, BEST, SEVERAL, ALL])
def test_learners_hear_the_peers_that_the_rule_says(advisors: str) -> None:
    teams = team(advisors)
    teams._returns[:] = [3, 2, 1, 1, 2, 2]
    teams._eligible = teams._find_eligible()
    heard: dict[str, list[list[list[int]]]] = {  # of each team, by each learner
        RANDOM: [[[1, 2], [0, 2], [0, 1]]] * 2,
        BEST: [[[1], [0], [0]], [[1, 2], [2], [1]]],
    }
    advice, said = spoken(teams)
    for index in range(2):
        for place in range(3):
            others = [peer for peer in range(3) if peer != place]
            wanted = [said[index, others, place].mean(0)]
            if advisors not in (ALL, SEVERAL):
                wanted = [said[index, peer, place] for peer in heard[advisors][index][place]]
            assert min(np.abs(advice[index, place] - one).max() for one in wanted) < 1e-4


def test_what_a_rollout_keeps_is_what_its_policy_says_of_it() -> None:
    teams = team(RANDOM)
    teams._wanted, teams._on_episode = 10**6, lambda: None
    rollout = teams._rollout()
    own = teams.networks.logits(th.tensor(rollout.observations.swapaxes(0, 1))).detach().numpy()
    mixed = log_softmax_rows(mix_logits(own, rollout.advice.swapaxes(0, 1), Mixing()))
    chosen = np.take_along_axis(mixed, rollout.actions.T[..., None], -1)[..., 0]
    assert np.abs(rollout.log_probs.T - chosen).max() < 1e-4
    counts = [len(log) for log in teams.episodes]
    assert rollout.starts[1:].sum(0) + teams._starts == pytest.approx(counts)


def test_a_team_learns() -> None:
    teams = Teams(Rules(ENVIRONMENT, 2, settings=Settings(n_steps=256)), [5])
    teams.play(80)
    returns = np.array([[value for _, value in log[:80]] for log in teams.episodes])
    assert returns[:, 60:].mean() > 1.3 * returns[:, :20].mean()
    assert teams.returns_alone(2).shape == (2, 2)


def test_teams_that_average_begin_alike_and_stay_so_each_by_itself() -> None:
    teams = Teams(Rules(ENVIRONMENT, 2, settings=SETTINGS, averaging=True), [5, 6])
    begun = [part.detach().clone() for part in teams.networks.parameters()]
    teams.play(5)
    for part, old in zip(teams.networks.parameters(), begun, strict=True):
        for weights in (part, old):
            first, second, third, fourth = weights.unbind()
            assert th.equal(first, second) and th.equal(third, fourth)
        assert not th.equal(part, old) and not th.equal(part[0], part[2])


def test_alone_each_acts_by_its_own_policy() -> None:
    teams = team(ALL)
    with th.no_grad():
        for weight, bias in teams.networks.actor[-1:]:
            weight.zero_()
            bias.copy_(th.tensor([50.0, 0.0]).expand_as(bias))
            bias[0] = 0.0
    returns = teams.returns_alone(20).mean(1)
    assert (returns[1:] < 11).all(), "always to the same side"
    assert returns[0] > 13, "at random"
