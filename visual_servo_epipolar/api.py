"""
Public face for Python: simulate, sweep and replay runs, inspect photographs, read routes.

The names in ``__all__``, their arguments and results follow semantic versioning; all other modules
are internal. Bags and routes load their libraries when they are read, and nothing here needs ROS.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from visual_servo_epipolar.commands.arguments import rig_path, scenario_path
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.estimator import Estimator
from visual_servo_epipolar.core.twoview.inspection import Inspection
from visual_servo_epipolar.core.twoview.registry import ESTIMATORS
from visual_servo_epipolar.simulation.scenario import load, Scenario
from visual_servo_epipolar.simulation.views import drive

if TYPE_CHECKING:
    from visual_servo_epipolar.core.routes.route import Route

__all__ = [
    'ESTIMATORS',
    'LAWS',
    'Estimator',
    'InputError',
    'RunLog',
    'Scenario',
    'inspect',
    'load_route',
    'load_scenario',
    'replay',
    'simulate',
    'summarise',
    'sweep',
]


def load_scenario(name: str | None = None, *, rig: str | None = None) -> Scenario:
    """
    Return the scenario ``name`` with the camera, head and base of ``rig``.

    Each is a YAML file or the name of an installed one, such as ``harsh`` and ``fisheye``; None
    stands for the default. Raises InputError if a file cannot be used.
    """
    return load(
        None if name is None else scenario_path(name), None if rig is None else rig_path(rig)
    )


def simulate(
    start: tuple[float, float, float],
    *,
    scenario: Scenario | None = None,
    law: str | None = None,
    source: str = 'features',
    seed: int = 0,
    watch: Callable[[Sample], None] | None = None,
) -> RunLog:
    """
    Drive a simulated robot to the goal, and return the record of the run.

    Parameters
    ----------
    start : (x, y, heading)
        x to the right of the goal [m], y ahead of it [m], heading error [deg], left positive.
    scenario : Scenario, optional
        World, robot and settings; the nominal ones by default.
    law : str, optional
        Name of a law: ``paper``, ``corrected``, ``full``, ``smooth``, or of another package.
    source : {'features', 'images'}
        Input of the servo: noisy point features, or rendered images through the tracker.
    seed : int
        Seed of all random numbers; the same seed gives the same run on the same machine.
    watch : callable, optional
        Called with the sample of each step.

    """
    world = (scenario or Scenario()).seeded(seed)
    world = world if law is None else world.with_servo({'law': law})
    return drive(world, start, seed, source, watch=watch)


def sweep(
    region: str,
    runs: int,
    folder: str | Path,
    *,
    laws: Sequence[str] = ('full',),
    scenario: Scenario | None = None,
    source: str = 'features',
    seed: int = 0,
    jobs: int = 1,
) -> dict[str, dict[str, Any]]:
    """
    Simulate ``runs`` starts in a ``region`` with each law; return law -> the JSON of the sweep.

    Runs are kept in ``folder``: a sweep that was interrupted goes on from there. ``region`` is
    front, beside, anywhere or around; ``jobs`` is the number of processes. A script that sweeps
    guards its main part by ``if __name__ == '__main__'``. Raises InputError if the folder has
    another sweep.
    """
    from visual_servo_epipolar.sweeping.plan import SweepPlan
    from visual_servo_epipolar.sweeping.store import drive, Store
    from visual_servo_epipolar.sweeping.summary import summaries
    from visual_servo_epipolar.sweeping.workers import local_workers

    plan = SweepPlan(
        region=region,
        runs=runs,
        source=source,
        laws=tuple(laws),
        scenario=(scenario or Scenario()).seeded(seed),
        seed=seed,
    )
    with Store(Path(folder), plan) as store:
        with local_workers(jobs) as workers:
            drive(plan, store, workers, lambda results: None)
        return summaries(plan, store)


def replay(
    bag: str | Path, *, servo: Mapping[str, Any] | None = None, from_tracks: bool = False
) -> RunLog:
    """
    Replay a bag through the tracker and the servo, and return the record of the run.

    ``servo`` are settings that replace recorded ones; ``from_tracks`` replays recorded tracks
    instead of images. Raises InputError if the bag cannot be replayed.
    """
    from visual_servo_epipolar.bags.reading.bag import Bag
    from visual_servo_epipolar.bags.reading.run import read_run
    from visual_servo_epipolar.bags.reading.topics import assign_roles
    from visual_servo_epipolar.bags.replaying import plan as planning
    from visual_servo_epipolar.bags.replaying import replay as replaying

    with Bag(Path(bag)) as opened:
        run = read_run(opened, assign_roles(opened, {}))
        overrides = planning.ReplayOverrides(
            from_tracks=from_tracks, changes={'servo': servo} if servo else {}
        )
        plan, _ = planning.plan(opened, run, overrides)
        steps = replaying.replay(opened, run, plan)
    return replaying.record(run, steps, plan)


def inspect(desired: str | Path, current: str | Path, camera: str | Path) -> Inspection:
    """
    Compare two photographs of one camera: epipoles, rotation, and whether to trust them.

    ``camera`` is a calibration file as ``visual_servo inspect --camera`` reads it. Raises
    InputError if a file cannot be read.
    """
    from visual_servo_epipolar.commands.camera_files import read_pair
    from visual_servo_epipolar.core.twoview import inspection

    images, cameras = read_pair(Path(desired), Path(current), str(camera))
    return inspection.inspect(*images, *cameras, ServoSettings())


def load_route(folder: str | Path) -> 'Route':
    """Return the route that was taught into ``folder``; raises InputError if it is damaged."""
    from visual_servo_epipolar.messages.route_folder import read_route

    return read_route(Path(folder))
