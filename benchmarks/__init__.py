"""Speed, memory, load and learning, each against a baseline taken in the same run (DESIGN.md section 6)."""

import shepherd  # noqa: F401  (NumPy has one thread, as in executions)
