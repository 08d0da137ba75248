#!/usr/bin/env python
"""Django's command line for Shepherd."""

import os
import sys


def main() -> None:
    """Run the command named on the command line with Shepherd's settings."""
    if sys.version_info < (3, 11):  # noqa: UP036 - for whoever starts it with the system's Python
        sys.exit(f"Shepherd needs Python 3.11 or newer; this is {sys.version.split()[0]} ({sys.executable}).")
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "shepherd.settings")
    from django.core.exceptions import ImproperlyConfigured
    from django.core.management import execute_from_command_line

    try:
        execute_from_command_line(sys.argv)
    except ImproperlyConfigured as error:
        sys.exit(f"Wrong setting: {error}")


if __name__ == "__main__":
    main()
