"""Cart Pole, with a loop of one's own: the parts of a client that any environment needs.

    pip install './clients/python[gym]'
    python manage.py create_agent --owner me --name "Cart Pole" --algorithm PPO --action-space 2 \\
        --observation-space '[[4], -10, 10]'
    SHEPHERD_API_KEY=sk_... python clients/examples/cart_pole.py [episodes]

SHEPHERD_URL says where Shepherd is, if not at http://127.0.0.1:8000.
"""

import os
import sys

import gymnasium
from shepherd_client import DEFAULT_URL, Client, Session


def play_episode(env: gymnasium.Env, session: Session) -> float:
    """Play until the pole falls; returns the sum of the rewards, as the server has it."""
    obs, _ = env.reset()
    while True:
        action = session.act(obs)
        obs, reward, terminated, truncated, _ = env.step(action)
        total = session.observe(obs, float(reward), terminated, truncated)
        if total is not None:
            return total


def main() -> None:
    """Train for a number of episodes."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    env = gymnasium.make("CartPole-v1")
    with Client(os.environ["SHEPHERD_API_KEY"], os.environ.get("SHEPHERD_URL", DEFAULT_URL)) as client:
        session = client.session()
        for episode in range(1, episodes + 1):
            print(f"episode {episode}: {play_episode(env, session):.0f}")


if __name__ == "__main__":
    main()
