"""The JavaScript client does what every client must do, in Node."""

from tests.clients.conformance import Conformance
from tests.clients.driving import DRIVERS, NEEDS_NODE


@NEEDS_NODE
class TestJavaScript(Conformance):
    """In Node."""

    command = ["node", str(DRIVERS / "driver.mjs")]
