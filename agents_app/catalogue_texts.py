"""What the signatures of the algorithms do not say: plain words for people who know no RL, and sensible bounds."""

from __future__ import annotations

ALGORITHMS = {
    "PPO": "A good first choice for every problem: learns steadily and forgives wrong parameters.",
    "A2C": "Simpler and quicker per step than PPO, learns less from each step.",
    "DQN": "For choosing one of a few actions: remembers what happened and learns from it again and again.",
    "DDPG": "The ancestor of TD3, kept for comparison: for actions that are numbers.",
    "TD3": "For actions that are numbers: learns from memory, needs few steps, explores by noise on the action.",
    "SAC": "A good first choice for actions that are numbers when steps are dear: learns from memory.",
    "TRPO": "The ancestor of PPO: a costlier calculation keeps each update small.",
    "QR-DQN": "DQN that predicts how likely each outcome is, not only the mean of all.",
    "TQC": "SAC that predicts how likely each outcome is, and leaves out its most optimistic predictions.",
    "CrossQ": "A successor of SAC that is simpler inside and needs fewer steps. Observations are vectors only.",
    "ARS": "Random search: tries small changes of a simple network for whole episodes and keeps what helped.",
    "RecurrentPPO": "PPO with a memory (LSTM), for when one observation does not tell all.",
    "MaskablePPO": "PPO that never takes an action that the client forbids at a step (action_mask).",
    "BDPI": "For choosing one of a few actions when steps are dear and computing is cheap: several critics teach one "
    "actor, again and again from memory. Learns from very few steps.",
    "PolicyGradient": "The ancestor of PPO and A2C, for comparison: plays whole episodes, then makes what led to high "
    "returns more probable.",
}
TAKES_ADVICE = "Executions can advise each other."
TAKES_NONE = "Takes no advice."

NET_ARCH = "Sizes of the hidden layers, separated by commas, e.g. 64,64. Larger networks learn more, and more slowly."
NET_ARCH_OR_NONE = (
    f"{NET_ARCH} 0: none, so that actions are scored by sums of what is observed; learned from the fewest steps."
)
NORMALIZE_OBSERVATIONS = (
    "Bring each number of an observation to mean 0 and deviation 1, as learned on the way. Needed when your numbers are "
    "large, or far from zero; images and whole numbers are left alone. What has been learned depends on it."
)
ACTION_NOISE = (
    "Noise added to the actions to explore: 'normal 0.1' (independent at each step) or 'ou 0.1' (drifting), with the "
    "size of the noise; 'normal 0' is none."
)
LEARNING_RATE_END = (
    "What the learning rate falls to, evenly over total_timesteps; it stays there afterwards. Large steps learn quickly, small "
    "ones in the end more exactly. Empty: it does not fall."
)
TOTAL_TIMESTEPS = (
    "Over how many steps of each execution the learning rate falls, if it does, and exploration declines, where it is by "
    "random actions. Learning goes on after them."
)

PARAMETERS = {
    "learning_rate": "How large the steps of learning are. Too large is unstable, too small is slow.",
    "n_steps": "How many steps are collected before each update.",
    "batch_size": "How many steps the network sees at once when it learns.",
    "n_epochs": "How often each collected step is learned from.",
    "gamma": "How much the future counts: near 1 far-sighted, 0 only the next reward.",
    "gae_lambda": "How far a reward reaches back to the actions before it: 1 is to the start, lower is less noisy.",
    "clip_range": "How far an update may change the probability of an action; 0.2 is 20 percent.",
    "clip_range_vf": "How far an update may change a predicted return. It depends on the scale of your rewards; empty: no limit.",
    "normalize_advantage": "Judge on one scale how much better actions were than expected, so that the scale of rewards matters "
    "less.",
    "ent_coef": "Reward for trying different actions; raise it when the agent settles too early.",
    "vf_coef": "How much learning to predict the return counts against learning to act.",
    "max_grad_norm": "The largest single step of learning that is taken; guards against jumps.",
    "target_kl": "End an update when the policy has changed by this much; empty: no such limit.",
    "seed": "Makes the random numbers repeatable; empty: different each time. Each execution adds its own number.",
    "use_sde": "Explore by a noise that depends on the state and changes slowly; smoother, for robots. Actions must be "
    "numbers.",
    "sde_sample_freq": "With use_sde: draw its noise anew every so many steps; -1: once per collection.",
    "use_sde_at_warmup": "With use_sde: explore by its noise from the first step, instead of by random actions.",
    "rms_prop_eps": "A small number that keeps the optimiser from dividing by zero.",
    "use_rms_prop": "Use the optimiser RMSprop, as the original; no: Adam.",
    "buffer_size": "How many steps the memory holds. It takes memory of the machine: twice the size "
    "times the observation.",
    "learning_starts": "How many random steps are collected before learning starts.",
    "tau": "How fast the slow copy of the network follows the learning one: 1 is a full copy.",
    "train_freq": "Learn every so many steps.",
    "gradient_steps": "How many updates are made each time; -1: as many as steps were made since the last time.",
    "target_update_interval": "Every how many steps the slow copy of the network is renewed.",
    "exploration_fraction": "Over which part of total_timesteps the random actions become fewer.",
    "exploration_initial_eps": "The share of random actions at the beginning.",
    "exploration_final_eps": "The share of random actions from the end of exploration on.",
    "policy_delay": "Update what chooses actions only once in so many updates of what predicts their returns.",
    "target_policy_noise": "Noise on the actions whose returns are predicted; makes the predictions careful.",
    "target_noise_clip": "The largest value of the noise of target_policy_noise.",
    "target_entropy": "How random the policy should stay: 'auto', or a number (lower is less random).",
    "top_quantiles_to_drop_per_net": "How many of the most optimistic of 25 predictions are dropped.",
    "cg_max_steps": "How many steps the calculation takes that keeps each update small.",
    "cg_damping": "Steadies the calculation that keeps updates small: higher is steadier, and slower to learn.",
    "line_search_shrinking_factor": "By what an update is shortened when it does not help.",
    "line_search_max_iter": "How often an update is shortened at most.",
    "n_critic_updates": "Updates of the predicted return for each update of the policy.",
    "sub_sampling_factor": "Use only one of so many collected steps for the calculation that keeps updates small, to save time.",
    "n_delta": "How many random changes of the network are tried in each round.",
    "n_top": "How many of the best changes are used; empty: all.",
    "delta_std": "The size of the random changes.",
    "zero_policy": "Begin with a network of zeros.",
    "alive_bonus_offset": "Added to each reward; a negative number takes away a reward for merely staying alive.",
    "n_eval_episodes": "Episodes played with each change.",
    "n_episodes": "How many episodes are played before each update.",
    "baseline": "Learn what return each state leads to, and reward only what is better than that; steadier.",
    "baseline_steps": "With baseline: how many steps of learning the expected returns make for each update of the policy.",
    "n_critics": "How many networks that predict returns (critics) teach the one that acts (the actor). More are steadier, "
    "and cost more time.",
    "q_loops": "How often each critic moves its estimates in a round of training; its two networks take turns.",
    "fit_steps": "How many steps of learning each network makes towards each new estimate.",
    "alpha": "How far a new estimate moves from the old one: 1 is all the way, lower is steadier.",
    "delta": "How far the actor may move for one critic. Smaller learns more slowly, and explores for longer.",
}

