"""The HTTP API, a file per verb."""
