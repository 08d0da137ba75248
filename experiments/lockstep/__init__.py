"""Many PPO learners in one process, step by step together: a fast prototype of executions that advise each other."""
