"""How BDPI moves its critics (eq. 2.3), and what its actor moves towards when it knows of the advice (eq. 3.4, eq. 6.1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents_app.algorithms.bdpi import Batches, as_intersected, correct_intersection, correct_reuse, critic_targets

N, PSI = 4, 0.3
Correct = Callable[[th.Tensor, th.Tensor, th.Tensor], th.Tensor]
ACTIONS = st.integers(0, N - 1)
SHARES = st.floats(0, 1)
EVERY = pytest.mark.parametrize(
    "correct",
    [
        correct_intersection,
        lambda greedy, own, advice: correct_reuse(greedy, advice, PSI),
        lambda greedy, own, advice: correct_intersection(greedy, own, as_intersected(advice, 2.0)),
    ],
    ids=["intersection", "reuse", "geometric"],
)


@st.composite
def distributions(draw: st.DrawFn, smallest: float = 1e-30) -> th.Tensor:
    """(1, N), from nearly an order to nearly even."""
    logs = draw(arrays(np.float64, N, elements=st.floats(float(np.log(smallest)), 0)))
    return th.tensor(np.exp(logs) / np.exp(logs).sum())[None]


def only(action: int) -> th.Tensor:
    """The greedy policy of a critic, (1, N)."""
    return th.nn.functional.one_hot(th.tensor([action]), N).double()


class TestTheActor:
    @given(ACTIONS, distributions(), distributions(1e-3))
    def test_towards_what_the_intersection_makes_of_it(self, action: int, own: th.Tensor, advice: th.Tensor) -> None:
        """Eq. 3.4: times the advice, it is what the mixed policy would be before it is brought to a sum of one."""
        target = correct_intersection(only(action), own, advice)
        th.testing.assert_close(target * advice, only(action) * (own * advice).sum(), rtol=1e-5, atol=1e-8)

    @given(ACTIONS, distributions(), st.floats(0, 0.99))
    def test_towards_what_reuse_makes_of_it(self, action: int, advice: th.Tensor, psi: float) -> None:
        """Eq. 6.1 undoes eq. 2.5: mixed with the advice again, the target is the greedy policy."""
        target = correct_reuse(only(action), advice, psi)
        th.testing.assert_close((1 - psi) * target + psi * advice, only(action))
        assert float(target.sum()) == pytest.approx(1)

    @EVERY
    @given(ACTIONS, distributions())
    def test_advice_that_says_nothing_changes_nothing_to_the_bit(
        self, correct: Correct, action: int, own: th.Tensor
    ) -> None:
        assert th.equal(correct(only(action), own, th.ones_like(own)), only(action))

    def test_so_it_is_with_many_actions(self) -> None:
        """Where a power of even advice underflows, had it not been brought to 1."""
        own, greedy, nothing = th.full((1, 200), 0.005), th.nn.functional.one_hot(th.tensor([7]), 200), th.ones(1, 200)
        assert th.equal(correct_intersection(greedy, own, as_intersected(nothing, 2.0)), greedy.float())

    @EVERY
    @given(st.lists(st.tuples(ACTIONS, distributions(), distributions()), min_size=1, max_size=6))
    def test_a_batch_is_its_states(self, correct: Correct, states: list[tuple[int, th.Tensor, th.Tensor]]) -> None:
        each = [correct(only(action), own, advice) for action, own, advice in states]
        actions, owns, advice = zip(*states, strict=True)
        together = correct(th.cat(list(map(only, actions))), th.cat(owns), th.cat(advice))
        assert th.equal(together, th.cat(each))

    @EVERY
    @given(ACTIONS, distributions(), st.one_of(distributions(), ACTIONS.map(only)))
    def test_it_stays_finite_and_prefers_what_the_critic_does(
        self, correct: Correct, action: int, own: th.Tensor, advice: th.Tensor
    ) -> None:
        """Also where the advice is an order: the target goes to 0 or 1 (bdpi.py clips it), never to nonsense."""
        target = correct(only(action), own, advice)
        assert target.isfinite().all()
        assert target[0, action] >= 0
        assert (target[0, [it for it in range(N) if it != action]] <= 0).all()


@st.composite
def transitions(draw: st.DrawFn) -> tuple[th.Tensor, th.Tensor, Batches]:
    """Values of both Q-functions at states, which are numbered, and transitions between them: 3 critics, 5 steps, 2 states."""
    values = st.floats(-1e6, 1e6)
    one, other = (th.tensor(draw(arrays(np.float64, (3, 2, N), elements=values))) for _ in range(2))
    states, after = (th.tensor(draw(arrays(np.int64, (3, 5), elements=st.integers(0, 1)))) for _ in range(2))
    actions = th.tensor(draw(arrays(np.int64, (3, 5, 1), elements=ACTIONS)))
    rewards = th.tensor(draw(arrays(np.float64, (3, 5, 1), elements=values)))
    discounts = th.tensor(draw(arrays(np.float64, (3, 5, 1), elements=SHARES)))
    return one, other, Batches(states, actions, rewards, after, discounts)


def table(values: th.Tensor) -> Any:
    """A Q-function that looks values up, (critics, states, N)."""
    critics = th.arange(len(values))[:, None]
    return lambda states: values[critics, states]


class TestTheCritics:
    @given(transitions(), st.floats(1e-6, 1))
    def test_they_move_as_equation_2_3_says(self, drawn: tuple[th.Tensor, th.Tensor, Batches], alpha: float) -> None:
        one, other, batches = drawn
        targets = critic_targets(table(one), table(other), batches, alpha)
        for critic, step in np.ndindex(3, 5):
            state, after, action = (
                int(it[critic, step]) for it in (batches.inputs, batches.next_inputs, batches.actions)
            )
            best = int(one[critic, after].argmax())
            value = min(float(one[critic, after, best]), float(other[critic, after, best]))
            wanted = float(batches.rewards[critic, step]) + float(batches.discounts[critic, step]) * value
            expected = one[critic, state].clone()
            expected[action] += alpha * (wanted - expected[action])
            th.testing.assert_close(targets[critic, step], expected)
            others = [it for it in range(N) if it != action]
            assert th.equal(targets[critic, step, others], one[critic, state, others])

    @given(transitions(), st.integers(0, 2))
    def test_each_moves_as_if_it_were_alone(self, drawn: tuple[th.Tensor, th.Tensor, Batches], critic: int) -> None:
        one, other, batches = drawn
        together = critic_targets(table(one), table(other), batches, 0.5)
        own, theirs = table(one[critic : critic + 1]), table(other[critic : critic + 1])
        assert th.equal(together[critic : critic + 1], critic_targets(own, theirs, batches.of(critic), 0.5))


# --- fixed examples ---
def test_eq_3_4_is_what_the_thesis_says() -> None:
    own, advice = th.tensor([[0.5, 0.3, 0.2]]), th.tensor([[0.2, 0.7, 0.1]])
    greedy = th.tensor([[0.0, 0.0, 1.0]])
    expected = greedy * (own * advice).sum() / (advice + 1e-9)
    th.testing.assert_close(correct_intersection(greedy, own, advice), expected)


def test_eq_3_4_pulls_harder_the_more_the_advice_opposes() -> None:
    own, greedy = th.full((1, 3), 1 / 3), th.tensor([[1.0, 0.0, 0.0]])
    pulls = [correct_intersection(greedy, own, th.tensor([[p, 1 - p, 0.0]]))[0, 0].item() for p in (0.9, 0.5, 0.1)]
    assert pulls == sorted(pulls) and pulls[0] < 1 < pulls[2]


def test_the_geometric_mean_is_corrected_as_the_intersection_with_the_advice_that_prefers_the_same() -> None:
    own, advice = th.tensor([[0.5, 0.3, 0.2]]), th.tensor([[0.2, 0.7, 0.1]])
    th.testing.assert_close(as_intersected(advice, 1.0), advice / 0.7)
    mean, product = own**0.2 * advice**0.8, own * as_intersected(2 * advice, 2.0)  # of two advisors, weight 2 each
    th.testing.assert_close(mean / mean.sum(), product**0.2 / (product**0.2).sum())
    greedy = th.tensor([[0.0, 1.0, 0.0]])
    assert th.equal(correct_intersection(greedy, own, as_intersected(th.ones(1, 3), 2.0)), greedy)


def test_eq_6_1_is_what_the_thesis_says() -> None:
    greedy, advice = th.tensor([[0.0, 1.0]]), th.tensor([[0.75, 0.25]])
    th.testing.assert_close(correct_reuse(greedy, advice, 0.2), th.tensor([[-0.15 / 0.8, 0.95 / 0.8]]))
