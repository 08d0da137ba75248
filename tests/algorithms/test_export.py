"""A model that Shepherd saved loads with the stock class where there is no Shepherd, and does the same."""

from __future__ import annotations

import base64
import io
import json
import pickletools
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms.advice import neutral_advice, with_advice
from agents_app.algorithms.builder import export, family_of, is_advised, restore
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.building import built, some, tensors
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, actions_of, make_spec

SCRIPT = Path(__file__).with_name("load_elsewhere.py")
ROOT = Path(__file__).parents[2]


def specs() -> dict[str, AgentSpec]:
    """Every algorithm with every kind of actions; PPO with every kind of observations, advised too; special ones."""
    chosen = {
        f"{row.name} {'discrete' if actions == DISCRETE else 'continuous'}": make_spec(row.name, actions)
        for row in ROWS
        for actions in actions_of(row)
    }
    for kind, space in OBSERVATIONS.items():
        chosen[f"PPO on {kind}"] = make_spec("PPO", observations=space)
        chosen[f"advised PPO on {kind}"] = make_spec("PPO", observations=space, advice_method="intersection")
    chosen["advised A2C continuous"] = make_spec("A2C", CONTINUOUS, advice_method="intersection")
    chosen["PPO gSDE"] = make_spec("PPO", CONTINUOUS, parameters={"use_sde": True})
    chosen["SAC gSDE"] = make_spec("SAC", CONTINUOUS, parameters={"use_sde": True})
    chosen["PPO, its rate falls"] = make_spec("PPO", parameters={"learning_rate_end": 1e-5})
    chosen["TD3 noise"] = make_spec("TD3", CONTINUOUS, parameters={"action_noise": "ou 0.3"})
    chosen["DQN dict"] = make_spec("DQN", observations=OBSERVATIONS["dict"])
    for row in ROWS:
        if row.advice and row.family == "off_policy":
            chosen[f"advised {row.name}"] = make_spec(row.name, actions_of(row)[0], advice_method="intersection")
    chosen["advised SAC dict"] = make_spec("SAC", CONTINUOUS, OBSERVATIONS["dict"], advice_method="intersection")
    chosen["advised BDPI"] = make_spec("BDPI", advice_method="intersection")
    chosen["advised BDPI dict"] = make_spec("BDPI", observations=OBSERVATIONS["dict"], advice_method="reuse")
    chosen["advised PolicyGradient"] = make_spec("PolicyGradient", CONTINUOUS, advice_method="intersection")
    return chosen


SPECS = specs()
OWN = [name for name, spec in SPECS.items() if get_row(spec.algorithm).path.startswith("agents_app")]
STOCHASTIC = [name for name, spec in SPECS.items() if get_row(spec.algorithm).family in ("on_policy", "maskable")]


def described(value: Any) -> Any:
    """An observation as JSON."""
    if isinstance(value, dict):
        return {key: described(part) for key, part in value.items()}
    return {"data": np.asarray(value).tolist(), "dtype": str(np.asarray(value).dtype)}


class Loaded:
    """All models, exported here and loaded elsewhere, in one process."""

    def __init__(self, folder: Path) -> None:
        self.algorithms = {name: built(spec) for name, spec in SPECS.items()}
        self.paths = {name: folder / f"{name}.zip" for name in SPECS}
        jobs = {name: self.export(name) for name in SPECS}
        own = {name: jobs.pop(name) for name in OWN}
        self.results = load(jobs) | load(own, str(ROOT))

    def export(self, name: str) -> dict[str, Any]:
        """What is to be done elsewhere."""
        algorithm, spec, path = self.algorithms[name], SPECS[name], self.paths[name]
        algorithm.num_timesteps, algorithm._n_updates = 123, 45
        export(algorithm, spec, path)
        observations = [described(obs) for obs in some(spec.observations())]
        return {"class": get_row(spec.algorithm).path, "path": str(path), "observations": observations}


