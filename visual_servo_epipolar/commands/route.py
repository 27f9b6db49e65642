"""Routes on the command line: learnt from a bag, or taught, repeated and judged in simulation."""

import argparse
from dataclasses import asdict, replace
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.console import Progress, written_to
from visual_servo_epipolar.commands.outputs import publish, write_json
from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError, InputError
from visual_servo_epipolar.core.routes.chain import seam
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.messages.route_folder import (
    check_folder,
    folder_bytes,
    read_route,
    write_route,
)

if TYPE_CHECKING:
    from visual_servo_epipolar.simulation.routes import RepeatLog, Taught

FOLDER = 'route'  # within that of a demo
# Of a base without limits of its own: the lower limit holds.
AS_FAST = {'max_linear': FollowSettings.max_speed, 'max_angular': FollowSettings.max_turn_rate}


def run(options: argparse.Namespace) -> int:
    """Run the action that was asked for."""
    return {'teach': teach, 'demo': demo}[options.action](options)


def teach(options: argparse.Namespace) -> int:
    """Learn a route from a bag, and write its folder."""
    from visual_servo_epipolar.bags.reading.bag import Bag
    from visual_servo_epipolar.bags.reading.topics import parse
    from visual_servo_epipolar.bags.route_images import RecordedWay
    from visual_servo_epipolar.commands.camera_files import read_camera

    folder = Path(options.out or f'{Path(options.bag).name}_route')
    check_folder(folder)
    kind = {'rectified': options.rectified, 'cropped': options.cropped}
    camera = None if options.camera is None else read_camera(options.camera, **kind)
    with Bag(Path(options.bag)) as bag:
        way = RecordedWay(
            bag,
            parse(options.topics),
            odometry=options.odometry,
            camera=camera,
            projection=options.projection,
            **kind,
        )
        teacher = Teacher(way.camera)
        try:
            for image, stamp_ns, pose in way.images():
                teacher.add(image, stamp_ns, pose)
            route = teacher.finish()
        except DegenerateGeometryError as error:
            raise DegenerateGeometryError(
                f'{options.bag}: no route comes of it: {error}'
            ) from None
        except ValueError as error:
            raise InputError(f'{options.bag}: no route can be learnt: {error}') from None
    notes = [*way.notes, *(f'{options.bag}: {note}' for note in teacher.notes)]
    write_route(route, folder)
    result = {**summary_of(route, folder), 'notes': notes}
    lines = [*notes, _sentence(result), f'written to {folder}']
    for k, part in enumerate(teacher.further if options.parts else (), start=2):
        place = folder.with_name(f'{folder.name}_{k}')
        write_route(part, place)
        lines += [_sentence(summary_of(part, place)), f'written to {place}']
    publish(result, '\n'.join(lines), options.json)
    return 0


def summary_of(route: Route, folder: Path) -> dict[str, Any]:
    """Return what a route is like, for JSON."""
    return {
        'length_m': route.length,
        'key_views': len(route.views),
        'stations': route.stations,
        'renewed': sum(len(view.renewed) for view in route.views),
        'seam_rms_m': _rms(seam(route.views)),
        'features': float(np.median([len(view.structure) for view in route.views])),
        'folder_bytes': folder_bytes(folder),
    }


def _sentence(result: dict[str, Any]) -> str:
    return (
        f'{result["length_m"]:.2f} m, {result["key_views"]} key views of '
        f'{result["features"]:.0f} features, {1e-6 * result["folder_bytes"]:.1f} MB; neighbours '
        f'disagree by {1e3 * result["seam_rms_m"]:.2f} mm rms'
    )


