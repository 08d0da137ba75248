"""An advised policy is the stock policy with the same weights, but for the advice; and neutral advice is no advice."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.distributions import kl_divergence

from agents_app.algorithms.advice import Gaussian, advised_space, combine, neutral_advice, with_advice
from agents_app.algorithms.builder import build
from agents_app.algorithms.policies import policy_name
from agents_app.algorithms.registry import get_row
from agents_app.algorithms.small_actor import draw_vector
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.weights import flatten
from tests.algorithms.building import built, some, stack
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec

KINDS = pytest.mark.parametrize("kind", OBSERVATIONS)
ACTIONS = pytest.mark.parametrize(
    ("actions", "parameters"),
    [(DISCRETE, {}), (CONTINUOUS, {}), (CONTINUOUS, {"use_sde": True})],
    ids=["discrete", "continuous", "gSDE"],
)
METHODS: dict[str, dict[str, Any]] = {
    "intersection": {},
    "sampling": {"continuous_advice": "sampling"},
    "geometric": {"advice_method": "geometric", "advice_weight": 3 / 7},
    "union": {"advice_method": "union"},
    "reuse": {"advice_method": "reuse", "psi": 0.7},
    "shaping": {"advice_method": "shaping"},
}
# Each combination of methods and actions that means something of its own.
FITTING = [
    *((DISCRETE, {}, METHODS[name]) for name in METHODS if name != "sampling"),
    *((CONTINUOUS, sde, METHODS[name]) for name in METHODS if name != "union" for sde in ({}, {"use_sde": True})),
]
CORRECTION = pytest.mark.parametrize("correction", [True, False], ids=["correction", "no correction"])


class Pair:
    """An advised policy, the stock one with the same weights, and observations for both."""

    def __init__(
        self, kind: str, actions: Any, parameters: dict[str, Any], correction: bool, algorithm: str, **advice: Any
    ) -> None:
        facts: dict[str, Any] = {"advice_method": "intersection", "learning_correction": correction} | advice
        self.spec: AgentSpec = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters, **facts)
        self.advised = built(self.spec).policy
        plain = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters)
        self.stock = self._stock_policy(algorithm, plain)
        self.stock.load_state_dict(self.advised.state_dict())
        self.observations = some(plain.observations())
        self.batch = stack(self.observations)
        self.actions = th.tensor(np.stack(some(plain.actions())))

    @staticmethod
    def _stock_policy(algorithm: str, spec: AgentSpec) -> Any:
        row = get_row(algorithm)
        stock, name = row.load(), policy_name(row, spec.observations())
        env: gym.Env = gym.Env()
        env.observation_space, env.action_space = spec.observations(), spec.actions()
        use_sde = bool(spec.parameters.get("use_sde"))
        sizes = {"n_steps": 64} | ({} if algorithm == "A2C" else {"batch_size": 16})
        return stock(name, env, policy_kwargs={"net_arch": [8]}, use_sde=use_sde, device="cpu", **sizes).policy

    def with_advice(self, advice: np.ndarray) -> Any:
        """The batch with the same advice everywhere."""
        return stack([with_advice(obs, advice) for obs in self.observations])

    def neutral(self) -> Any:
        """The batch with neutral advice."""
        return self.with_advice(neutral_advice(self.spec.actions()))


def same(one: Any, other: Any) -> bool:
    """Whether two tensors are equal to the bit."""
    return th.equal(one, other)


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO"])
@pytest.mark.parametrize(("actions", "parameters", "advice"), FITTING, ids=str)
@CORRECTION
class TestNeutral:
    def test_nothing_differs_from_the_stock_policy(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], advice: dict[str, Any]
    ) -> None:
        for kind in OBSERVATIONS:
            pair = Pair(kind, actions, parameters, correction, algorithm, **advice)
            results = [results_of(pair, *one) for one in ((pair.advised, pair.neutral()), (pair.stock, pair.batch))]
            assert all(same(one, other) for one, other in zip(*results, strict=True))

    def test_nor_do_the_gradients(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], advice: dict[str, Any]
    ) -> None:
        pair = Pair("vector", actions, parameters, correction, algorithm, **advice)
        for policy, batch in ((pair.advised, pair.neutral()), (pair.stock, pair.batch)):
            values, log_prob, entropy = policy.evaluate_actions(batch, pair.actions)
            (values.sum() + log_prob.sum() + entropy.sum()).backward()
        pairs = list(zip(pair.advised.parameters(), pair.stock.parameters(), strict=True))
        assert all((one.grad is None) == (other.grad is None) for one, other in pairs)
        assert all(one.grad is None or same(one.grad, other.grad) for one, other in pairs)


def results_of(pair: Pair, policy: Any, batch: Any) -> list[th.Tensor]:
    """All that an algorithm asks of its policy, twice, for the draws."""
    th.manual_seed(3)
    if policy.use_sde:
        policy.reset_noise(4)
    return [
        *policy(batch),
        *policy.evaluate_actions(batch, pair.actions),
        policy.predict_values(batch),
        policy.get_distribution(batch).log_prob(pair.actions),
        policy.get_distribution(batch).mode(),
        *policy(batch),
    ]


class TestAdvice:
    ADVICE = combine([np.array([0.1, 0.1, 0.8], np.float32)], 1.0)

    @KINDS
    def test_actions_are_drawn_from_the_intersection(self, kind: str) -> None:
        pair = Pair(kind, DISCRETE, {}, True, "PPO")
        own = pair.stock.get_distribution(pair.batch).distribution.probs
        mixed = own * th.tensor(self.ADVICE)
        mixed = mixed / mixed.sum(-1, keepdim=True)
        th.manual_seed(1)
        batch = pair.with_advice(self.ADVICE)
        drawn = th.stack([pair.advised(batch)[0] for _ in range(600)])
        shares = th.stack([(drawn == action).float().mean(0) for action in range(3)], -1)
        assert th.allclose(shares, mixed, atol=0.08)

    def test_the_learning_rule_sees_the_mixed_policy_with_the_correction(self) -> None:
        pair = Pair("vector", DISCRETE, {}, True, "PPO")
        own = pair.stock.get_distribution(pair.batch).distribution.probs
        mixed = th.log(own * th.tensor(self.ADVICE) / (own * th.tensor(self.ADVICE)).sum(-1, keepdim=True))
        batch = pair.with_advice(self.ADVICE)
        expected = mixed.gather(1, pair.actions[:, None])[:, 0]
        assert th.allclose(pair.advised.evaluate_actions(batch, pair.actions)[1], expected, atol=1e-5)
        taken, _, log_prob = pair.advised(batch)
        assert th.allclose(log_prob, mixed.gather(1, taken[:, None])[:, 0], atol=1e-5)

    def test_without_the_correction_it_sees_the_learners_own(self) -> None:
        pair = Pair("vector", DISCRETE, {}, False, "PPO")
        batch = pair.with_advice(self.ADVICE)
        expected = pair.stock.evaluate_actions(pair.batch, pair.actions)
        assert all(map(same, pair.advised.evaluate_actions(batch, pair.actions), expected))
        taken, _, log_prob = pair.advised(batch)
        assert same(log_prob, pair.stock.evaluate_actions(pair.batch, taken)[1])

    @CORRECTION
    def test_continuous_actions_are_drawn_half_way_with_the_learners_own_deviation(self, correction: bool) -> None:
        pair = Pair("vector", CONTINUOUS, {}, correction, "PPO")
        batch = pair.with_advice(np.array([4.0, -4.0, 0.1, 0.1], np.float32))
        own = pair.stock.get_distribution(pair.batch).distribution
        th.manual_seed(1)
        drawn = th.stack([pair.advised(batch)[0] for _ in range(800)]).detach()
        assert th.allclose(drawn.mean(0), (own.mean + th.tensor([4.0, -4.0])) / 2, atol=0.2)
        assert th.allclose(drawn.std(0), own.stddev, atol=0.15)
        seen = pair.advised.evaluate_actions(batch, pair.actions)[1]
        middle = (own.mean + th.tensor([4.0, -4.0])) / 2 if correction else own.mean
        expected = th.distributions.Normal(middle, own.stddev).log_prob(pair.actions).sum(-1)
        assert th.allclose(seen, expected, atol=1e-4)

    @KINDS
    @ACTIONS
    def test_values_and_greedy_actions_heed_no_advice(
        self, kind: str, actions: Any, parameters: dict[str, Any]
    ) -> None:
        pair = Pair(kind, actions, parameters, True, "PPO")
        advice = self.ADVICE if actions == DISCRETE else np.array([9.0, -9.0, 1.0, 1.0], np.float32)
        batch = pair.with_advice(advice)
        assert same(pair.advised.predict_values(batch), pair.stock.predict_values(pair.batch))
        assert same(pair.advised(batch)[1], pair.stock.predict_values(pair.batch))
        for obs in pair.observations:
            expected, _ = pair.stock.predict(obs, deterministic=True)
            for given in (obs, with_advice(obs, advice)):
                assert np.array_equal(pair.advised.predict(given, deterministic=True)[0], expected)

    def test_a_certain_advisor_and_a_certain_learner_leave_everything_finite(self) -> None:
        pair = Pair("vector", DISCRETE, {}, True, "PPO")
        with th.no_grad():
            pair.advised.action_net.bias[:] = th.tensor([500.0, 0.0, -500.0])
        batch = pair.with_advice(combine([np.array([0, 0, 1], np.float32)], 1.0))
        values, log_prob, entropy = pair.advised.evaluate_actions(batch, th.tensor([0, 1, 2, 2]))
        (values.sum() + log_prob.sum() + entropy.sum()).backward()
        assert th.isfinite(log_prob).all()
        gradients = [p.grad for p in pair.advised.parameters() if p.grad is not None]
        assert gradients
        assert all(th.isfinite(gradient).all() for gradient in gradients)


OWN_MEAN, OWN_STD = th.tensor([0.5, -0.5]), th.tensor([0.8, 1.2])
SAID = np.array([1.5, 0.5, 0.6, 0.9], np.float32)


def fixed_gaussian(**advice: Any) -> tuple[Any, Any]:
    """A policy of one mind, whatever it sees, and a batch with advice for it."""
    pair = Pair("vector", CONTINUOUS, {}, advice.pop("learning_correction", True), "PPO", **advice)
    with th.no_grad():
        pair.advised.action_net.weight.zero_()
        pair.advised.action_net.bias[:] = OWN_MEAN
        pair.advised.log_std[:] = OWN_STD.log()
    return pair.advised, stack([with_advice(pair.observations[0], SAID)] * 20_000)


class TestContinuousMethods:
    PRODUCT_VARIANCE = 1 / (1 / OWN_STD**2 + 1 / th.tensor(SAID[2:]) ** 2)
    PRODUCT_MEAN = PRODUCT_VARIANCE * (OWN_MEAN / OWN_STD**2 + th.tensor(SAID[:2] / SAID[2:] ** 2))

    def test_by_sampling_actions_are_drawn_from_the_product(self) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", advice_samples=256)
        th.manual_seed(1)
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        assert th.allclose(actions.mean(0), self.PRODUCT_MEAN, atol=0.03)
        assert th.allclose(actions.std(0), self.PRODUCT_VARIANCE.sqrt(), atol=0.03)
        expected = th.distributions.Normal(self.PRODUCT_MEAN, self.PRODUCT_VARIANCE.sqrt()).log_prob(actions).sum(-1)
        assert th.allclose(log_prob, expected, atol=1e-4)

    def test_few_samples_are_as_much_the_advisors_as_they_can(self) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", advice_samples=1)
        th.manual_seed(1)
        with th.no_grad():
            actions = policy(batch)[0]
        assert th.allclose(actions.mean(0), th.tensor(SAID[:2]), atol=0.03)
        assert th.allclose(actions.std(0), th.tensor(SAID[2:]), atol=0.03)

    @pytest.mark.parametrize(("last_word", "mean"), [("learner", [0.5, -0.5]), ("advisor", [90.0, -90.0])])
    def test_who_has_the_last_word_decides_an_empty_intersection(self, last_word: str, mean: list[float]) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", last_word=last_word)
        batch["advice"][:] = th.tensor([90.0, -90.0, 0.1, 0.1])
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        assert th.allclose(actions.mean(0), th.tensor(mean), atol=0.1)
        assert same(log_prob, policy.evaluate_actions(batch, actions)[1])

    def test_by_reuse_actions_are_the_advisors_so_often(self) -> None:
        policy, batch = fixed_gaussian(advice_method="reuse", psi=0.3)
        batch["advice"][:] = th.tensor([50.0, 50.0, 0.6, 0.9])
        th.manual_seed(1)
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        advised = (actions > 25).all(-1)
        assert th.equal(advised, (actions > 25).any(-1)), "both dimensions are the same player's"
        assert advised.float().mean().item() == pytest.approx(0.3, abs=0.02)
        assert th.allclose(actions[~advised].mean(0), OWN_MEAN, atol=0.05)
        own = th.distributions.Normal(OWN_MEAN, OWN_STD).log_prob(actions).sum(-1) + np.log(0.7)
        assert th.allclose(log_prob[~advised], own[~advised], atol=1e-4)

    @pytest.mark.parametrize("name", ["sampling", "reuse"])
    def test_without_the_correction_the_learning_rule_sees_the_learners_own(self, name: str) -> None:
        policy, batch = fixed_gaussian(learning_correction=False, **METHODS[name])
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        own = th.distributions.Normal(OWN_MEAN, OWN_STD)
        assert th.allclose(log_prob, own.log_prob(actions).sum(-1), atol=1e-4)
        _, again, entropy = policy.evaluate_actions(batch, actions)
        assert th.allclose(again, log_prob)
        assert th.allclose(entropy, own.entropy().sum())

    @pytest.mark.parametrize("name", ["sampling", "reuse", "intersection"])
    @CORRECTION
    def test_the_small_actor_draws_the_same(self, name: str, correction: bool) -> None:
        """The same distribution from NumPy's generator, and the densities that the policy has for its draws."""
        policy, batch = fixed_gaussian(learning_correction=correction, **METHODS[name])
        own = Gaussian(OWN_MEAN.numpy(), OWN_STD.numpy())
        np.random.seed(1)
        with th.no_grad():
            expected = policy(batch)[0]
            drawn, logs = zip(*(draw_vector(own, SAID, policy.mixing) for _ in range(3000)), strict=True)
            actions = th.tensor(np.stack(drawn))
            part = {key: value[:3000] for key, value in batch.items()}
            if correction:
                assert th.allclose(policy.evaluate_actions(part, actions)[1], th.tensor(np.stack(logs)), atol=1e-3)
        assert th.allclose(actions.mean(0), expected.mean(0), atol=0.1)
        assert th.allclose(actions.std(0), expected.std(0), atol=0.1)

    def test_union_is_for_discrete_actions(self) -> None:
        with pytest.raises(ValueError, match="Policy Union is for discrete actions"):
            Pair("vector", CONTINUOUS, {}, True, "PPO", advice_method="union")


