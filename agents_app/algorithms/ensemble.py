"""Many small networks of one shape, trained at once: their weights are stacked, and one Adam moves them all.

Each network learns as it would alone: Adam treats every number by itself, so Adam on the stack is Adam on each network. The
gradients are written out, and computed in NumPy on the memory of the tensors: for networks as small as these its products and
its calls take half the time of torch's, and autograd would double it again. As many members are taken at a time as the
processor's cache holds. `benchmarks/bdpi.py` has the figures, `tests/algorithms/test_bdpi.py` compares with plain torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch as th
from torch import nn

tanh_backward = th.ops.aten.tanh_backward.grad_input
CACHE = 2**20  # bytes of hidden layers at a time, which stay in the second-level cache of most processors


class StackedAdam(th.optim.Adam):
    """Adam, in one kernel for all parameters, of all members or of some."""

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        lr: float,
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-8,
        weight_decay: float = 0.0,
    ) -> None:
        super().__init__(parameters, lr, betas, eps, weight_decay, fused=True)

    def make_step(self, members: slice, gradients: list[th.Tensor]) -> Callable[[], None]:
        """`step` of these members for a while, with whatever the gradients are then; call `count` at the end.

        The ordinary one gathers its lists anew each time, which for a small network takes longer than all the rest.
        """
        (group,) = self.param_groups
        states = [self.state[parameter] or self._begin(parameter) for parameter in group["params"]]
        parameters = [parameter.detach()[members] for parameter in group["params"]]
        means, squares = ([state[name][members] for state in states] for name in ("exp_avg", "exp_avg_sq"))
        taken = states[0]["step"].clone()
        counts, names = [taken] * len(states), ("lr", "eps", "weight_decay", "amsgrad", "maximize")
        settings: dict[str, Any] = {name: group[name] for name in names}
        settings["beta1"], settings["beta2"] = group["betas"]

        def step() -> None:
            taken.add_(1)
            th._fused_adam_(parameters, gradients, means, squares, [], counts, **settings)

        return step

    def count(self, steps: int) -> None:
        """All members have made so many."""
        for state in self.state.values():
            state["step"] += steps

    def _begin(self, parameter: nn.Parameter) -> dict[str, th.Tensor]:
        """As `step` begins."""
        self.state[parameter] = {
            "step": th.zeros((), dtype=th.float32),
            "exp_avg": th.zeros_like(parameter),
            "exp_avg_sq": th.zeros_like(parameter),
        }
        return self.state[parameter]


class Ensemble(nn.Module):
    """N multilayer perceptrons with tanh. Their outputs are values, or with `softmax` the logits of probabilities.

    A layer is (N, I + 1, O): its last row is the bias, the weight of an input that is always 1.
    """

    optimizer: StackedAdam

    def __init__(self, members: int, sizes: Sequence[int], lookup: bool = False, softmax: bool = False) -> None:
        """`sizes`: of the input, the hidden layers and the output; `lookup`: inputs are whole numbers, (N, B)."""
        super().__init__()
        self.layers = nn.ParameterList(_begin(members, *pair) for pair in pairwise(sizes))
        if lookup:
            _begin_table(self.layers[0])
        self.sizes, self.lookup, self.softmax = list(sizes), lookup, softmax

    @th.no_grad()
    def forward(self, x: th.Tensor) -> th.Tensor:
        """Values or logits, (N, B, A); no gradient comes back through them."""
        outputs = [_Part(self, x, members).forward().mT for members in self._parts(x)]
        return th.from_numpy(np.concatenate(outputs)).mT

    @th.no_grad()
    def fit(self, x: th.Tensor, target: th.Tensor, steps: int) -> None:
        """Gradient steps on each network's mean squared distance, over (B, A), of its values or probabilities to `target`."""
        for members in self._parts(x):
            part = _Part(self, x, members)
            wanted, step = _turned(target[members].numpy()), self.optimizer.make_step(members, part.gradients)
            for _ in range(steps):
                part.set_gradients(wanted)
                step()
        self.optimizer.count(steps)

    @th.no_grad()
    def gradients(self, x: th.Tensor, target: th.Tensor) -> list[th.Tensor]:
        """Of that distance, one tensor for each layer."""
        part = _Part(self, x, slice(None))
        part.set_gradients(_turned(target.numpy()))
        return part.gradients

    def _parts(self, x: th.Tensor) -> Iterator[slice]:
        """The members, a few at a time."""
        size = 2 * x.shape[1] * max(self.sizes[1:]) * self.layers[0].element_size()
        few = max(1, CACHE // size)
        return (slice(first, first + few) for first in range(0, len(x), few))


class _Part:
    """Some members at work, on a batch each. What is turned lies in memory as (n, A, B), of which NumPy is fonder."""

    def __init__(self, ensemble: Ensemble, x: th.Tensor, members: slice) -> None:
        self._layers = [layer.detach()[members].numpy() for layer in ensemble.layers]
        *wide, last = ((len(layer), x.shape[1], layer.shape[2]) for layer in self._layers)
        kind = self._layers[0].dtype
        self._outs = [*(np.empty(shape, kind) for shape in wide), _turned(np.empty(last, kind))]
        self._slopes = [np.empty(shape, kind) for shape in wide]
        self._gradients = [np.zeros_like(layer) for layer in self._layers]
        self.gradients = [th.from_numpy(gradient) for gradient in self._gradients]
        self._first = (_Lookup if ensemble.lookup else _Dense)(x[members].numpy(), self._layers[0], self._gradients[0])
        self._softmax = ensemble.softmax

    def forward(self) -> np.ndarray:
        """Values or logits, (n, B, A), turned; the other outputs stay at hand, as tanh leaves them."""
        self._first.forward(self._outs[0])
        for layer, x, out in zip(self._layers[1:], self._outs, self._outs[1:], strict=False):
            _multiply(np.tanh(x, out=x), layer[:, :-1], out)
            out += layer[:, -1:]
        return self._outs[-1]

    def set_gradients(self, target: np.ndarray) -> None:
        """`target`: (n, B, A), turned."""
        slope = self._slope_of_output(self.forward(), target)
        for depth in range(len(self._layers) - 1, 0, -1):
            x, gradient = self._outs[depth - 1], self._gradients[depth]
            np.matmul(x.mT, slope, out=gradient[:, :-1])
            np.sum(slope, axis=1, out=gradient[:, -1])
            slope = self._slope_before(depth, slope)
        self._first.set_gradient(slope)

    def _slope_before(self, depth: int, slope: np.ndarray) -> np.ndarray:
        """From the slope of the loss in a layer's output to that in the output of the layer before, through tanh."""
        out, x = self._slopes[depth - 1], self._outs[depth - 1]
        np.matmul(slope, np.ascontiguousarray(self._layers[depth][:, :-1].mT), out=out)
        in_place = th.from_numpy(out)
        tanh_backward(in_place, th.from_numpy(x), grad_input=in_place)
        return out

    def _slope_of_output(self, output: np.ndarray, target: np.ndarray) -> np.ndarray:
        scale = 2.0 / (output.shape[1] * output.shape[2])
        if not self._softmax:
            return (output - target) * scale
        found = np.exp(output - output.max(-1, keepdims=True))
        found /= found.sum(-1, keepdims=True)
        pull = found * (found - target)
        return (pull - found * pull.sum(-1, keepdims=True)) * scale


class _Dense:
    """The first layer, of vectors: a column of ones beside them multiplies the bias."""

    def __init__(self, x: np.ndarray, weights: np.ndarray, gradient: np.ndarray) -> None:
        self._x = np.concatenate([x, np.ones_like(x[..., :1])], -1)
        self._weights, self._gradient = weights, gradient

    def forward(self, out: np.ndarray) -> None:
        _multiply(self._x, self._weights, out)

    def set_gradient(self, slope: np.ndarray) -> None:
        np.matmul(self._x.mT, slope, out=self._gradient)


class _Lookup:
    """The first layer, of whole numbers: they look up their rows, as one-hot vectors would. The bias stays as it is."""

    def __init__(self, x: np.ndarray, weights: np.ndarray, gradient: np.ndarray) -> None:
        members, height, _ = weights.shape
        self._rows = (x + height * np.arange(members)[:, None]).reshape(-1)
        self._weights, self._gradient = weights, gradient

    def forward(self, out: np.ndarray) -> None:
        table = self._weights.reshape(-1, self._weights.shape[2])
        np.take(table, self._rows, axis=0, out=out.reshape(-1, out.shape[2]), mode="clip")
        out += self._weights[:, -1:]

    def set_gradient(self, slope: np.ndarray) -> None:
        table, rows = th.from_numpy(self._gradient).flatten(0, 1), th.from_numpy(self._rows)
        table.index_fill_(0, rows, 0.0).index_add_(0, rows, th.from_numpy(slope).flatten(0, 1))


def probabilities(logits: th.Tensor) -> th.Tensor:
    """The softmax over the actions, (N, B, A). Of few actions, ten times as fast this way round."""
    return logits.mT.softmax(1).mT


def _begin(members: int, inputs: int, outputs: int) -> nn.Parameter:
    """A layer's weights and bias, (N, I + 1, O), as torch's own Linear begins."""
    bound = inputs**-0.5
    return nn.Parameter(th.empty(members, inputs + 1, outputs).uniform_(-bound, bound))


@th.no_grad()
def _begin_table(layer: th.Tensor) -> None:
    """Rows to look up begin as if of one input, since one of them counts at a time; and without a bias, which would move all of
    them together, so that what was never tried would look as bad as what was (docs/adr/0015).
    """
    nn.init.uniform_(layer, -1.0, 1.0)[:, -1] = 0.0


def _multiply(x: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    """x @ weights, whichever way round the output lies."""
    if out.flags.c_contiguous:
        np.matmul(x, weights, out=out)
    else:
        np.matmul(np.ascontiguousarray(weights.mT), x.mT, out=out.mT)


def _turned(array: np.ndarray) -> np.ndarray:
    """The same numbers, (n, B, A), that lie in memory as (n, A, B)."""
    return np.ascontiguousarray(array.mT).mT
