"""API keys and sessions. Both are opened by a secret that is kept only as its SHA-256 (the secrets are random)."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Iterable
from datetime import datetime

from django.core.validators import MinValueValidator
from django.db import models
from django.utils import timezone


def make_key(prefix: str) -> str:
    """A new secret of 192 random bits, like 'sk_...'; show it once, keep its hash."""
    return f"{prefix}_{secrets.token_urlsafe(24)}"


def hash_key(key: str) -> str:
    """What is kept of a secret. One round is enough: nobody can guess 192 random bits."""
    return hashlib.sha256(key.encode()).hexdigest()


class APIKey(models.Model):
    """Opens one agent. The scope `step` lets clients train; `manage` also reads returns and the model.

    A publishable key (`pk_...`) stands in a web page, where everybody can read it. It only steps, and only for pages of its
    own origins or of the server's own host. It is the only kind whose text is kept (`published`), as pages show it.
    """

    class Scope(models.TextChoices):
        STEP = "step", "Step: train and act"
        MANAGE = "manage", "Manage: also read returns and download the model"

    agent = models.ForeignKey("agents_app.Agent", models.CASCADE, related_name="api_keys")
    name = models.CharField(max_length=100, blank=True, help_text="To tell your keys apart.")
    prefix = models.CharField(max_length=12, editable=False)
    hash = models.CharField(max_length=64, unique=True, editable=False)
    scope = models.CharField(max_length=10, choices=Scope, default=Scope.MANAGE)
    published = models.CharField(max_length=40, blank=True, editable=False)
    origins = models.JSONField(
        default=list, blank=True, help_text="Web pages that may use a publishable key, e.g. https://example.org."
    )
    steps_per_minute = models.PositiveIntegerField(
        null=True, blank=True, validators=[MinValueValidator(1)], help_text="Of all clients together; empty: no limit."
    )
    successor = models.OneToOneField("self", models.SET_NULL, null=True, editable=False, related_name="predecessor")
    created_at = models.DateTimeField("created", default=timezone.now, editable=False)
    last_used_at = models.DateTimeField("last used", null=True, editable=False)
    expires_at = models.DateTimeField("expires", null=True, blank=True)
    revoked_at = models.DateTimeField("revoked", null=True, blank=True, editable=False)

    class Meta:
        verbose_name = "API key"
        ordering = ["-created_at"]
        constraints = [
            models.CheckConstraint(
                condition=models.Q(published="") | models.Q(scope="step"), name="publishable_keys_only_step"
            )
        ]

    def __str__(self) -> str:
        return f"{self.prefix}…"

    @classmethod
    def issue(
        cls,
        agent: models.Model,
        name: str = "",
        scope: str = Scope.MANAGE,
        *,
        publishable: bool = False,
        origins: Iterable[str] = (),
        expires_at: datetime | None = None,
        steps_per_minute: int | None = None,
    ) -> tuple[APIKey, str]:
        """Make and keep a key of `agent`; the second value is the secret, which nobody can read again unless it is
        publishable. Publishable keys have the scope `step`, and origins as `read_origin` gives them."""
        secret = make_key("pk" if publishable else "sk")
        key = cls.objects.create(
            agent=agent,
            name=name,
            scope=cls.Scope.STEP if publishable else scope,
            prefix=secret[:9],
            hash=hash_key(secret),
            published=secret if publishable else "",
            origins=list(origins) if publishable else [],
            expires_at=expires_at,
            steps_per_minute=steps_per_minute,
        )
        return key, secret

    @classmethod
    def published_for(cls, agent: models.Model) -> str | None:
        """The newest publishable key of `agent` that is valid, for a page of this server to show."""
        keys = cls.objects.filter(agent=agent).exclude(published="").order_by("-created_at", "-pk")
        return next((key.published for key in keys if key.is_valid()), None)

    @property
    def publishable(self) -> bool:
        """Whether it may stand in a web page."""
        return bool(self.published)

    def describe_scope(self) -> str:
        """What it may do, in a word; a publishable key with the pages that may use it."""
        return " ".join(["publishable", *self.origins]) if self.publishable else self.scope

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
