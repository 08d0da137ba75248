"""People, agents with a past, and a fleet that remembers what it was asked."""

import uuid

import pytest
from django.test import Client

from agents_app.fleet import get_fleet
from agents_app.models import APIKey, EpisodeReturn, ExecutionError, Save, Session
from tests.agents.makers import RecordingFleet, make_agent, make_staff, make_user


@pytest.fixture(autouse=True)
def fleet(settings):
    """The fleet of all tests here."""
    settings.SHEPHERD_FLEET = "tests.agents.makers.RecordingFleet"
    settings.MIDDLEWARE = [
        name for name in settings.MIDDLEWARE if "whitenoise" not in name
    ]  # no folder of static files
    settings.PASSWORD_HASHERS = ["django.contrib.auth.hashers.MD5PasswordHasher"]
    RecordingFleet.calls, RecordingFleet.statuses = [], []
    RecordingFleet.zip, RecordingFleet.unreachable = None, False
    get_fleet.cache_clear()
    yield RecordingFleet
    get_fleet.cache_clear()


def with_a_past(agent, value=7.5):
    """The agent with a row of everything, all of which bear its name."""
    run = agent.current_run()
    key, _ = APIKey.issue(agent, name=f"key of {agent.name}")
    session = Session.objects.create(agent=agent, api_key=key, hash=uuid.uuid4().hex)
    execution = run.executions.create(number=1)
    EpisodeReturn.objects.create(run=run, execution=execution, session=session, episode=1, value=value, length=10)
    Save.objects.create(run=run, execution_uid=execution.uid, name=f"save of {agent.name}", steps=10, size=2048)
    ExecutionError.objects.create(
        run=run, execution_uid=execution.uid, summary=f"error of {agent.name}", traceback=f"trace of {agent.name}"
    )
    return agent


@pytest.fixture
def ann(db):
    """Staff, with an agent."""
    return make_staff("ann")


@pytest.fixture
def agent(ann):
    """Ann's."""
    return with_a_past(make_agent("sheepdog", ann))


@pytest.fixture
def fresh(ann):
    """An agent of Ann's that has not learned yet."""
    return make_agent("puppy", ann)


@pytest.fixture
def foreign(db):
    """An agent of somebody else."""
    return with_a_past(make_agent("wolfhound", make_staff("bob")), 123.25)


@pytest.fixture
def client(ann):
    """Ann's browser; it sends CSRF tokens only where a test does."""
    browser = Client()
    browser.force_login(ann)
    return browser


@pytest.fixture
def boss(db):
    """A superuser's browser."""
    browser = Client()
    browser.force_login(make_user("boss", password="secret-password", is_staff=True, is_superuser=True))
    return browser