def demo(options: argparse.Namespace) -> int:
    """Teach a way in the simulated storey, repeat it from its folder, and judge by the truth."""
    from visual_servo_epipolar.simulation import routes

    settings = FollowSettings(
        reverse=options.reverse, laps=options.laps, renewals=options.renewals
    )
    scene = 1 if options.scene is None else options.scene
    scenario = routes.route_scenario(scenario_of(options, **AS_FAST), scene)
    folder = Path(options.out) / FOLDER
    check_folder(folder)
    progress = Progress()
    progress.say('building the storey, teaching ...')
    taught = routes.teach(scenario, routes.way_named(options.way))
    write_route(taught.route, folder)
    taught = replace(taught, route=read_route(folder))
    progress.say('repeating ...')
    logs = []
    for seed in range(options.seed + 1, options.seed + 1 + options.runs):
        world = routes.world_of(scenario.seeded(seed), options.world, seed)
        logs.append(log := routes.repeat(world, taught, settings))
        if log.route is not None:
            write_route(log.route, folder)
            taught = replace(taught, route=read_route(folder))
        progress.say(f'repetition {len(logs)} of {options.runs}: {logs[-1].outcome}')
    progress.say('kidnapping ...')
    world = routes.world_of(scenario, options.world, options.seed)
    kidnaps = routes.kidnap(world, taught, options.kidnaps, options.seed)
    other = routes.route_scenario(scenario, scene + 1)
    elsewhere = routes.kidnap_elsewhere(other, taught, options.elsewhere, options.seed)
    progress.close()
    result = {
        **_judged(taught, logs, folder, settings.max_turn_rate),
        'kidnapped': asdict(kidnaps),
        'elsewhere': asdict(elsewhere),
    }
    write_json(result, str(Path(options.out) / 'result.json'))
    publish(result, _report(result, options.out), options.json)
    return 0 if result['outcome'] == 'arrived' else 1


def _judged(
    taught: 'Taught', logs: 'list[RepeatLog]', folder: Path, max_turn_rate: float
) -> dict[str, Any]:
    offsets = np.abs(np.concatenate([log.offsets for log in logs]))
    p95, largest = np.percentile(offsets, [95.0, 100.0]) if len(offsets) else (math.nan, math.nan)
    failed = [log for log in logs if log.outcome != 'arrived']
    return {
        'outcome': 'failed' if failed else 'arrived',
        'reason': failed[0].reason if failed else '',
        'runs': len(logs),
        'arrived': len(logs) - len(failed),
        'wrong': sum(log.is_wrong for log in logs),
        **summary_of(taught.route, folder),
        'duration_s': logs[0].duration_s,
        'lateral_rms_m': _rms(offsets),
        'lateral_p95_m': float(p95),
        'lateral_max_m': float(largest),
        'max_turn_jump': max(log.turn_jump(max_turn_rate) for log in logs),
        'stations': [
            {'position_error_m': off, 'heading_error_deg': math.degrees(turned)}
            for off, turned in (log.station for log in logs)
        ],
        'laps': [{'lateral_rms_m': _rms(lap)} for log in logs for lap in log.laps()],
        'standstills': max(log.standstills for log in logs),
    }


def _largest(values: list[float]) -> float:
    """Return the largest of numbers, nan where none is known: of runs that did not arrive."""
    return max((value for value in values if not math.isnan(value)), default=math.nan)


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.nanmean(np.square(values)))) if len(values) else math.nan


def _report(result: dict[str, Any], out: str) -> str:
    stations = [1e3 * each['position_error_m'] for each in result['stations']]
    headings = [abs(each['heading_error_deg']) for each in result['stations']]
    reason = f': {result["reason"]}' if result['reason'] else ''
    jump = 100.0 * result['max_turn_jump']
    kidnapped = 'kidnapped {tried} times: {right} right, {refused} refused, {wrong} wrong'
    elsewhere = 'in another storey {tried} times: {refused} refused, {wrong} wrong'
    lines = [
        f'{result["arrived"]} of {result["runs"]} arrived{reason}',
        f'{result["wrong"]} silently wrong; {result["standstills"]} standstills at most',
        _sentence(result),
        f'off the taught way: {1e3 * result["lateral_rms_m"]:.2f} mm rms, p95 '
        f'{1e3 * result["lateral_p95_m"]:.2f}, at most {1e3 * result["lateral_max_m"]:.2f} mm',
        f'at the station: {_largest(stations):.2f} mm and {_largest(headings):.3f} deg at most',
        f'largest jump of w at a key view: {jump:.1f} % of max_turn_rate',
        kidnapped.format(**result['kidnapped']),
        elsewhere.format(**result['elsewhere']),
        written_to(out, [FOLDER, 'result.json']),
    ]
    return '\n'.join(lines)
