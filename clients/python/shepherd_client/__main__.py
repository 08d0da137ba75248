"""python -m shepherd_client is shepherd-client."""

import sys

from shepherd_client.cli import main

sys.exit(main())
