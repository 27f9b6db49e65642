"""One run with one fault, drawn from a seed, and what became of it."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any
import zlib

import cv2
import numpy as np

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.evaluation.faults.catalogue.fault import EVERYWHERE, Fault, Scene
from visual_servo_epipolar.evaluation.faults.drive import Drive, Moment
from visual_servo_epipolar.evaluation.faults.judging.judge import judged
from visual_servo_epipolar.evaluation.faults.judging.record import Bounds
from visual_servo_epipolar.evaluation.faults.judging.witness import SERVO, Witness
from visual_servo_epipolar.evaluation.live.world import small_camera, World, WorldSettings

SLACK_S = 0.15  # watchdog, messages and ticks of the base
BESIDE = 0.25  # part of the starts from which the robot turns and backs off first
NO_TIMEOUT = 0.5  # part of the bases that do not stop by themselves
LONGEST_DELAY_S = 3.0  # into the phase


def run(name: str, fault: Fault, seed: int) -> dict[str, Any]:
    """Drive with a fault, and return what became of it as a JSON object."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, zlib.crc32(name.encode())))
    beside = bool(rng.random() < BESIDE)
    settings = fault.prepare(_world(seed, rng, beside=beside), rng)
    moment = _moment(fault, rng, beside=beside)
    if not fault.base_alone and bool(rng.random() < NO_TIMEOUT):
        settings = replace(settings, base=replace(settings.base, command_timeout=0.0))
    with World(settings) as world:
        drive = Drive(Scene(world, Witness(world), rng), fault, moment)
        drive.drive()
        judgement = judged(drive.scene.witness.finish(), _bounds(world))
    record = drive.scene.witness.record
    return {
        'fault': name,
        'seed': seed,
        'start': list(settings.start),
        'base_stops_by_itself': settings.base.command_timeout > 0.0,
        'moment': {'phase': moment.phase.value, 'delay_s': moment.delay_s},
        'struck_s': drive.struck_s,
        'struck_in': drive.struck_in,
        'notes': drive.scene.notes,
        'safe': judgement.safe,
        **asdict(judgement),
        'verdict': judgement.verdict.value,
        'wrong_geometry_s': record.wrong_geometry_s,
        'phase': record.phase,
        'reason': record.reason,
        'duration_s': drive.time_s,
    }


def _world(seed: int, rng: np.random.Generator, *, beside: bool) -> WorldSettings:
    x, y, heading = rng.uniform(-1.0, 1.0, 3)
    spot = (0.5 * x, -0.2 + 0.3 * y) if beside else (0.3 * x, -1.3 + 0.3 * y)
    start = float(spot[0]), float(spot[1]), float(6.0 * heading)
    return WorldSettings(start=start, seed=seed, camera=small_camera(seed))


def _moment(fault: Fault, rng: np.random.Generator, *, beside: bool) -> Moment:
    phases = fault.phases
    if beside and set(EVERYWHERE) <= set(phases):
        phases = (*phases, Phase.ORIENTING, Phase.RETREATING)
    phase = phases[int(rng.integers(len(phases)))]
    return Moment(phase, float(rng.uniform(0.0, LONGEST_DELAY_S)))


def _bounds(world: World) -> Bounds:
    """Return what is allowed in ``world``."""
    settings, base = world.settings, world.settings.base
    period_s = 1.0 / settings.camera.frame_rate
    told: Mapping[str, float] = world.told.get(SERVO, {})
    return Bounds(
        sight_s=told['stale_timeout'] + told.get('max_latency', 0.0) + period_s + SLACK_S,
        period_s=period_s,
        base_linear=base.max_linear,
        base_angular=base.max_angular,
        base_acceleration=base.acceleration,
        base_deceleration=base.deceleration,
        base_angular_acceleration=base.angular_acceleration,
        delay_s=world.delay_s,
        # What is so much deeper looks alike from so much farther: epipoles take a longer way.
        position_m=Bounds.position_m * settings.depth,
        excursion_m=settings.servo.max_retreat,
    )
