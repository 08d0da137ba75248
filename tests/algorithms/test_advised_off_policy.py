"""Off the policy, advice changes what is drawn and nothing else: neutral advice not even that."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from sb3_contrib import QRDQN, TQC
from stable_baselines3 import DDPG, DQN, SAC, TD3
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise

from agents_app.algorithms.advice import Gaussian, neutral_advice, product
from agents_app.algorithms.advised_off_policy import advised_classes
from agents_app.algorithms.explorers import draw_advice, noise_deviation
from agents_app.algorithms.mixing import ADVISOR, BY_SAMPLING, GEOMETRIC, REUSE, SHAPING, UNION, Mixing
from agents_app.algorithms.off_policy import OffPolicyActor
from tests.algorithms.building import built, some
from tests.algorithms.games import Advised, Identity, Point, mean_return
from tests.algorithms.specs import OBSERVATIONS, make_spec

SMALL: dict[str, Any] = {"learning_starts": 20, "batch_size": 8, "buffer_size": 300, "seed": 3, "device": "cpu"}
VALUES, ACTORS, NOISY = (DQN, QRDQN), (SAC, TQC, TD3, DDPG), (TD3, DDPG)
EVERY = pytest.mark.parametrize("stock", [*VALUES, *ACTORS])
METHODS: dict[str, Mixing] = {
    "intersection": Mixing(),
    "sampling": Mixing(continuous=BY_SAMPLING),
    "geometric": Mixing(GEOMETRIC, weight=4.0),
    "union": Mixing(UNION),
    "reuse": Mixing(REUSE, psi=0.9),
    "shaping": Mixing(SHAPING),
}
WIDE = 4000  # so many draws at once
WITHOUT = Mixing()


class Plane(gym.Env[Any, Any]):
    """Two numbers to say, between bounds that are not -1 and 1: its only use is its spaces."""

    observation_space = spaces.Box(-1, 1, (3,), np.float32)
    action_space = spaces.Box(np.array([-4, 0], np.float32), np.array([4, 10], np.float32))


class Choice(gym.Env[Any, Any]):
    """One of four."""

    observation_space = spaces.Box(-1, 1, (3,), np.float32)
    action_space = spaces.Discrete(4)


def small(stock: Any, **options: Any) -> dict[str, Any]:
    """Arguments with which it learns quickly; noise where there would be none."""
    noise = {"action_noise": NormalActionNoise(np.zeros(1), np.full(1, 0.2))} if stock in NOISY else {}
    return {**SMALL, **noise, "train_freq": 2, "gradient_steps": 1, **options}


def game(stock: Any) -> gym.Env:
    """One that it can play."""
    return Identity() if stock in VALUES else Point()


def advised(stock: Any, env: gym.Env, mixing: Mixing = WITHOUT, width: int = 8, **options: Any) -> Any:
    """The algorithm that takes advice, on a game that gives some."""
    algorithm, policy = advised_classes(stock, stock.policy_aliases["MlpPolicy"])
    return algorithm(policy, env, policy_kwargs={"net_arch": [width], "mixing": mixing}, **small(stock, **options))


def here(stock: Any, mixing: Mixing = WITHOUT, noise: float = 0.2, **options: Any) -> Any:
    """An advised algorithm in the plane or before a choice, past its warm-up."""
    env = Advised(Choice() if stock in VALUES else Plane())
    if stock in NOISY:
        options = {"action_noise": NormalActionNoise(np.zeros(2), np.full(2, noise)) if noise else None, **options}
    model = advised(stock, env, mixing, **options)
    model.num_timesteps = 1000
    return model


def draws(model: Any, advice: Any, count: int = WIDE, seed: int = 1) -> np.ndarray:
    """Actions drawn at one place with one advice, (count, ...)."""
    th.manual_seed(seed)
    np.random.seed(seed)
    where = np.tile(np.array([0.3, -0.5, 0.9], np.float32), (count, 1))
    model._last_obs = {"_observation": where, "advice": np.tile(np.asarray(advice, np.float32), (count, 1))}
    noise = model.action_noise
    wide = None if noise is None else lambda: np.stack([noise() for _ in range(count)])
    action, buffered = model._sample_action(model.learning_starts, wide, count)
    if isinstance(model.action_space, spaces.Box):
        assert action == pytest.approx(model.policy.unscale_action(buffered))
        assert np.abs(buffered).max() <= 1
    return action


def place() -> th.Tensor:
    """The place, as networks see it."""
    return th.tensor([[0.3, -0.5, 0.9]])


def shares(actions: np.ndarray) -> np.ndarray:
    """How often each of four is chosen."""
    return np.bincount(actions, minlength=4) / len(actions)


def set_actor(model: Any, mean: list[float], deviation: float = 0.3) -> None:
    """Let the actor's last layers say this everywhere; of SAC's, before it is squashed."""
    with th.no_grad():
        last = model.actor.mu if isinstance(model.actor.mu, th.nn.Linear) else model.actor.mu[-2]
        last.weight.zero_()
        last.bias[:] = th.tensor(mean)
        if isinstance(getattr(model.actor, "log_std", None), th.nn.Linear):
            model.actor.log_std.weight.zero_()
            model.actor.log_std.bias.fill_(np.log(deviation))


def set_values(model: Any, best: int) -> None:
    """Let one action be worth most everywhere."""
    net = model.q_net.q_net if hasattr(model, "q_net") else model.quantile_net.quantile_net
    with th.no_grad():
        net[-1].weight.zero_()
        net[-1].bias.view(-1, 4)[:] = th.nn.functional.one_hot(th.tensor(best), 4).float()


class TestNeutral:
    @pytest.mark.parametrize(
        ("stock", "method"),
        [
            *((stock, "intersection") for stock in (*VALUES, *ACTORS)),
            *((stock, method) for stock in (DQN, TD3) for method in ("reuse", "shaping")),
            (QRDQN, "union"),
            (SAC, "sampling"),
        ],
    )
    def test_two_hundred_steps_of_learning_are_those_of_the_stock_algorithm(self, stock: Any, method: str) -> None:
        plain = stock("MlpPolicy", game(stock), policy_kwargs={"net_arch": [8]}, **small(stock)).learn(200)
        ours = advised(stock, Advised(game(stock)), METHODS[method]).learn(200)
        assert ours._n_updates == plain._n_updates > 50
        ours_state, plain_state = ours.policy.state_dict(), plain.policy.state_dict()
        assert ours_state.keys() == plain_state.keys()
        assert all(th.equal(ours_state[name], plain_state[name]) for name in plain_state)
        for array in ("observations", "next_observations", "actions", "rewards", "dones"):
            assert np.array_equal(getattr(ours.replay_buffer, array), getattr(plain.replay_buffer, array))

    @EVERY
    def test_the_replay_buffer_keeps_no_advice(self, stock: Any) -> None:
        model = advised(stock, Advised(game(stock))).learn(50)
        assert type(model.replay_buffer) is ReplayBuffer
        assert model.observation_space == game(stock).observation_space == model.policy.observation_space

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_exploration_by_gsde_is_the_stock_one_too(self, stock: Any) -> None:
        options = small(stock, use_sde=True, sde_sample_freq=4)
        plain = stock("MlpPolicy", Point(), policy_kwargs={"net_arch": [8]}, **options).learn(100)
        ours = advised(stock, Advised(Point()), use_sde=True, sde_sample_freq=4).learn(100)
        assert np.array_equal(ours.replay_buffer.actions, plain.replay_buffer.actions)

    @pytest.mark.parametrize("stock", ACTORS)
    @pytest.mark.parametrize("method", ["intersection", "sampling", "geometric", "reuse"])
    def test_a_component_without_advice_stays_the_learners_own(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        set_actor(model, [0.4, -0.2])
        own = draws(model, neutral_advice(model.action_space))
        half = draws(model, [2.0, 7.0, np.inf, 0.3])
        assert half[:, 0].mean() == pytest.approx(own[:, 0].mean(), abs=0.1)
        assert half[:, 0].std() == pytest.approx(own[:, 0].std(), rel=0.1)
        assert half[:, 1].mean() > own[:, 1].mean() + 0.5


@pytest.mark.parametrize("stock", VALUES)
class TestChoices:
    ADVICE = np.array([0.1, 0.6, 0.2, 0.1])

    def test_the_learners_policy_is_epsilon_greedy(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 2)
        model.exploration_rate = 0.2
        expected = [0.05, 0.05, 0.85, 0.05]
        assert model.policy.get_distribution(place()).distribution.probs[0].numpy() == pytest.approx(expected)
        assert shares(draws(model, [0.25] * 4)) == pytest.approx(expected, abs=0.03)

    @pytest.mark.parametrize("method", ["intersection", "geometric", "union", "reuse"])
    def test_actions_are_drawn_from_the_mixture(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        set_values(model, 2)
        model.exploration_rate = 0.4
        own = np.array([0.1, 0.1, 0.7, 0.1])
        mixed = {
            "intersection": own * self.ADVICE / (own * self.ADVICE).sum(),
            "geometric": own**0.2 * self.ADVICE**0.8 / (own**0.2 * self.ADVICE**0.8).sum(),
            "union": (own + self.ADVICE) / 2,
            "reuse": 0.9 * self.ADVICE + 0.1 * own,
        }[method]
        assert shares(draws(model, self.ADVICE)) == pytest.approx(mixed, abs=0.03)

    def test_in_the_warm_up_it_is_drawn_from_the_advice(self, stock: Any) -> None:
        model = here(stock)
        model.num_timesteps = 0
        assert shares(draws(model, self.ADVICE)) == pytest.approx(self.ADVICE, abs=0.03)

    @pytest.mark.parametrize("steps", [0, 1000], ids=["warm-up", "later"])
    def test_an_order_is_obeyed(self, stock: Any, steps: int) -> None:
        model = here(stock)
        model.num_timesteps, model.exploration_rate = steps, 0.01
        set_values(model, 2)
        assert shares(draws(model, [0, 0, 0, 1])) == pytest.approx([0, 0, 0, 1])

    @pytest.mark.parametrize(("last_word", "chosen"), [("learner", 2), ("advisor", 3)])
    def test_where_nothing_is_possible_to_both_the_last_word_counts(
        self, stock: Any, last_word: str, chosen: int
    ) -> None:
        model = here(stock, Mixing(last_word=last_word))
        model.exploration_rate = 0.0
        set_values(model, 2)
        assert set(draws(model, [0, 0, 0, 1])) == {chosen}

    def test_as_a_reward_it_changes_no_action(self, stock: Any) -> None:
        model = here(stock, Mixing(SHAPING))
        model.exploration_rate = 0.0
        set_values(model, 2)
        assert set(draws(model, [0, 0, 0, 1])) == {2}

    def test_greedy_actions_heed_no_advice(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 2)
        obs = {"_observation": np.zeros(3, np.float32), "advice": np.array([0, 0, 0, 1], np.float32)}
        assert model.predict(obs, deterministic=True)[0] == 2


class TestNumbers:
    """All in units of the plane: its middle is (0, 5), and half of its width (4, 5)."""

    ADVICE = [2.0, 7.5, 0.8, 1.0]  # in SB3's units, means of 0.5 and deviations of 0.2

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_by_the_mean_squashed_policies_meet_half_way_and_keep_their_own_noise(self, stock: Any) -> None:
        model = here(stock)
        set_actor(model, [0.4, -0.2], 0.3)
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        half_way = (np.tanh([0.4, -0.2]) + 0.5) / 2
        assert np.arctanh(scaled).mean(0) == pytest.approx(np.arctanh(half_way), abs=0.02)
        assert np.arctanh(scaled).std(0) == pytest.approx([0.3, 0.3], rel=0.05)

    @pytest.mark.parametrize("stock", NOISY)
    @pytest.mark.parametrize("noise", [0.0, 0.1])
    def test_by_the_mean_deterministic_ones_meet_half_way_and_keep_their_noise(self, stock: Any, noise: float) -> None:
        model = here(stock, noise=noise)
        set_actor(model, [0.4, -0.2])
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        assert scaled.mean(0) == pytest.approx((np.tanh([0.4, -0.2]) + 0.5) / 2, abs=0.01)
        assert scaled.std(0) == pytest.approx([noise, noise], rel=0.05, abs=1e-6)

    @pytest.mark.parametrize("stock", NOISY)
    def test_by_sampling_deterministic_ones_tend_to_the_product_of_both_densities(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING, samples=300), noise=0.2)
        set_actor(model, [0.4, 0.2])
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        own = Gaussian(np.tanh([0.4, 0.2]), np.full(2, 0.2))
        expected = product(own, np.array([0.5, 0.5, 0.2, 0.2]))
        assert scaled.mean(0) == pytest.approx(expected.mean, abs=0.02)
        assert scaled.std(0) == pytest.approx(expected.deviation, rel=0.1)

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_by_sampling_squashed_ones_do_too(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING, samples=300))
        set_actor(model, [0.4, -0.2], 0.4)
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        grid = np.linspace(-0.999, 0.999, 4001)
        for index, mean in enumerate([0.4, -0.2]):
            own = np.exp(-0.5 * ((np.arctanh(grid) - mean) / 0.4) ** 2) / (1 - grid**2)
            density = own * np.exp(-0.5 * ((grid - 0.5) / 0.2) ** 2)
            expected = (grid * density).sum() / density.sum()
            spread = np.sqrt(((grid - expected) ** 2 * density).sum() / density.sum())
            assert scaled[:, index].mean() == pytest.approx(expected, abs=0.02)
            assert scaled[:, index].std() == pytest.approx(spread, rel=0.1)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_reuse_takes_the_advisors_action_so_often(self, stock: Any) -> None:
        model = here(stock, Mixing(REUSE, psi=0.3), noise=0.05)
        set_actor(model, [-1.5, -1.5], 0.05)
        heeded = draws(model, [3.0, 8.0, 0.01, 0.01])[:, 0] > 2.5
        assert heeded.mean() == pytest.approx(0.3, abs=0.03)

    @pytest.mark.parametrize("stock", ACTORS)
    @pytest.mark.parametrize("method", ["intersection", "sampling", "geometric", "reuse"])
    def test_the_warm_up_is_a_policy_too_whose_mean_is_the_middle(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        model.num_timesteps = 0
        model.action_noise = None
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        expected = {"intersection": (0.23, 0.55), "geometric": (0.36, 0.52), "sampling": (0.5, 0.2)}
        mean, deviation = (expected | {"reuse": (0.45, 0.31)})[method]
        assert scaled.mean(0) == pytest.approx([mean, mean], abs=0.03)
        assert scaled.std(0) == pytest.approx([deviation, deviation], abs=0.04)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_an_order_is_obeyed_by_sampling(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING))
        assert draws(model, [1.0, 2.0, 0.0, 0.0], 10) == pytest.approx(np.tile([1.0, 2.0], (10, 1)), abs=1e-5)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_where_nothing_is_possible_to_both_the_last_word_counts(self, stock: Any) -> None:
        for last_word, sign in (("learner", -1), (ADVISOR, 1)):
            model = here(stock, Mixing(continuous=BY_SAMPLING, last_word=last_word), noise=0.01)
            set_actor(model, [-1.0, -1.0], 0.01)
            scaled = (draws(model, [3.0, 9.0, 0.01, 0.01], 10) - [0, 5]) / [4, 5]
            assert (np.sign(scaled) == sign).all()

    @pytest.mark.parametrize("stock", ACTORS)
    def test_greedy_actions_heed_no_advice(self, stock: Any) -> None:
        model = here(stock)
        obs = {"_observation": np.zeros(3, np.float32), "advice": np.array([4, 4, 0.1, 0.1], np.float32)}
        expected, _ = model.predict(obs["_observation"], deterministic=True)
        assert np.array_equal(model.predict(obs, deterministic=True)[0], expected)

    @pytest.mark.parametrize("stock", NOISY)
    def test_sampling_needs_a_density(self, stock: Any) -> None:
        with pytest.raises(ValueError, match="action_noise"):
            here(stock, Mixing(continuous=BY_SAMPLING), noise=0.0)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_union_is_for_choices(self, stock: Any) -> None:
        with pytest.raises(ValueError, match="Union"):
            here(stock, Mixing(UNION))


class TestProperties:
    MODELS: dict[Any, Any] = {}

    @given(
        stock=st.sampled_from(ACTORS),
        method=st.sampled_from(["intersection", "geometric", "sampling", "reuse"]),
        learner=st.lists(st.floats(-100, 100), min_size=2, max_size=2),
        deviation=st.floats(1e-6, 7),
        means=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=2),
        deviations=st.lists(st.floats(0, 1e6) | st.just(np.inf), min_size=2, max_size=2),
    )
    def test_actions_stay_finite_and_within_bounds(
        self, stock: Any, method: str, learner: Any, deviation: float, means: Any, deviations: Any
    ) -> None:
        model = self.MODELS.setdefault((stock, method), here(stock, METHODS[method]))
        set_actor(model, learner, deviation)
        actions = draws(model, [*means, *deviations], 5)
        assert all(model.action_space.contains(action) for action in actions.astype(np.float32))

    @given(
        stock=st.sampled_from(VALUES),
        method=st.sampled_from(["intersection", "geometric", "union", "reuse"]),
        rate=st.floats(0, 1),
        advice=st.lists(st.floats(0, 1, width=32), min_size=4, max_size=4).filter(any),
    )
    def test_some_action_is_always_chosen(self, stock: Any, method: str, rate: float, advice: Any) -> None:
        model = self.MODELS.setdefault((stock, method), here(stock, METHODS[method]))
        model.exploration_rate = rate
        assert all(model.action_space.contains(action) for action in draws(model, advice, 5))

    @given(deviations=st.lists(st.floats(0, 10) | st.just(np.inf), min_size=2, max_size=2))
    def test_draws_of_the_advisor_are_its_own_or_the_learners(self, deviations: Any) -> None:
        own = np.array([[0.25, -0.75], [0.5, 0.5]], np.float32)
        advice = np.tile(np.array([0.9, 0.9, *deviations], np.float32), (2, 1))
        drawn = draw_advice(own, advice, 6)
        assert drawn.shape == (6, 2, 2)
        silent = np.isinf(advice[:, 2:])
        assert np.array_equal(drawn[:, silent], np.tile(own[silent], (6, 1)))
        assert (np.abs(drawn) <= 1).all()


class TestPeers:
    """What they advise: what they would do without advice, in units of actions."""

    @pytest.mark.parametrize("stock", [SAC, TQC])
    @pytest.mark.parametrize("mean", [0.0, 0.5, 3.0])
    @pytest.mark.parametrize("deviation", [0.05, 0.5, 1.5])
    def test_squashed_ones_tell_their_greedy_action_and_how_far_they_stray(
        self, stock: Any, mean: float, deviation: float
    ) -> None:
        model = here(stock)
        set_actor(model, [mean, -mean], deviation)
        said = model.policy.get_distribution(place()).distribution
        greedy = model.predict(place().numpy(), deterministic=True)[0][0]
        assert said.mean[0].detach().numpy() == pytest.approx(greedy, abs=1e-4)
        strays = np.sqrt(((draws(model, neutral_advice(model.action_space), 20_000) - greedy) ** 2).mean(0))
        assert said.stddev[0].detach().numpy() == pytest.approx(strays, rel=0.06)

    @pytest.mark.parametrize("stock", NOISY)
    def test_deterministic_ones_tell_their_action_and_their_noise(self, stock: Any) -> None:
        model = here(stock, noise=0.2)
        said = model.policy.get_distribution(place()).distribution
        assert said.mean[0].detach().numpy() == pytest.approx(model.predict(place().numpy())[0][0], abs=1e-5)
        assert said.stddev[0].detach().numpy() == pytest.approx([0.8, 1.0])

    @pytest.mark.parametrize("stock", NOISY)
    def test_without_noise_they_are_sure(self, stock: Any) -> None:
        said = here(stock, noise=0.0).policy.get_distribution(place()).distribution
        assert (said.stddev < 1e-5).all()

    def test_the_deviation_of_correlated_noise_is_what_it_comes_to(self) -> None:
        noise = OrnsteinUhlenbeckActionNoise(np.zeros(1), np.full(1, 0.3), theta=2.0)
        np.random.seed(1)
        values = np.array([noise() for _ in range(60_000)])[1000:]
        expected = noise_deviation(noise, spaces.Box(-1, 1, (1,)))
        assert values.std() == pytest.approx(expected.item(), rel=0.06)

    @pytest.mark.parametrize("stock", VALUES)
    def test_one_that_explores_still_says_so(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 1)
        for rate in (1.0, 0.5, 0.0):
            model.exploration_rate = rate
            said = model.policy.get_distribution(place()).distribution.probs[0].numpy()
            assert said == pytest.approx(rate / 4 + (1 - rate) * np.eye(4)[1])


class TestLearning:
    QUICK: dict[str, Any] = {"learning_rate": 0.01, "gamma": 0.0, "learning_starts": 100}

    @pytest.mark.parametrize("method", ["intersection", "union"])
    def test_a_choice_is_learned_in_spite_of_wrong_advice(self, method: str) -> None:
        wrong = np.array([0.8, 0.1, 0.1], np.float32)
        model = advised(DQN, Advised(Identity(), wrong), METHODS[method], target_update_interval=50, **self.QUICK)
        assert mean_return(model.learn(1200), Advised(Identity(), wrong)) == 10

    def test_so_is_a_number(self) -> None:
        env = Advised(Point(), np.array([0.9, 0.3], np.float32))
        model = advised(SAC, env, METHODS["sampling"], width=32, batch_size=32, buffer_size=2000, **self.QUICK)
        assert mean_return(model.learn(1000), env) > -1  # doing nothing brings -3.3

    @pytest.mark.parametrize("method", ["intersection", "reuse"])
    @pytest.mark.parametrize("stock", NOISY)
    def test_so_it_is_where_actions_are_deterministic(self, stock: Any, method: str) -> None:
        """Seen with the seeds 0 to 2. By sampling it is not sure to (docs/advice.md)."""
        env, mixing = Advised(Point(), np.array([0.9, 0.3], np.float32)), {"reuse": Mixing(REUSE)}
        options = self.QUICK | {"width": 32, "batch_size": 32, "buffer_size": 2000, "seed": 1}
        model = advised(stock, env, mixing.get(method, WITHOUT), **options)
        assert mean_return(model.learn(1000), env) > -1

    def test_a_newcomer_does_what_a_trained_peer_does(self) -> None:
        trained = advised(DQN, Advised(Identity()), target_update_interval=50, **self.QUICK).learn(1500)
        newcomer = advised(DQN, Advised(Identity()), learning_starts=10_000)
        for seen in range(3):
            obs = np.full(500, seen)
            advice = trained.policy.get_distribution(th.as_tensor(obs)).distribution.probs.numpy()
            newcomer._last_obs = {"_observation": obs, "advice": advice}
            assert (newcomer._sample_action(10_000, None, 500)[0] == seen).mean() > 0.9

    def test_returns_over_several_steps_are_learned_from_too(self) -> None:
        """SB3 has no replay buffer of them for dictionaries; without advice in it, none is needed."""
        plain = DQN("MlpPolicy", Identity(), policy_kwargs={"net_arch": [8]}, **small(DQN, n_steps=3)).learn(100)
        ours = advised(DQN, Advised(Identity()), n_steps=3).learn(100)
        assert type(ours.replay_buffer) is type(plain.replay_buffer)
        assert th.equal(ours.q_net.q_net[0].weight, plain.q_net.q_net[0].weight)


@pytest.mark.parametrize("kind", OBSERVATIONS)
@pytest.mark.parametrize("name", ["DQN", "QR-DQN", "SAC", "TD3"])
def test_executions_record_what_was_drawn_with_advice(name: str, kind: str) -> None:
    discrete = name in ("DQN", "QR-DQN")
    spec = make_spec(name, 3 if discrete else [[2], -2, 2], OBSERVATIONS[kind], advice_method="intersection")
    model = built(spec)
    actor = OffPolicyActor(model)
    advice = np.array([0, 0, 1] if discrete else [50, -50, 0.1, 0.1], np.float32)
    for obs in some(spec.observations(), 30):
        observed = {**(obs if isinstance(obs, dict) else {"_observation": obs}), "advice": advice}
        decision, _ = actor.decide(observed, None, None)
        assert decision.obs is observed
        assert decision.action == pytest.approx(2 if discrete else [2, -2], abs=0.1)
        assert np.array_equal(decision.replay[0][0], decision.action)
