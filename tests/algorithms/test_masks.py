"""Masks: forbidden actions are never taken, learned from as forbidden, and nothing changes where all are allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from agents_app.algorithms.actor import batch
from agents_app.algorithms.advice import with_advice
from agents_app.algorithms.bdpi import Batches, critic_targets
from agents_app.algorithms.builder import build, family_of
from agents_app.algorithms.masks import FORBIDDEN, mask_advice, mask_logits, masked_space, mix_allowed, with_mask
from agents_app.algorithms.mixing import ADVISOR, GEOMETRIC, INTERSECTION, LEARNER, REUSE, UNION, Mixing
from agents_app.algorithms.registry import ROWS
from tests.algorithms.building import built, environment, some
from tests.algorithms.specs import OBSERVATIONS, make_spec
from tests.execution.station import Station

N = 5
MASKED = [row.name for row in ROWS if row.masks and row.family != "maskable"]
LOGITS = hnp.arrays(np.float32, N, elements=st.floats(-20, 20, width=32))
MASKS = hnp.arrays(np.int8, N, elements=st.integers(0, 1)).filter(lambda mask: mask.any())
ADVICE = hnp.arrays(np.float32, N, elements=st.floats(0, 1, width=32, allow_subnormal=False)).filter(
    lambda advice: advice.sum() > 1e-3
)
METHODS = st.builds(
    Mixing, st.sampled_from([INTERSECTION, UNION, REUSE, GEOMETRIC]), last_word=st.sampled_from([LEARNER, ADVISOR])
)


def softmax(logits: np.ndarray) -> np.ndarray:
    """Probabilities, in double precision."""
    return th.from_numpy(np.asarray(logits, np.float64)).softmax(-1).numpy()


class TestArithmetic:
    @given(LOGITS, ADVICE, MASKS, METHODS)
    @settings(deadline=None)
    def test_forbidden_actions_have_no_probability_and_the_allowed_ones_have_all(
        self, logits: np.ndarray, advice: np.ndarray, allowed: np.ndarray, mixing: Mixing
    ) -> None:
        found = softmax(mix_allowed(logits, advice / advice.sum(), mixing, allowed))
        assert found[allowed == 0].sum() == 0.0
        assert found.sum() == pytest.approx(1.0)

    @given(LOGITS, ADVICE, MASKS, METHODS)
    @settings(deadline=None)
    def test_it_is_what_two_policies_over_the_allowed_actions_alone_would_mix(
        self, logits: np.ndarray, advice: np.ndarray, allowed: np.ndarray, mixing: Mixing
    ) -> None:
        here = allowed == 1
        assume(advice[here].sum() > 1e-3 and here.sum() > 1)
        advice = advice / advice.sum()
        found = softmax(mix_allowed(logits, advice, mixing, allowed))[here]
        alone = softmax(mix_allowed(logits[here], advice[here] / advice[here].sum(), mixing, None))
        np.testing.assert_allclose(found, alone, atol=2e-4)

    @given(LOGITS, ADVICE, METHODS)
    @settings(deadline=None)
    def test_a_mask_that_allows_everything_changes_no_bit(
        self, logits: np.ndarray, advice: np.ndarray, mixing: Mixing
    ) -> None:
        for said in (None, advice, np.ones(N, np.float32)):
            with_all = mix_allowed(logits, said, mixing, np.ones(N, np.int8))
            assert np.array_equal(with_all, mix_allowed(logits, said, mixing, None))

    @given(LOGITS, ADVICE, MASKS, METHODS)
    @settings(deadline=None)
    def test_torch_says_what_numpy_says_with_finite_gradients(
        self, logits: np.ndarray, advice: np.ndarray, allowed: np.ndarray, mixing: Mixing
    ) -> None:
        own = th.from_numpy(logits).clone().requires_grad_()
        mixed = mix_allowed(own, th.from_numpy(advice), mixing, th.from_numpy(allowed))
        policy = th.distributions.Categorical(logits=mixed)
        (policy.log_prob(mixed.argmax()) + policy.entropy()).backward()
        assert own.grad is not None
        assert own.grad.isfinite().all()
        assert not own.grad[th.from_numpy(allowed) == 0].any()
        np.testing.assert_allclose(
            softmax(mixed.detach().numpy()), softmax(mix_allowed(logits, advice, mixing, allowed)), atol=1e-4
        )

    def test_an_advisor_who_speaks_of_forbidden_actions_only_is_silent(self) -> None:
        allowed: Any = np.array([1, 0, 1], np.int8)
        for advice in ([0, 1, 0], [1, 1, 1]):
            said: Any = np.array(advice, np.float32)
            assert mask_advice(said, allowed).tolist() == [1, 1, 1]

    @pytest.mark.parametrize("least", [1e-30, 1e-40, 1e-45])
    def test_advice_that_leaves_next_to_nothing_is_what_it_says_of_the_allowed_ones(self, least: float) -> None:
        advice: Any = np.array([1, least, 0], np.float32)
        allowed: Any = np.array([0, 1, 1], np.int8)
        assert mask_advice(advice, allowed).tolist() == pytest.approx([0, 1, 0])
        assert mask_advice(th.from_numpy(advice), th.from_numpy(allowed)).tolist() == pytest.approx([0, 1, 0])

    @pytest.mark.parametrize(("last_word", "best"), [(LEARNER, 0), (ADVISOR, 2)])
    def test_where_they_agree_on_no_allowed_action_the_last_word_decides_among_those(
        self, last_word: str, best: int
    ) -> None:
        logits: Any = np.array([400.0, 0.0, 0.0], np.float32)
        advice: Any = np.array([0.0, 0.5, 0.5], np.float32)  # both would do action 1 a little; it is forbidden
        mixed = mix_allowed(logits, advice, Mixing(last_word=last_word), np.array([1, 0, 1], np.int8))
        assert mixed.argmax() == best

    def test_vectors_of_numbers_have_no_mask(self) -> None:
        with pytest.raises(ValueError, match="one of n actions"):
            masked_space(spaces.Discrete(3), spaces.Box(-1, 1, (2,)))


def decisions(spec: Any, masks: list[np.ndarray | None], advice: np.ndarray | None = None) -> list[Any]:
    """What an actor decides at the same observations under these masks, always with the same random numbers."""
    algorithm = built(spec)
    actor = family_of(spec).make_actor(algorithm)
    np.random.seed(3)
    th.manual_seed(3)
    made = []
    for obs, mask in zip(some(spec.observations(), len(masks)), masks, strict=True):
        seen = with_mask(obs, mask, spec.action_space) if spec.action_masks else obs
        made.append(actor.decide(seen if advice is None else with_advice(seen, advice), None, None)[0])
    return made


@pytest.mark.parametrize("advice", ["none", INTERSECTION])
@pytest.mark.parametrize("kind", ["vector", "dict"])
@pytest.mark.parametrize("name", MASKED)
def test_executions_never_take_a_forbidden_action(name: str, kind: str, advice: str) -> None:
    spec = make_spec(name, observations=OBSERVATIONS[kind], action_masks=True, advice_method=advice)
    masks: list[np.ndarray | None] = [np.arange(3) != number % 3 for number in range(30)]
    said = None if advice == "none" else np.array([0.8, 0.1, 0.1], np.float32)
    made = decisions(spec, masks, said)
    assert all(mask[decision.action] for mask, decision in zip(masks, made, strict=True) if mask is not None)
    assert {int(decision.action) for decision in made} == {0, 1, 2}


@pytest.mark.parametrize("name", MASKED)
def test_where_all_are_allowed_executions_do_the_very_same(name: str) -> None:
    free = decisions(make_spec(name), [None] * 40)
    masked = decisions(make_spec(name, action_masks=True), [None, np.ones(3, bool)] * 20)
    assert [int(decision.action) for decision in free] == [int(decision.action) for decision in masked]
    for one, other in zip(free, masked, strict=True):
        assert all(np.array_equal(mine, yours) for mine, yours in zip(one.replay, other.replay, strict=True))


@pytest.mark.parametrize("correction", [True, False])
@pytest.mark.parametrize("name", ["PPO", "A2C", "TRPO", "PolicyGradient"])
def test_the_update_sees_the_masked_policy(name: str, correction: bool) -> None:
    fields = {"action_masks": True, "advice_method": INTERSECTION, "learning_correction": correction}
    spec = make_spec(name, **fields)
    policy = built(spec).policy
    for decision in decisions(spec, [np.array([True, False, True])] * 8, np.array([0.5, 0.2, 0.3], np.float32)):
        tensors = {key: th.as_tensor(part) for key, part in batch(decision.obs).items()}
        with th.no_grad():
            _, log_prob, entropy = policy.evaluate_actions(tensors, decision.replay[0])
            forbidden = policy.evaluate_actions(tensors, th.tensor([1]))[1]
        assert log_prob.item() == pytest.approx(float(decision.replay[2]), abs=1e-4)
        assert forbidden.exp() == 0
        assert 0 <= entropy.item() <= np.log(2) + 1e-6


@pytest.mark.parametrize("name", ["DQN", "QR-DQN"])
def test_targets_are_values_of_allowed_actions(name: str) -> None:
    policy = built(make_spec(name, action_masks=True)).policy
    network = policy.q_net_target if name == "DQN" else policy.quantile_net_target
    obs = th.tensor(np.stack(some(make_spec(name).observations(), 6)))
    allowed = th.tensor([[1, 0, 1]] * 6, dtype=th.int8)
    with th.no_grad():
        plain, masked = network(obs), network({"_observation": obs, "action_mask": allowed})
    assert (masked[..., 1] == FORBIDDEN).all()
    assert th.equal(masked[..., [0, 2]], plain[..., [0, 2]])


def test_critics_of_bdpi_look_ahead_to_allowed_actions() -> None:
    ahead = th.tensor([[[1.0, 9.0, 2.0]]])
    values = iter([ahead, ahead, th.zeros(1, 1, 3)])
    nothing, allowed = th.zeros(1, 1, 1), th.tensor([[[1, 0, 1]]])
    batches = Batches(nothing, th.zeros(1, 1, 1).long(), nothing, nothing, th.ones(1, 1, 1), next_allowed=allowed)
    network: Any = lambda _: next(values)  # noqa: E731
    assert critic_targets(network, network, batches, alpha=1.0)[0, 0, 0] == 2.0


@pytest.mark.parametrize("name", MASKED)
def test_it_learns_from_what_was_allowed_and_evaluates_within_the_mask(name: str, tmp_path: Any) -> None:
    with Station(tmp_path, agent=make_spec(name, action_masks=True)) as station:
        play(station)
        assert station.worker.failure is None
        mask = np.array([False, False, True])
        station.worker.set_learning(False)
        action, _ = station.worker.actor.exploit(station.worker.show(station.somewhere(), mask), None, mask)
        assert action == 2


def play(station: Station, steps: int = 120) -> None:
    """Masks that change at each step; every tenth step ends the episode, by termination and truncation in turn."""
    for number in range(steps):
        mask = [(number + action) % 3 != 0 for action in range(3)]
        ends = number % 10 == 9
        cut = ends and number % 20 == 9
        reply = station.step(reward=1.0, terminated=ends and not cut, truncated=cut, mask=mask)
        assert ends or mask[reply["action"]]


def test_a_frozen_seed_builds_the_same_network_with_and_without_masks() -> None:
    for name in MASKED:
        plain, masked = make_spec(name), make_spec(name, action_masks=True)
        one, other = (build(spec, environment(spec), 5).policy.state_dict() for spec in (plain, masked))
        assert one.keys() <= other.keys()
        assert all(th.equal(one[key], other[key]) for key in one)


def test_a_mask_of_a_batch_broadcasts() -> None:
    logits = np.zeros((2, 3), np.float32)
    assert mask_logits(logits, np.array([[1, 0, 1], [1, 1, 0]]))[[0, 1], [1, 2]].tolist() == [FORBIDDEN, FORBIDDEN]
