"""The admin, where people configure agents: a file per subject; who may do what is in `owned`."""

from django.contrib import admin
from django.contrib.auth.models import Group

from agents_app.admin import agents, audit, catalogue, history, keys, users

admin.site.unregister(Group)  # what one may do follows from what one owns

__all__ = ["agents", "audit", "catalogue", "history", "keys", "users"]
