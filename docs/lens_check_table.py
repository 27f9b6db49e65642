"""Prints the table of docs/calibration.md on camera matrices that are wrong, and who says so."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
import sys

from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.lens_check import LensCheck, looked_at
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import view_of
from visual_servo_epipolar.sweeping.plan import SweepPlan

SCENARIOS = Path(__file__).parents[1] / 'config' / 'scenarios'
REGION, SEED, STARTS, LAW = 'front', 31, 16, 'full'
WRONG = (0.75, 0.9, 0.95, 1.05, 1.1, 1.25)  # f_hat / f
# Name of a row: the scenario, and settings of its camera.
ROWS: dict[str, tuple[str, dict[str, float]]] = {
    **{f'nominal, {ratio:g}': ('nominal', {'believed_focal_ratio': ratio}) for ratio in WRONG},
    'harsh, which has 0.95': ('harsh', {}),
    'nominal, 1': ('nominal', {}),
    'realistic, 1': ('realistic', {}),
    'one wall (flat), 1': ('flat', {}),
    'nominal at tilt 14 deg, roll 6 deg, 1': ('nominal', {'tilt': 0.25, 'roll': 0.1}),
}


@dataclass
class Watch:
    """The servo with the look at its lens beside it, as the servo node does it."""

    check: LensCheck = LensCheck()
    frame: int = 0
    deviations: float = 0.0  # by which a look contradicts at most

    def __call__(
        self, state: ServoState, observation: Observation, settings: ServoSettings
    ) -> ServoState:
        """Return the state after one more view; look at the lens as well."""
        after = step(state, observation, settings)
        if after.measurement is not None and after.memory is not None:
            so_far, self.frame = (after.measurement, after.memory), after.frame
            self.check = looked_at(self.check, observation, so_far, settings, after.frame)
        if self.check.memory is not None:
            lens = self.check.memory.lens
            self.deviations = max(self.deviations, abs(lens.log_ratio) / lens.ratio_deviation)
        return after

    @property
    def said(self) -> float:
        """The last look's f_hat / f."""
        return math.exp(self.check.memory.lens.log_ratio) if self.check.memory else 1.0


def watched(plan: SweepPlan, index: int) -> Watch:
    """Drive one run of ``plan`` until it ends or warns."""
    scenario, seed, watch = plan.scenario_of(LAW, index), plan.run_seed(index), Watch()
    start = start_in(REGION, SEED, index, scenario)
    view = view_of(scenario, plan.source, seed)
    loop = Loop(scenario.loop(start, seed), view, scenario.camera.nominal_camera)
    while not loop.monitor.done and not watch.check.doubt:
        loop.decide_by(watch)
        loop.record()
        loop.drive()
    return watch


def row(name: str) -> str:
    """Return how many runs of a row warn, and what they say."""
    file, camera = ROWS[name]
    scenario = load(SCENARIOS / f'{file}.yaml')
    plan = SweepPlan(
        region=REGION,
        runs=STARTS,
        source='features',
        laws=(LAW,),
        scenario=replace(scenario, camera=replace(scenario.camera, **camera)),
        seed=SEED,
    )
    runs = [watched(plan, index) for index in range(STARTS)]
    warned = [each for each in runs if each.check.doubt]
    if not warned:
        most = max(each.deviations for each in runs)
        return f'| {name} | 0 | - | at most {most:.1f} deviations |'
    frames = span([each.frame for each in warned], 'd')
    return f'| {name} | {len(warned)} | {frames} | {span([each.said for each in warned], ".2f")} |'


def span(values: Sequence[float], form: str) -> str:
    """Return the least and the largest of ``values``."""
    least, largest = f'{min(values):{form}}', f'{max(values):{form}}'
    return least if least == largest else f'{least} to {largest}'


def main() -> None:
    """Print the rows that are named on the command line, or else all, as they are there."""
    print(
        '| scenario, f_hat / f | runs that warn | first warning, frame | f_hat / f that it says |'
    )
    print('|---|---|---|---|')
    for name in sys.argv[1:] or ROWS:
        print(row(name), flush=True)


if __name__ == '__main__':
    sys.exit(main())
