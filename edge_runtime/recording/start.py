"""What a log begins with: the run, its software, machine, policy and fleet, and the objectives in force."""

import hashlib
import math
import os
import platform
import sys
import time
from importlib import metadata
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from edge_runtime.common.processor import processor
from edge_runtime.common.realtime import in_realtime
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission, adaptation_of
from edge_runtime.guidance.guide import Guide
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.recording.schema import (
    LOG_FORMAT,
    BundleIdentity,
    FleetIdentity,
    LoggedObjective,
    LoggedObjectiveSet,
    Machine,
    ObjectPlace,
    RobotPlace,
    Settings,
    Start,
    Versions,
)

BELIEF_RADIUS_M: Final = 0.02
"""Of the disc by which a place that is only believed in is drawn."""


def make_start(mission: Mission, controller: Controller, run: str, *, bridge: str, dry_run: bool) -> Start:
    """Describe a run that begins now; ``run`` is its name."""
    wall_s, monotonic_s = time.time(), time.monotonic()
    return Start(
        format=LOG_FORMAT,
        run=run,
        part=0,
        robot_id=mission.robot_id,
        started_at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(wall_s)),
        started_unix_s=wall_s,
        started_s=monotonic_s,
        versions=Versions(metadata.version("cfpg-edge"), platform.python_version(), np.__version__),
        machine=_machine(),
        bundle=identify(mission),
        fleet=_fleet(mission),
        settings=_settings(mission, controller, bridge=bridge, dry_run=dry_run),
    )


def logged_set(guide: Guide, bundle: BundleIdentity | None = None) -> LoggedObjectiveSet:
    """Describe the objectives in force, and the policy if it was handed over under way."""
    guidance, wanted = guide.asked.guidance, guide.asked.objectives
    active = {id(objective) for objective in guide.objectives}
    return LoggedObjectiveSet(
        version=guide.version,
        mode=guidance.mode,
        scale=guidance.scale,
        reach=guidance.reach,
        goal_reach=guidance.goal_reach,
        goal_within_m=guidance.goal_within_m,
        start_noise=guide.start_noise,
        ease_m=guidance.ease_m,
        requirement_steps=guidance.requirement_steps,
        objectives=tuple(_objective(objective, active=id(objective) in active) for objective in wanted),
        bundle=bundle,
    )


def _objective(objective: Objective, *, active: bool) -> LoggedObjective:
    kind, folder = objective.name, ""
    if type(objective) not in BUILT_IN:
        module = type(objective).__module__
        kind, folder = f"{module}:{type(objective).__qualname__}", _import_folder(module)
    parameters = msgspec.json.encode(objective).decode()
    return LoggedObjective(objective.name, kind, folder, objective.weight, active, parameters)


def _import_folder(module: str) -> str:
    """The folder from which a module's name can be imported."""
    file = getattr(sys.modules.get(module), "__file__", None)
    return str(Path(file).resolve().parents[module.count(".")]) if file else ""


def _machine() -> Machine:
    return Machine(platform.node(), processor(), os.cpu_count() or 0, platform.release())


def identify(mission: Mission) -> BundleIdentity:
    """Name the policy of a mission."""
    bundle, manifest = mission.bundle, mission.bundle.manifest
    return BundleIdentity(
        manifest.name,
        str(bundle.directory.resolve()),
        bundle.sha256,
        manifest.body.radius_m,
        manifest.steps,
        manifest.sampler,
    )


def _fleet(mission: Mission) -> FleetIdentity:
    fleet = mission.fleet
    return FleetIdentity(
        str(fleet.path.resolve()),
        hashlib.sha256(fleet.path.read_bytes()).hexdigest(),
        fleet.team.arrival_m,
        tuple(RobotPlace(robot.id, robot.start_m, robot.goal_m) for robot in fleet.robots),
        (
            *(ObjectPlace(each.name, each.radius_m, each.goal_m) for each in fleet.tracked),
            *(ObjectPlace(each.name, BELIEF_RADIUS_M) for each in fleet.beliefs),
        ),
    )


def _settings(mission: Mission, controller: Controller, *, bridge: str, dry_run: bool) -> Settings:
    limits = controller.limits
    return Settings(
        rate_hz=mission.rate_hz,
        seed=mission.seed,
        backend=controller.policy.backend,
        engine=getattr(controller.policy, "engine", ""),
        bridge=bridge,
        dry_run=dry_run,
        realtime=in_realtime(),
        max_state_age_s=limits.max_state_age_s,
        max_step=_finite(limits.max_step),
        max_speed_m_s=_finite(limits.max_speed_m_s),
        max_unfamiliar_s=_finite(limits.max_unfamiliar_s),
        max_yaw_rate_rad_s=_finite(limits.max_yaw_rate_rad_s),
        adaptation=adaptation_of(mission.fleet.robot(mission.robot_id), mission.fleet.team),
    )


def _finite(limit: float) -> float | None:
    return limit if math.isfinite(limit) else None
