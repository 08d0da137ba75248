"""A thermostat that learns from a person's thumbs: type + or - and Enter when you like or dislike the temperature.

    pip install './clients/python[gym]' ./clients/environments
    python manage.py create_agent --owner me --name Thermostat --algorithm PPO --action-space 3 \\
        --observation-space '[[4], -5, 5]' --parameter n_steps=256
    SHEPHERD_API_KEY=sk_... python clients/examples/thermostat.py [--simulate] [--days N] [--seconds S]

One step of five minutes takes S seconds, so that a day takes 5 minutes with the default of 1. `--simulate` puts a
simulated person in your place, who likes 20 to 22 °C, and does not wait. SHEPHERD_URL says where Shepherd is, if not at
http://127.0.0.1:8000.
"""

import argparse
import os
import sys
import threading
import time

import gymnasium
from shepherd_client import DEFAULT_URL, Client, Session

HEATER = ("off", "half", "full")


class KeyboardPerson:
    """The thumbs that were typed since they were last asked for."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._thumbs = 0.0
        threading.Thread(target=self._listen, daemon=True).start()

    def thumb(self, temperature: float) -> float:
        """The sum of the thumbs; they are asked for once."""
        with self._lock:
            thumbs, self._thumbs = self._thumbs, 0.0
        return thumbs

    def _listen(self) -> None:
        for line in sys.stdin:
            with self._lock:
                self._thumbs += line.count("+") - line.count("-")


def play_day(env: gymnasium.Env, session: Session, seconds: float, shown: bool) -> float:
    """One episode; returns the sum of its rewards."""
    obs, _ = env.reset()
    while True:
        action = session.act(obs)
        time.sleep(seconds)
        obs, reward, terminated, truncated, info = env.step(action)
        if shown:
            print(f"{info['temperature']:.1f} °C inside, {info['outside']:.1f} °C outside, heater {HEATER[action]}")
        total = session.observe(obs, float(reward), terminated, truncated)
        if total is not None:
            return total


def main() -> None:
    """Heat for a number of days."""
    parser = argparse.ArgumentParser(description="A thermostat that learns from thumbs up (+) and down (-).")
    parser.add_argument("--simulate", action="store_true", help="a simulated person instead of your keyboard")
    parser.add_argument("--days", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=1.0, help="per step of five minutes (default %(default)s)")
    options = parser.parse_args()
    person = None if options.simulate else KeyboardPerson()
    env = gymnasium.make("shepherd_environments:Thermostat-v0", person=person)
    with Client(os.environ["SHEPHERD_API_KEY"], os.environ.get("SHEPHERD_URL", DEFAULT_URL)) as client:
        session = client.session()
        for day in range(1, options.days + 1):
            total = play_day(env, session, 0.0 if options.simulate else options.seconds, not options.simulate)
            print(f"day {day}: return {total:.1f}")


if __name__ == "__main__":
    main()
