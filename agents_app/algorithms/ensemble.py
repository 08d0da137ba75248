"""Many small networks of one shape, trained at once: their weights are stacked, and one Adam moves them all.

Each network learns as it would alone: Adam treats every number by itself, so Adam on the stack is Adam on each network. The
gradients are written out, which for these networks is half the time of autograd, and the products are taken in the order
that the CPU likes: `benchmarks/bdpi.py` has the figures, `tests/algorithms/test_bdpi.py` compares with plain torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch as th
from torch import nn
from torch.optim.adam import adam

Memory = tuple[list[th.Tensor], list[th.Tensor]]


class StackedLinear(nn.Module):
    """N linear layers: (N, B, I) -> (N, B, O). Begins as torch's own Linear does."""

    def __init__(self, members: int, inputs: int, outputs: int) -> None:
        super().__init__()
        bound = inputs**-0.5
        self.weight = nn.Parameter(th.empty(members, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(th.empty(members, 1, outputs).uniform_(-bound, bound))
        self.narrow = outputs < inputs  # a product with few columns is several times faster as its transpose

    def forward(self, x: th.Tensor, out: th.Tensor | None = None) -> th.Tensor:
        """What the layers say; in the memory of `out`, if it is given."""
        if self.narrow:
            return th.baddbmm(self.bias.mT, self.weight.mT, x.mT, out=None if out is None else out.mT).mT
        return th.baddbmm(self.bias, x, self.weight, out=out)

    def set_gradients(self, x: th.Tensor, slope: th.Tensor) -> None:
        """From the input, (N, B, I), and the slope of the loss in the output, (N, B, O)."""
        self.weight.grad = th.bmm(slope.mT, x).mT.contiguous() if self.narrow else th.bmm(x.mT, slope)
        self.bias.grad = slope.sum(1, keepdim=True)

    def slope_of_input(self, slope: th.Tensor, out: th.Tensor) -> th.Tensor:
        """The slope of the loss in the input, (N, B, I)."""
        return th.bmm(slope, self.weight.mT, out=out)


class StackedLookup(StackedLinear):
    """The same for inputs of which one is 1 and the others are 0: whole numbers, (N, B), look up their rows."""

    offsets: th.Tensor  # (N, 1): where the rows of each layer begin

    def __init__(self, members: int, inputs: int, outputs: int) -> None:
        super().__init__(members, inputs, outputs)
        self.register_buffer("offsets", th.arange(0, members * inputs, inputs)[:, None], persistent=False)

    def forward(self, x: th.Tensor, out: th.Tensor | None = None) -> th.Tensor:
        """What the layers say; in the memory of `out`, if it is given."""
        rows = None if out is None else out.flatten(0, 1)
        found = th.index_select(self.weight.flatten(0, 1), 0, (x + self.offsets).flatten(), out=rows)
        return found.view(*x.shape, -1).add_(self.bias)

    def set_gradients(self, x: th.Tensor, slope: th.Tensor) -> None:
        """From the input, (N, B), and the slope of the loss in the output, (N, B, O)."""
        gradient = th.empty_like(self.weight) if self.weight.grad is None else self.weight.grad
        gradient.zero_().flatten(0, 1).index_add_(0, (x + self.offsets).flatten(), slope.flatten(0, 1))
        self.weight.grad = gradient
        self.bias.grad = slope.sum(1, keepdim=True)


class StackedAdam(th.optim.Adam):
    """Adam, in one kernel for all parameters."""

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        lr: float,
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-8,
        weight_decay: float = 0.0,
    ) -> None:
        super().__init__(parameters, lr, betas, eps, weight_decay, fused=True)

    def make_step(self) -> Callable[[], None]:
        """`step` for a while, as long as neither the settings nor the state are replaced from outside.

        The ordinary one gathers its lists anew each time, which for a small network takes longer than all the rest.
        """
        (group,) = self.param_groups
        parameters = group["params"]
        states = [self.state[parameter] or self._begin(parameter) for parameter in parameters]
        means, squares, counts = ([state[name] for state in states] for name in ("exp_avg", "exp_avg_sq", "step"))
        settings: dict[str, Any] = {
            name: group[name] for name in ("lr", "eps", "weight_decay", "amsgrad", "maximize", "fused")
        }
        settings["beta1"], settings["beta2"] = group["betas"]
        return lambda: adam(
            parameters, [parameter.grad for parameter in parameters], means, squares, [], counts, **settings
        )

    def _begin(self, parameter: nn.Parameter) -> dict[str, th.Tensor]:
        """As `step` begins."""
        self.state[parameter] = {
            "step": th.zeros((), dtype=th.float32, device=parameter.device),
            "exp_avg": th.zeros_like(parameter),
            "exp_avg_sq": th.zeros_like(parameter),
        }
        return self.state[parameter]


class Ensemble(nn.Module):
    """N multilayer perceptrons with tanh. Their outputs are values, or with `softmax` the logits of probabilities."""

    optimizer: StackedAdam

    def __init__(self, members: int, sizes: Sequence[int], lookup: bool = False, softmax: bool = False) -> None:
        """`sizes`: of the input, the hidden layers and the output; `lookup`: inputs are whole numbers, (N, B)."""
        super().__init__()
        first = StackedLookup if lookup else StackedLinear
        kinds = [first] + [StackedLinear] * (len(sizes) - 2)
        self.layers = nn.ModuleList(kind(members, *pair) for kind, pair in zip(kinds, pairwise(sizes), strict=True))
        self.softmax = softmax

    def forward(self, x: th.Tensor) -> th.Tensor:
        """Values or logits, (N, B, A)."""
        return self._pass(x)[-1]

    @th.no_grad()
    def fit(self, x: th.Tensor, target: th.Tensor, steps: int) -> None:
        """Gradient steps on each network's mean squared distance, over (B, A), of its values or probabilities to `target`."""
        memory, step = self._memory(x), self.optimizer.make_step()
        for _ in range(steps):
            self.set_gradients(x, target, memory)
            step()

    def set_gradients(self, x: th.Tensor, target: th.Tensor, memory: Memory | None = None) -> None:
        """Of that distance."""
        outs, slopes = memory or self._memory(x)
        *inputs, output = self._pass(x, outs)
        slope = self._slope_of_output(output, target)
        for depth, layer in reversed(list(enumerate(self.layers))):
            assert isinstance(layer, StackedLinear)
            layer.set_gradients(inputs[depth], slope)
            if depth:
                slope = layer.slope_of_input(slope, slopes[depth - 1])
                slope = th.ops.aten.tanh_backward(slope, inputs[depth], grad_input=slope)

    def _pass(self, x: th.Tensor, outs: Sequence[th.Tensor | None] | None = None) -> list[th.Tensor]:
        """The input of every layer, then the output."""
        passed = [x]
        for layer, out in zip(self.layers[:-1], outs or [None] * (len(self.layers) - 1), strict=True):
            passed.append(_tanh(layer(passed[-1], out)))
        return [*passed, self.layers[-1](passed[-1])]

    def _slope_of_output(self, output: th.Tensor, target: th.Tensor) -> th.Tensor:
        scale = 2.0 / (output.shape[1] * output.shape[2])
        if not self.softmax:
            return (output - target) * scale
        found = probabilities(output)
        return th.ops.aten._softmax_backward_data(((found - target) * scale).mT, found.mT, 1, found.dtype).mT

    def _memory(self, x: th.Tensor) -> Memory:
        """For the outputs of the hidden layers and the slopes in them; to allocate it can take longer than the step."""
        biases: list[th.Tensor] = [layer.bias for layer in self.layers[:-1]]  # type: ignore[misc]
        outs, slopes = ([bias.new_empty((len(bias), x.shape[1], bias.shape[2])) for bias in biases] for _ in range(2))
        return outs, slopes


def probabilities(logits: th.Tensor) -> th.Tensor:
    """The softmax over the actions, (N, B, A). Of few actions, ten times as fast this way round."""
    return logits.mT.softmax(1).mT


def _tanh(x: th.Tensor) -> th.Tensor:
    """In place. NumPy's is several times faster than torch's on a CPU."""
    if x.requires_grad or x.device.type != "cpu":
        return x.tanh()
    np.tanh(x.numpy(), out=x.numpy())
    return x
