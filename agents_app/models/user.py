"""Users: people with an environment. Only a name is needed; staff have a password for the admin."""

from __future__ import annotations

from typing import Any, ClassVar

from django.contrib.auth.base_user import AbstractBaseUser, BaseUserManager
from django.contrib.auth.models import PermissionsMixin
from django.core.exceptions import ValidationError
from django.db import models
from django.utils import timezone


class UserManager(BaseUserManager["User"]):
    """Makes users without a password, and staff with one."""

    def create_user(self, name: str, password: str | None = None, **fields: Any) -> User:
        """A user; without `password` nobody can log in as them. Raises ValidationError when staff have none."""
        user = self.model(name=name, **fields)
        if password:
            user.set_password(password)
        else:
            user.set_unusable_password()
        if user.is_staff and not password:
            raise ValidationError("Staff log in to the admin: give a password.")
        user.save(using=self._db)
        return user

    def create_superuser(self, name: str, password: str | None = None, **fields: Any) -> User:
        """A user who may do everything in the admin."""
        return self.create_user(name, password, is_staff=True, is_superuser=True, **fields)


class User(AbstractBaseUser, PermissionsMixin):
    """A person with an environment; owns agents."""

    name = models.CharField(max_length=150, unique=True, help_text="The only thing that is needed.")
    is_staff = models.BooleanField("staff", default=False, help_text="May log in to the admin, with a password.")
    is_active = models.BooleanField("active", default=True, help_text="Untick instead of deleting.")
    created_at = models.DateTimeField("created", default=timezone.now, editable=False)

    objects = UserManager()
    USERNAME_FIELD = "name"
    REQUIRED_FIELDS: ClassVar[list[str]] = []

    class Meta:
        ordering = ["name"]

    def __str__(self) -> str:
        return self.name
