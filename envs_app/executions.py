"""Executions as the database knows them, and what they are started with."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import structlog
from django.conf import settings
from django.db import IntegrityError, transaction
from django.db.models import Max
from django.utils import timezone

from agents_app.algorithms.registry import get_row
from agents_app.algorithms.spec import AgentSpec
from agents_app.checks_agent import NO_ADVICE
from agents_app.models import Agent, Execution, Run
from envs_app.saves import prefix_of
from envs_app.transports.base import Address, Claim, Transport

log = structlog.get_logger("shepherd.executions")


def record_launch(transport: Transport, claim: Claim, exclude: Iterable[str]) -> Address:
    """Start an execution for a session and keep a row of it; the row goes when none was started. Raises NoCapacity."""
    agent = Agent.objects.select_related("algorithm", "advisor__algorithm").get(pk=claim.agent)
    execution = _new_row(claim.run)
    try:
        address = transport.launch(claim, execution_spec(agent, execution), agent.max_percent_cpu, exclude)
    except TimeoutError:
        raise  # it may have been started after all; if not, housekeeping notes that it was lost
    except Exception:
        execution.delete()
        raise
    if address.uid != str(execution.uid):  # somebody else launched one for the session meanwhile
        execution.delete()
    else:
        Agent.objects.filter(pk=agent.pk).update(last_activity_at=timezone.now())
        log.info("execution started", agent=claim.agent, execution=execution.number, session=claim.session)
    return address


def _new_row(run: int) -> Execution:
    """A row with the next number; another process may take it first."""
    while True:
        last = Execution.objects.filter(run_id=run).aggregate(last=Max("number"))["last"] or 0
        try:
            with transaction.atomic():
                return Execution.objects.create(run_id=run, number=last + 1)
        except IntegrityError:
            if not Run.objects.filter(pk=run).exists():
                raise


def execution_spec(agent: Agent, execution: Execution) -> dict[str, Any]:
    """envs_app.execution.worker.ExecutionSpec as a dictionary, but for the places that the transport knows."""
    parameters = agent.parameters()
    return {
        "uid": str(execution.uid),
        "number": execution.number,
        "run": execution.run_id,
        "saves": prefix_of(execution.run),
        "agent_id": str(agent.pk),
        "agent": agent_spec(agent, parameters).to_dict(),
        "learning": agent.enable_learning,
        "start_from": agent.start_from,
        "save_interval": agent.save_interval,
        "saves_kept": settings.SAVES_KEPT,
        "sessions": places(agent),
        "answer_within": float(agent.answer_within),
        "unanswered_reward": agent.unanswered_reward,
        "reclaim_seconds": float(settings.RECLAIM_SECONDS),
        "seed": parameters.get("seed"),
        "advisor": advisor_spec(agent),
    }


def advisor_spec(agent: Agent) -> dict[str, Any] | None:
    """envs_app.execution.frozen.FrozenSpec as a dictionary."""
    advisor = agent.advisor
    if advisor is None or agent.advice_method == NO_ADVICE:
        return None
    if advisor.owner_id != agent.owner_id:  # it was given away since
        log.warning("the advisor belongs to somebody else", agent=str(agent.pk), advisor=str(advisor.pk))
        return None
    run = advisor.current_run()
    spec = agent_spec(advisor, advisor.parameters()).to_dict()
    return {"name": advisor.name, "agent": spec, "rule": agent.advisor_save, "saves": prefix_of(run)}


def places(agent: Agent) -> int:
    """How many sessions may share an execution; an algorithm that plays by itself plays with one."""
    return 1 if get_row(agent.algorithm.name).family == "direct" else agent.sessions_per_execution


def agent_spec(agent: Agent, parameters: dict[str, Any]) -> AgentSpec:
    """What the algorithm is built from: the catalogue's defaults, under what the owner set."""
    rows = agent.algorithm.parameters.exclude(default=None)
    defaults = {row.name: row.default for row in rows}
    return AgentSpec(
        algorithm=agent.algorithm.name,
        action_space=agent.action_space,
        observation_space=agent.observation_space,
        policy=agent.policy,
        parameters=defaults | parameters,
        action_masks=agent.action_masks,
        action_features=agent.action_features,
        advice_method=agent.advice_method,
        learning_correction=agent.learning_correction,
        continuous_advice=agent.continuous_advice,
        advice_samples=agent.advice_samples,
        last_word=agent.last_word,
        advice_form=agent.advice_form,
        shaping_scale=agent.shaping_scale,
        rho=agent.rho,
        psi=agent.psi,
        advice_weight=agent.advice_weight,
        advisors=agent.advisors,
        peers_advise=agent.peers_advise,
        averaging=agent.averaging,
    )
