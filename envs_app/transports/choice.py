"""Which transport carries the steps."""

from __future__ import annotations

from functools import cache

from django.conf import settings
from django.utils.module_loading import import_string

from envs_app.transports.base import Transport

TRANSPORTS = {
    "local": "envs_app.transports.local.client.LocalTransport",
    "redis": "envs_app.transports.redis.client.RedisTransport",
}


@cache
def get_transport() -> Transport:
    """The transport that the settings name."""
    return import_string(TRANSPORTS[settings.TRANSPORT])()
