"""Run by test_export.py with `python -I`, far from Shepherd: loads models with stock classes, and prints what they do.

With an argument, Shepherd's folder, it loads those of Shepherd's own classes, and sees that they need nothing of the server.

Reads JSON: a list of {"class": "module:name", "path", "observations"}. Writes JSON: for each, the greedy actions, and the
probabilities of all actions where the policy has any.
"""

import json
import sys
from importlib import import_module
from importlib.util import find_spec

import numpy as np


def as_array(value):
    """An observation again."""
    if isinstance(value, dict) and "dtype" not in value:
        return {key: as_array(part) for key, part in value.items()}
    return np.array(value["data"], value["dtype"])


def probabilities(model, observations):
    """Of each action, by the policy's own distribution; None for policies that have none."""
    if not hasattr(model.policy, "get_distribution") or "Recurrent" in type(model.policy).__name__:
        return None
    given = [model.policy.get_distribution(model.policy.obs_to_tensor(obs)[0]).distribution for obs in observations]
    return [d.probs[0].tolist() if hasattr(d, "probs") else [d.mean[0].tolist(), d.stddev[0].tolist()] for d in given]


def main():
    """Load them all."""
    assert find_spec("agents_app") is None and find_spec("envs_app") is None, "Shepherd can be imported here"
    sys.path += sys.argv[1:]
    results = []
    for job in json.load(sys.stdin):
        module, name = job["class"].split(":")
        model = getattr(import_module(module), name).load(job["path"], device="cpu")
        observations = [as_array(value) for value in job["observations"]]
        actions = [model.predict(obs, deterministic=True)[0].tolist() for obs in observations]
        facts = {"steps": model.num_timesteps, "updates": model._n_updates, "policy": type(model.policy).__name__}
        results.append({"actions": actions, "probabilities": probabilities(model, observations), **facts})
    assert not {"django", "envs_app"} & sys.modules.keys(), "the server was imported"
    json.dump(results, sys.stdout)


main()
