"""PyTorch's compiler is not loaded where nobody compiles, and works where somebody does."""

from __future__ import annotations

import subprocess
import sys

TRAINED = """
import sys, gymnasium, torch, stable_baselines3
from agents_app.algorithms import eager
eager.sleep()
stable_baselines3.PPO("MlpPolicy", gymnasium.make("CartPole-v1"), n_steps=16, batch_size=16).learn(16)
assert not any(name.startswith("torch._dynamo.") for name in sys.modules)
"""
COMPILED = """
frames = []
def backend(graph, inputs):
    frames.append(graph)
    return graph.forward
double = torch.compile(lambda x: 2 * x, backend=backend)
assert double(torch.ones(2)).tolist() == [2, 2] and len(frames) == 1
model = torch.nn.Linear(1, 1)
optimiser = torch.optim.Adam(model.parameters())
model(torch.ones(1)).backward()
optimiser.step()
"""


def test_learning_leaves_the_compiler_asleep_and_whoever_compiles_wakes_it():
    done = subprocess.run([sys.executable, "-c", TRAINED + COMPILED], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