def load(jobs: dict[str, Any], *folders: str) -> dict[str, Any]:
    """What another process says, which can import what is in these folders."""
    command, text = [sys.executable, "-I", str(SCRIPT), *folders], json.dumps(list(jobs.values()))
    done = subprocess.run(command, cwd="/", input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(zip(jobs, json.loads(done.stdout), strict=True))


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Loaded:
    """Exported and loaded once for all tests."""
    return Loaded(tmp_path_factory.mktemp("models"))


@pytest.mark.parametrize("name", SPECS)
class TestElsewhere:
    def test_it_acts_as_the_actor_does(self, name: str, loaded: Loaded) -> None:
        spec = SPECS[name]
        actor = family_of(spec).make_actor(loaded.algorithms[name])
        expected = [np.asarray(actor.exploit(obs, None, None)[0]).tolist() for obs in some(spec.observations())]
        assert np.allclose(loaded.results[name]["actions"], expected, atol=1e-5)

    def test_its_counters_go_along(self, name: str, loaded: Loaded) -> None:
        assert (loaded.results[name]["steps"], loaded.results[name]["updates"]) == (123, 45)

    def test_its_policy_is_a_stock_one(self, name: str, loaded: Loaded) -> None:
        assert not loaded.results[name]["policy"].startswith("Advised")

    def test_the_file_names_nothing_of_shepherd_but_an_algorithm_of_its_own(self, name: str, loaded: Loaded) -> None:
        with zipfile.ZipFile(loaded.paths[name]) as archive:
            data = archive.read("data").decode()
        named = {package for package in ("agents_app", "envs_app") if package in data}
        named |= names_in_pickles(json.loads(data)) & {"agents_app", "envs_app"}
        assert named <= ({"agents_app"} if name in OWN else set())
        assert "tape" not in json.loads(data)
        assert "mixing" not in json.loads(data)["policy_kwargs"]

    def test_an_execution_takes_everything_from_it(self, name: str, loaded: Loaded) -> None:
        other = built(SPECS[name], seed=2)
        with th.no_grad():
            for parameter in other.policy.parameters():
                parameter += 1
        restore(other, loaded.paths[name])
        one = tensors(loaded.algorithms[name].get_parameters())
        assert one
        assert all(map(th.equal, one, tensors(other.get_parameters())))
        if hasattr(other, "log_ent_coef"):
            assert th.equal(other.log_ent_coef, loaded.algorithms[name].log_ent_coef)


@pytest.mark.parametrize("name", STOCHASTIC)
def test_its_probabilities_are_those_of_the_actor(name: str, loaded: Loaded) -> None:
    spec, given = SPECS[name], loaded.results[name]["probabilities"]
    policy = family_of(spec).make_actor(loaded.algorithms[name]).policy
    for obs, numbers in zip(some(spec.observations()), given, strict=True):
        distribution = policy.get_distribution(policy.obs_to_tensor(obs)[0]).distribution
        own = (
            distribution.probs
            if spec.action_space == DISCRETE
            else th.stack([distribution.mean[0], distribution.stddev[0]])
        )
        assert np.allclose(own.detach().numpy().squeeze(), np.squeeze(numbers), atol=1e-6)


class TestRestore:
    def test_its_pickles_are_never_read(self, tmp_path: Path) -> None:
        spec, path = make_spec(), tmp_path / "model.zip"
        saved, other = built(spec), built(spec, 2)
        export(saved, spec, path)
        spoil(path, "data", b"no JSON, and no pickle")
        restore(other, path)
        for ours, theirs in zip(other.policy.parameters(), saved.policy.parameters(), strict=True):
            assert th.equal(ours, theirs)

    def test_another_network_is_refused(self, tmp_path: Path) -> None:
        spec, path = make_spec(), tmp_path / "model.zip"
        export(built(spec), spec, path)
        with pytest.raises(RuntimeError, match="size mismatch"):
            restore(built(make_spec(parameters={"net_arch": "9"})), path)

    def test_advice_settings_may_have_changed(self, tmp_path: Path) -> None:
        plain, path = make_spec(), tmp_path / "model.zip"
        advised = make_spec(advice_method="intersection")
        export(built(plain), plain, path)
        other = built(advised, 2)
        restore(other, path)
        assert is_advised(advised)
        obs = some(plain.observations(), 1)[0]
        other.policy.predict(with_advice(obs, neutral_advice(plain.actions())), deterministic=True)


def spoil(path: Path, member: str, content: bytes) -> None:
    """Replace one file of a ZIP."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (members | {member: content}).items():
            archive.writestr(name, data)


def names_in_pickles(data: dict[str, Any]) -> set[str]:
    """The packages that the pickled attributes of a model refer to."""
    names: set[str] = set()
    for value in data.values():
        if isinstance(value, dict) and ":serialized:" in value:
            stream = io.BytesIO(base64.b64decode(value[":serialized:"]))
            texts = [argument for _, argument, _ in pickletools.genops(stream) if isinstance(argument, str)]
            names |= {text.split(".")[0].split(" ")[0] for text in texts}
    return names
