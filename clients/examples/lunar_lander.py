"""Lunar Lander, in one call: `run` plays whole Gymnasium environments under a progress bar.

    pip install './clients/python[gym]' 'gymnasium[box2d]'
    shepherd-client --env LunarLander-v3 --describe          # the spaces, as create_agent wants them
    python manage.py create_agent --owner me --name "Lunar Lander" --algorithm PPO --action-space 4 \\
        --observation-space '[[8], -10, 10]' --parameter gamma=0.999 --parameter gae_lambda=0.98
    SHEPHERD_API_KEY=sk_... python clients/examples/lunar_lander.py [episodes]

Start it several times at once: the agent's executions then advise each other. SHEPHERD_URL says where Shepherd is, if
not at http://127.0.0.1:8000.
"""

import os
import sys

import gymnasium
from shepherd_client import DEFAULT_URL, run


def main() -> None:
    """Train for a number of episodes, and say how well the last ones went."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    env = gymnasium.make("LunarLander-v3")
    returns = run(
        env, os.environ["SHEPHERD_API_KEY"], episodes=episodes, url=os.environ.get("SHEPHERD_URL", DEFAULT_URL)
    )
    recent = returns[-100:]
    print(f"mean return of the last {len(recent)} episodes: {sum(recent) / len(recent):.1f}")


if __name__ == "__main__":
    main()