# Same name, another meaning in the algorithms that learn from memory.
REPLAYING = {
    "n_steps": "Learn from the sum of so many rewards instead of one.",
    "ent_coef": "Reward for trying different actions: 'auto' finds the best, 'auto_0.1' begins there; or a number.",
}

# Same name, another meaning in one algorithm.
OWN = {
    "BDPI": {
        "learning_rate": "How large the steps of learning are, of the actor and of the critics.",
        "learning_starts": "How many steps are collected before learning starts. The actor chooses from the first on.",
        "train_freq": "Learn every so many steps. Learning is costly here: raise it when clients have to wait.",
        "gradient_steps": "How many rounds of training are made each time; in each, every critic learns, then teaches "
        "the actor. -1: as many as steps were made since the last time.",
    },
    "TRPO": {"target_kl": "How far one update may change the policy."},
    "PolicyGradient": {
        "n_steps": "An update comes after so many steps at the latest; an episode that is longer is cut there.",
        "normalize_advantage": "Bring the returns of an update to one scale, so that the scale of rewards matters less.",
        "max_grad_norm": "The largest step of the gradient that is taken; guards against jumps. Empty: no limit.",
    },
}

POSITIVE, SHARE = (1e-8, None), (0, 1)
LARGEST = 2**31 - 1
BOUNDS: dict[str, tuple[float | None, float | None]] = {
    "learning_rate": (1e-8, 10),
    "learning_rate_end": (0, 10),
    "n_steps": (2, 1_000_000),
    "batch_size": (2, 1_000_000),
    "n_epochs": (1, 1000),
    "gamma": SHARE,
    "gae_lambda": SHARE,
    "clip_range": (1e-8, 10),
    "clip_range_vf": POSITIVE,
    "ent_coef": (0, None),
    "vf_coef": (0, None),
    "max_grad_norm": POSITIVE,
    "target_kl": POSITIVE,
    "seed": (0, 2**31 - 1),
    "sde_sample_freq": (-1, LARGEST),
    "rms_prop_eps": (1e-12, 1),
    "buffer_size": (1, 100_000_000),
    "learning_starts": (0, LARGEST),
    "tau": (1e-8, 1),
    "train_freq": (1, 1_000_000),
    "gradient_steps": (-1, 100_000),
    "target_update_interval": (1, LARGEST),
    "exploration_fraction": (1e-8, 1),
    "exploration_initial_eps": SHARE,
    "exploration_final_eps": SHARE,
    "policy_delay": (1, 1000),
    "target_policy_noise": (0, None),
    "target_noise_clip": (0, None),
    "top_quantiles_to_drop_per_net": (0, 24),
    "cg_max_steps": (1, 1000),
    "cg_damping": (0, None),
    "line_search_shrinking_factor": (1e-8, 0.999),
    "line_search_max_iter": (1, 1000),
    "n_critic_updates": (1, 1000),
    "sub_sampling_factor": (1, 1000),
    "n_delta": (1, 10_000),
    "n_top": (1, 10_000),
    "delta_std": POSITIVE,
    "n_eval_episodes": (1, 1000),
    "n_episodes": (1, 1000),
    "baseline_steps": (1, 1000),
    "n_critics": (1, 64),
    "q_loops": (1, 100),
    "fit_steps": (1, 1000),
    "alpha": (1e-8, 1),
    "delta": (1e-8, 10),
    "total_timesteps": (1, 10**12),
}

NUMBER = r"\d+(\.\d+)?(e-?\d+)?|\.\d+"
PATTERNS = {
    "net_arch": r"\s*[1-9]\d{0,4}(\s*,\s*[1-9]\d{0,4}){0,9}\s*",
    "action_noise": rf"|(normal|ou) ({NUMBER})",
    "ent_coef": rf"auto(_({NUMBER}))?|{NUMBER}",
    "target_entropy": rf"auto|-?({NUMBER})",
}
