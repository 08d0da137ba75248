"""The Python client does what every client must do, with orjson and without."""

import sys

from tests.clients.conformance import Conformance
from tests.clients.driving import DRIVERS


class TestPython(Conformance):
    """With orjson."""

    command = [sys.executable, str(DRIVERS / "driver.py")]


class TestPlainPython(Conformance):
    """With the standard library only."""

    command = [*TestPython.command, "--plain"]
