"""
Plan of a sweep: starts, laws and scenario, and the commands that repeat it.

A worker does it chunk by chunk: it drives a few starts through the closed loop.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
import json
import shlex
import traceback
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.simulation.choices import refuse_unknown, REGIONS, SOURCES
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings, verdict, View
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import view_of

# Runs handed to a worker at a time, whose results are kept when all of them are there.
CHUNK = {'features': 64, 'images': 1}
CHUNKS_A_WORKER = 4  # at least, so that no worker waits long for the last one

Key = tuple[str, int]  # law and index of a run


@dataclass(frozen=True, slots=True)
class Chunk:
    """Runs of one law that a worker does in one go, by their indices."""

    law: str
    indices: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """
    A sweep. Each run follows from it and from the index of the run alone.

    Runs in images take turns in the rooms with the seeds ``scenes``, if there are any.
    ``scenario_name`` is how the user called the scenario, if at all, and ``rig_name`` the rig: for
    people, not for runs.
    """

    region: str
    runs: int
    source: str
    laws: tuple[str, ...]
    scenario: Scenario
    seed: int = 0
    scenes: tuple[int, ...] = ()
    scenario_name: str | None = None
    rig_name: str | None = None

    def __post_init__(self) -> None:
        refuse_unknown('region', self.region, REGIONS)
        refuse_unknown('source', self.source, SOURCES)
        if self.runs < 1 or not self.laws:
            raise InputError(
                f'a sweep needs a run and a law, got {self.runs} runs of {len(self.laws)} laws'
            )

    def run_seed(self, index: int) -> int:
        """Return the seed of run number ``index``, from 0 to 2^31 - 1, which all laws share."""
        # 6 keeps it apart from other draws of one seed.
        words = np.random.SeedSequence((self.seed, 6, index)).generate_state(1)
        return int(words[0] >> 1)

    def scenario_of(self, law: str, index: int) -> Scenario:
        """Return the scenario of run number ``index``."""
        scenario = self.scenario.with_servo({'law': law}).seeded(self.run_seed(index))
        if not self.scenes:
            return scenario
        scene = self.scenes[index % len(self.scenes)]
        return replace(scenario, camera=replace(scenario.camera, scene_seed=scene))

    def keys(self) -> list[Key]:
        """Return law and index of all runs."""
        return [(law, index) for law in self.laws for index in range(self.runs)]

    def chunks(self, done: Collection[Key], workers: int) -> list[Chunk]:
        """Share out the runs that are not ``done``: one law a chunk, enough for all workers."""
        missing = [key for key in self.keys() if key not in done]
        size = min(CHUNK[self.source], max(1, len(missing) // (CHUNKS_A_WORKER * workers)))
        return [chunk for law in self.laws for chunk in _cut_into_chunks(law, missing, size)]

    def identity(self) -> dict[str, Any]:
        """Return, as plain JSON, what fixes each run; not how many there are."""
        scenario = self.scenario.seeded(0).with_servo({'law': self.laws[0]}).document()
        document = {
            'region': self.region,
            'source': self.source,
            'laws': list(self.laws),
            'seed': self.seed,
            'scenes': list(self.scenes),
            'scenario': scenario,
        }
        plain: dict[str, Any] = json.loads(json.dumps(document))
        return plain

    def command(self) -> str:
        """Return the command line of the whole sweep."""
        laws = ('--compare', ','.join(self.laws)) if len(self.laws) > 1 else ('--law', *self.laws)
        options = self._scenario_options(self.scenario.camera.scene_seed)
        if self.scenes:
            options += ['--scenes', ','.join(map(str, self.scenes))]
        return shlex.join(
            [
                *('visual_servo', 'sweep', '--region', self.region, '--runs', str(self.runs)),
                *('--source', self.source, *laws, *options, '--seed', str(self.seed)),
            ]
        )

    def command_of_run(self, law: str, index: int, start: tuple[float, float, float]) -> str:
        """Return the command that repeats run ``index`` from its ``start``, in m, m and deg."""
        # Never 1e-05: argparse takes that, with a minus, for an option.
        x_y_deg = [np.format_float_positional(value, trim='-') for value in start]
        options = self._scenario_options(self.scenario_of(law, index).camera.scene_seed)
        return shlex.join(
            [
                *('visual_servo', 'simulate', '--start', *x_y_deg, '--source', self.source),
                *('--law', law, *options, '--seed', str(self.run_seed(index))),
            ]
        )

    def _scenario_options(self, scene: int) -> list[str]:
        """Return the options that differ from their defaults."""
        default, options = Scenario(), []
        if self.scenario_name is not None:
            options += ['--scenario', self.scenario_name]
        if self.rig_name is not None:
            options += ['--rig', self.rig_name]
        if self.scenario.servo.estimator != default.servo.estimator:
            options += ['--estimator', self.scenario.servo.estimator]
        if scene != default.camera.scene_seed:
            options += ['--scene', str(scene)]
        return options


def _cut_into_chunks(law: str, missing: list[Key], size: int) -> Iterator[Chunk]:
    indices = [index for of, index in missing if of == law]
    for first in range(0, len(indices), size):
        yield Chunk(law, tuple(indices[first : first + size]))


Start = tuple[float, float, float]
Run = tuple[LoopSettings, View, CameraModel]
Result = dict[str, Any]
# Quantities that a run that raised does not have.
MISSING = (
    *('position_error_m', 'lateral_error_m', 'longitudinal_error_m', 'heading_error_deg'),
    *('duration_s', 'path_length_m', 'max_distance_ratio', 'min_visible_features'),
    *('max_linear_speed', 'max_angular_speed', 'wrong_geometry_s', 'least_time_s', 'time_ratio'),
    *('standstills', 'phase_changes', 'peak_jerk_m_s3', 'peak_jerk_rad_s3'),
    *('standing_s', 'reversals'),
)


def work(plan: SweepPlan, chunk: Chunk) -> list[Result]:
    """Do the runs of ``chunk`` and return their results in its order."""
    cv2.setNumThreads(1)  # there is a worker for each core
    results = []
    for index in chunk.indices:
        seed = plan.run_seed(index)
        scenario = plan.scenario_of(chunk.law, index)
        start = start_in(plan.region, plan.seed, index, scenario, source=plan.source)
        results.append(result_of(scenario, start, seed, plan.source))
    return results


def run_of(scenario: Scenario, start: Start, seed: int, source: str) -> Run:
    """Return what the closed loop needs to drive from ``start`` with a seed."""
    seeded = scenario.seeded(seed)
    return seeded.loop(start, seed), view_of(seeded, source, seed), seeded.camera.nominal_camera


def result_of(scenario: Scenario, start: Start, seed: int, source: str) -> Result:
    """
    Drive from ``start`` with a seed and return the JSON document of the run.

    A run that raises counts as failed; its result then has the key ``traceback`` as well.
    """
    try:
        log = Loop(*run_of(scenario, start, seed, source)).run()
        return verdict(log, scenario.seeded(seed).camera.rig())
    except Exception as error:  # a defect: one start must not take the other thousands along
        return {
            'outcome': 'failed',
            'reason': f'defect: {type(error).__name__}: {error}',
            'start': list(start),
            'seed': seed,
            'law': scenario.servo.law,
            **dict.fromkeys(MISSING),
            'phases': [],
            'attempts': 0,
            'traceback': traceback.format_exc(),
        }
