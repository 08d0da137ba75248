"""Settings and entry points of the service."""

import os

# Read by NumPy when it is loaded. With as many threads as there are cores, executions wait for each other, and a process that has
# several cannot be forked safely.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
