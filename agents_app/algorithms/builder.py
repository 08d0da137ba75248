"""From an agent's specification to an algorithm, ready to learn from ShepherdEnv, and back to stock Stable-Baselines3."""

from __future__ import annotations

import inspect
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import ActionNoise, NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr, save_to_zip_file
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.utils import parameters_to_vector

from agents_app.algorithms import action_features, advised_off_policy, normalising
from agents_app.algorithms.advice import advised_space
from agents_app.algorithms.advised import AdvisedPolicy
from agents_app.algorithms.masks import masked_space
from agents_app.algorithms.policies import policy_name
from agents_app.algorithms.registry import get_row
from agents_app.algorithms.spec import AgentSpec

ENDLESS = 2**62  # learning has no end; the schedules follow `horizon`
OURS = (
    "horizon",
    "tape",
    "stock_policy",
    "mixing",
    "normaliser",
)  # attributes that stock Stable-Baselines3 does not know


class Paced:
    """Mix into an algorithm class, on the left: schedules follow a horizon, and stay at their end past it."""

    horizon: int
    num_timesteps: int
    _current_progress_remaining: float

    def _update_current_progress_remaining(self, num_timesteps: int, total_timesteps: int) -> None:
        self._current_progress_remaining = max(0.0, 1.0 - num_timesteps / self.horizon)


def family_of(spec: AgentSpec) -> ModuleType:
    """The module that teaches executions to act with this algorithm and to replay its records."""
    return import_module(f"agents_app.algorithms.{get_row(spec.algorithm).family}")


def is_advised(spec: AgentSpec) -> bool:
    """Whether observations carry advice."""
    return spec.advice_method != "none" and get_row(spec.algorithm).advice


def is_averaged(spec: AgentSpec) -> bool:
    """Whether an execution goes on from the mean of all after each update."""
    return spec.averaging and get_row(spec.algorithm).averages


def is_masked(spec: AgentSpec) -> bool:
    """Whether observations carry a mask. MaskablePPO has a way of its own."""
    row = get_row(spec.algorithm)
    return spec.action_masks and row.masks and row.family != "maskable"


def has_features(spec: AgentSpec) -> bool:
    """Whether the networks score actions by their features."""
    return bool(spec.action_features) and get_row(spec.algorithm).scores


def seen_space(spec: AgentSpec) -> gym.Space:
    """The observation space that the algorithm is built on: with what rides in the observations."""
    space = spec.observations()
    if is_masked(spec):
        space = masked_space(space, spec.actions())
    return advised_space(space, spec.actions()) if is_advised(spec) else space


def build(spec: AgentSpec, env: gym.Env | VecEnv, seed: int | None) -> Any:
    """The algorithm, on `env`, with fresh weights. Raises ValueError, TypeError or AssertionError for bad parameters."""
    row, family = get_row(spec.algorithm), family_of(spec)
    stock = row.load()
    stock_policy = stock.policy_aliases[policy_name(row, spec.observations(), spec.policy)]
    guided = is_advised(spec) or is_masked(spec)
    classes = _guided(stock, stock_policy) if guided else (stock, stock_policy)
    algorithm_class, policy = family.learner_classes(*classes)
    arguments, horizon = _arguments(spec)
    normaliser = _normaliser(spec, bool(arguments.pop("normalize_observations", False)))
    mixins = (Paced, *_normalising(stock)) if normaliser else (Paced,)
    paced: Any = type(stock.__name__, (*mixins, algorithm_class), {"horizon": horizon})
    arguments["policy_kwargs"] = {**family.POLICY_KWARGS, **arguments.get("policy_kwargs", {})}
    if normaliser:
        arguments["policy_kwargs"] |= normalising.extractor_kwargs(normaliser)
    if is_advised(spec):
        arguments["policy_kwargs"]["mixing"] = spec.mixing()
    algorithm = paced(policy, env, device="cpu", verbose=0, seed=seed, **arguments)
    algorithm.stock_policy = stock_policy
    algorithm.set_logger(Logger(folder=None, output_formats=[]))  # SB3's own leaves a folder behind for each
    if has_features(spec):
        action_features.attach(algorithm, spec.action_features or ())
    if normaliser:
        algorithm.normaliser = normaliser
    return algorithm


def _normaliser(spec: AgentSpec, wanted: bool) -> normalising.Normaliser | None:
    """What brings observations to one scale, if the agent wants it and its algorithm and observations allow it."""
    space = spec.observations()
    if not (wanted and get_row(spec.algorithm).normalises and normalising.can_normalise(space)):
        return None
    return normalising.Normaliser(int(np.prod(space.shape or ())))


def _normalising(stock: type[Any]) -> tuple[type[Any]]:
    """What an algorithm needs for its normaliser to learn."""
    off_policy = issubclass(stock, OffPolicyAlgorithm)
    return (normalising.NormalisesSteps if off_policy else normalising.NormalisesRollouts,)


