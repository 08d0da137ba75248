"""Runs a command that gets SIGTERM when the process that started it is gone, however that one ended (Linux).

Usage: python bond.py PARENT_PID COMMAND...
A script of its own and no `preexec_fn`: the supervisor has threads, beside which Python code after a fork may hang.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int, by: int = signal.SIGTERM) -> None:
    """Have the kernel send the signal `by` to this process when `parent` ends. Exits if it has ended already."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, by, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(0)


if __name__ == "__main__":
    die_with_parent(int(sys.argv[1]))
    os.execv(sys.argv[2], sys.argv[2:])  # noqa: S606 - the command comes from the supervisor
