"""API keys and sessions. Both are opened by a secret that is kept only as its SHA-256 (the secrets are random)."""

from __future__ import annotations

import hashlib
import secrets

from django.db import models
from django.utils import timezone


def make_key(prefix: str) -> str:
    """A new secret of 192 random bits, like 'sk_...'; show it once, keep its hash."""
    return f"{prefix}_{secrets.token_urlsafe(24)}"


def hash_key(key: str) -> str:
    """What is kept of a secret. One round is enough: nobody can guess 192 random bits."""
    return hashlib.sha256(key.encode()).hexdigest()


class APIKey(models.Model):
    """Opens one agent. The scope `step` lets clients train; `manage` also reads returns and the model."""

    class Scope(models.TextChoices):
        STEP = "step", "Step: train and act"
        MANAGE = "manage", "Manage: also read returns and download the model"

    agent = models.ForeignKey("agents_app.Agent", models.CASCADE, related_name="api_keys")
    name = models.CharField(max_length=100, blank=True, help_text="To tell your keys apart.")
    prefix = models.CharField(max_length=12, editable=False)
    hash = models.CharField(max_length=64, unique=True, editable=False)
    scope = models.CharField(max_length=10, choices=Scope, default=Scope.MANAGE)
    created_at = models.DateTimeField("created", default=timezone.now, editable=False)
    last_used_at = models.DateTimeField("last used", null=True, editable=False)
    expires_at = models.DateTimeField(null=True, blank=True)
    revoked_at = models.DateTimeField("revoked", null=True, blank=True, editable=False)

    class Meta:
        verbose_name = "API key"
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return f"{self.prefix}…"

    @classmethod
    def issue(cls, agent: models.Model, name: str = "", scope: str = Scope.MANAGE) -> tuple[APIKey, str]:
        """Make and keep a key of `agent`; the second value is the secret, which nobody can read again."""
        secret = make_key("sk")
        key = cls.objects.create(agent=agent, name=name, scope=scope, prefix=secret[:9], hash=hash_key(secret))
        return key, secret

    def is_valid(self) -> bool:
        """Whether it still opens its agent."""
        return self.revoked_at is None and (self.expires_at is None or self.expires_at > timezone.now())


class Session(models.Model):
    """One client's conversation with an agent; survives restarts of everything."""

    agent = models.ForeignKey("agents_app.Agent", models.CASCADE, related_name="sessions")
    api_key = models.ForeignKey(APIKey, models.CASCADE, related_name="sessions")
    hash = models.CharField(max_length=64, unique=True, editable=False)
    created_at = models.DateTimeField(default=timezone.now)
    last_activity_at = models.DateTimeField(default=timezone.now)
    closed_at = models.DateTimeField(null=True, blank=True)

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return f"session {self.pk}"