class TestMixtureInTRPO:
    def test_its_distance_bounds_the_divergence_of_the_mixtures(self) -> None:
        pair = Pair("vector", CONTINUOUS, {}, True, "TRPO", advice_method="reuse", psi=0.4)
        batch = pair.with_advice(SAID)
        with th.no_grad():
            before = pair.advised.get_distribution(batch)
            pair.advised.action_net.bias += 0.5
            after = pair.advised.get_distribution(batch)
            th.manual_seed(1)
            draws = th.stack([before.sample() for _ in range(4000)])
            logs = [th.stack([one.log_prob(draw) for draw in draws]) for one in (before, after)]
            bound = kl_divergence(before, after).sum(-1)
        measured = (logs[0] - logs[1]).mean(0)
        assert (measured > 0.01).all()
        assert (measured < bound).all()

    def test_of_itself_it_is_none(self) -> None:
        pair = Pair("vector", CONTINUOUS, {}, True, "TRPO", advice_method="reuse")
        one = pair.advised.get_distribution(pair.with_advice(SAID))
        assert kl_divergence(one, one).abs().max() == 0


@pytest.mark.parametrize(("actions", "parameters", "advice"), FITTING, ids=str)
@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO"])
@CORRECTION
def test_it_learns_from_advised_steps(
    algorithm: str, actions: Any, parameters: dict[str, Any], advice: dict[str, Any], correction: bool
) -> None:
    """Of each game, some updates: the weights move and stay finite, whether the advice is an order, soft or none."""
    facts = {"advice_method": "intersection", "learning_correction": correction} | advice
    spec = make_spec(algorithm, actions, OBSERVATIONS["vector"], parameters, **facts)
    algorithm_, before = build(spec, Counsel(spec), 1), None
    for _ in range(2):
        algorithm_.learn(64, reset_num_timesteps=False)
        after = flatten(algorithm_.policy)
        assert np.isfinite(after).all()
        assert before is None or not np.array_equal(before, after)
        before = after


class Counsel(gym.Env):
    """Random states with advice of every kind in turn; a small action is a good one. Ends after 10 steps."""

    def __init__(self, spec: AgentSpec) -> None:
        self.inner, self.action_space = spec.observations(), spec.actions()
        self.observation_space = advised_space(self.inner, self.action_space)
        hard, soft = (
            ([0, 1, 0], [0.2, 0.2, 0.6]) if spec.action_space == DISCRETE else ([9, 9, 0, 0], [1, -1, 2, np.inf])
        )
        neutral = neutral_advice(self.action_space)
        self.kinds = [np.array(hard, np.float32), np.array(soft, np.float32), neutral]
        self.steps = 0
        self.inner.seed(1)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin anew."""
        return self._see(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Any action."""
        self.steps += 1
        return self._see(), -float(np.sum(np.square(action))), self.steps % 10 == 0, False, {}

    def _see(self) -> dict[str, Any]:
        return with_advice(self.inner.sample(), self.kinds[self.steps % 3])


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