def _guided(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The algorithm and its policy themselves, where they take advice and masks as they are; else with mixins."""
    if getattr(policy, "takes_advice", False):
        return algorithm, policy
    if issubclass(algorithm, OffPolicyAlgorithm):
        return advised_off_policy.advised_classes(algorithm, policy)
    return algorithm, type(f"Advised{policy.__name__}", (AdvisedPolicy, policy), {})


def _arguments(spec: AgentSpec) -> tuple[dict[str, Any], int]:
    """Constructor arguments, and the horizon of the schedules in steps."""
    given = {name: value for name, value in spec.parameters.items() if name != "seed"}
    horizon = int(given.pop("total_timesteps", 100_000))
    if (end := given.pop("learning_rate_end", None)) is not None:
        given["learning_rate"] = LinearSchedule(_learning_rate(spec), float(end), end_fraction=1.0)
    if layers := str(given.pop("net_arch", "")):
        given["policy_kwargs"] = {"net_arch": [size for size in map(int, layers.replace(",", " ").split()) if size]}
    if "action_noise" in given:
        given["action_noise"] = _noise(str(given["action_noise"]), spec)
    for name in ("ent_coef", "target_entropy"):
        if isinstance(given.get(name), str):
            given[name] = _number_or_text(given[name])
    return given, max(1, horizon)


def _learning_rate(spec: AgentSpec) -> float:
    signature = inspect.signature(get_row(spec.algorithm).load().__init__).parameters
    return float(spec.parameters.get("learning_rate", signature["learning_rate"].default))


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _noise(text: str, spec: AgentSpec) -> ActionNoise | None:
    """Exploration noise from 'normal 0.1' or 'ou 0.1'; the number is its deviation, as a share of half the action range."""
    if not text.strip():
        return None
    kind, _, deviation = text.strip().partition(" ")
    sigma = np.full(spec.actions().shape or (), float(deviation or 0.1), np.float32)
    if kind == "normal":
        return NormalActionNoise(np.zeros_like(sigma), sigma)
    if kind == "ou":
        return OrnsteinUhlenbeckActionNoise(np.zeros_like(sigma), sigma)
    raise ValueError(f"action_noise is {text!r}: write 'normal 0.1', 'ou 0.1' or nothing.")


def export(algorithm: Any, spec: AgentSpec, path: Path | BytesIO) -> None:
    """Write the model as the ZIP that the stock class's own `save` would write.

    No class of Shepherd is needed to load it, but for the algorithms that Stable-Baselines3 does not have.
    """
    data = {key: value for key, value in algorithm.__dict__.items() if key not in OURS}
    state_dicts, variables = algorithm._get_torch_save_params()
    for name in (*algorithm._excluded_save_params(), *(name.split(".")[0] for name in state_dicts + variables)):
        data.pop(name, None)
    normaliser, params = getattr(algorithm, "normaliser", None), algorithm.get_parameters()
    ours = {"mixing", *(normalising.extractor_kwargs(normaliser) if normaliser else ())}
    policy_kwargs = {key: value for key, value in algorithm.policy_kwargs.items() if key not in ours}
    data |= {"policy_class": algorithm.stock_policy, "policy_kwargs": policy_kwargs}
    data |= {"observation_space": spec.observations()}
    if "learning_starts" in spec.parameters:  # an execution that goes on from a save has shifted it
        data["learning_starts"] = spec.parameters["learning_starts"]
    data |= {"_last_obs": None, "_last_original_obs": None, "_last_episode_starts": None}
    for name in ("rollout_buffer_class", "replay_buffer_class"):
        if name in data:
            data[name] = None  # chosen anew for the observation space
    tensors = {name: _attribute(algorithm, name) for name in variables}
    learned = params
    if has_features(spec):
        params = action_features.fold(algorithm.policy, params)
    if normaliser:
        params["policy"] = normalising.fold(normaliser, algorithm.policy, params["policy"])
    save_to_zip_file(path, data=data, params=params, pytorch_variables=tensors)
    if has_features(spec):
        action_features.write_beside(path, algorithm.policy, learned)
    if normaliser:
        normalising.write_beside(path, algorithm)


def restore(algorithm: Any, path: Path | BytesIO) -> None:
    """Take weights and optimisers from such a ZIP. Its pickled part is never read. Raises when the networks differ."""
    loaded: Any = load_from_zip_file(path, device="cpu", load_data=False)
    _, params, variables = loaded
    action_features.read_beside(path, algorithm.policy, params)
    if hasattr(algorithm, "normaliser"):
        normalising.read_beside(path, algorithm, params["policy"])
    own = algorithm.get_parameters()
    algorithm.set_parameters(
        {name: _with_own_settings(params.get(name), state) for name, state in own.items()},
        exact_match=True,
        device="cpu",
    )
    for name, value in (variables or {}).items():
        if value is not None and name != "ent_coef_tensor" and getattr(algorithm, name, None) is not None:
            recursive_setattr(algorithm, f"{name}.data", value.data)
    if hasattr(algorithm, "weights"):  # ARS learns on a vector of its own, of which the policy is a copy
        algorithm.weights = parameters_to_vector(algorithm.policy.parameters()).detach()


def _with_own_settings(saved: dict[str, Any] | None, own: dict[str, Any]) -> dict[str, Any]:
    """What was saved of an optimiser, with the settings of now; one of another kind, or that was not saved, stays new."""
    if saved is None or "param_groups" not in own:
        return own if saved is None else saved
    groups = list(zip(saved["param_groups"], own["param_groups"], strict=False))
    if len(saved["param_groups"]) != len(own["param_groups"]) or any(it.keys() != mine.keys() for it, mine in groups):
        return own
    return {"state": saved["state"], "param_groups": [mine | {"params": it["params"]} for it, mine in groups]}


def _attribute(owner: Any, dotted: str) -> Any:
    for name in dotted.split("."):
        owner = getattr(owner, name)
    return owner
