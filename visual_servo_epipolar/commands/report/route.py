"""The page on a route: the map as it was learnt, its key views, and every photograph."""

from collections.abc import Iterator
import math
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.routes.chain import path_poses, seam
from visual_servo_epipolar.core.routes.route import Bridge, Route
from visual_servo_epipolar.messages.routes.route_folder import folder_bytes, read_route
from visual_servo_epipolar.report.canvas import GREY, new_figure
from visual_servo_epipolar.report.page import (
    figure_html,
    folded_html,
    Headline,
    jpeg,
    Section,
    strip,
    table,
    write_page,
)
from visual_servo_epipolar.report.style import INK

MAP = (
    'The taught path in axes of the first photograph, x ahead of it and y to its left, as the '
    'photographs were chained; dots are key views, squares stations. Metres are those of the '
    'odometry.'
)
NEAREST = 0.1  # depth of a feature in the map, inverted [1/m]: those beyond 10 m are left out


def report_route(folder: Path, path: Path) -> None:
    """Write the page on the route in ``folder``; raises InputError if that fails."""
    route = read_route(folder)
    size_mb = 1e-6 * folder_bytes(folder)
    seams = seam(route.views)
    verdict = Headline(
        f'{route.length:.2f} m, {len(route.views)} key views, {len(route.stations)} stations',
        good=True,
        more=f'{size_mb:.1f} MB, {1e3 * size_mb / max(route.length, 1e-3):.0f} kB a metre; '
        f'neighbours disagree on the path by {1e3 * np.sqrt(np.nanmean(seams**2)):.2f} mm rms, '
        f'{1e3 * np.nanmax(seams):.2f} mm at most',
    )
    sections = [
        Section('Map', figure_html(route_map(route), MAP)),
        Section('Photographs', strip(list(_photographs(route)))),
        Section('Key views', folded_html('all of them', _key_views(route, seams.tolist()))),
    ]
    write_page(path, f'Route {folder.resolve().name}', verdict, sections)


def route_map(route: Route) -> Figure:
    """Return the taught path with its key views, and the features they know."""
    figure = new_figure(7.0, 6.0)
    axes = figure.subplots()
    points = np.concatenate([_features(route, k) for k in range(len(route.views))])
    axes.plot(*points.T, '.', color=GREY, markersize=1.0, alpha=0.5, label='features')
    path = np.array(list(path_poses(route)))
    axes.plot(path[:, 0], path[:, 1], color=INK, lw=1.6, label='taught path')
    poses = np.array([view.pose for view in route.views])
    axes.plot(poses[:, 0], poses[:, 1], 'o', color='#0072B2', markersize=4.0, label='key view')
    ends = poses[route.stations]
    axes.plot(ends[:, 0], ends[:, 1], 's', color='#D55E00', markersize=7.0, label='station')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(loc='best')
    return figure


def _features(route: Route, number: int) -> np.ndarray:
    """Return where the features of a key view are in the plane, (N, 2), but distant ones."""
    view = route.views[number]
    anchors = view.structure.anchors(route.camera).structure
    near = anchors.inverse_depth > NEAREST
    right, _, ahead = anchors.rays[:, near] / anchors.inverse_depth[near]
    x, y, theta = view.pose
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack([x + cosine * ahead + sine * right, y + sine * ahead - cosine * right], axis=1)


def _photographs(route: Route) -> Iterator[tuple[bytes, str]]:
    for number, view in enumerate(route.views):
        station = ', a station' if view.is_station else ''
        yield jpeg(view.image), f'{number}: after {view.way:.2f} m{station}'


def _key_views(route: Route, seams: list[float]) -> str:
    rows = [
        (
            number,
            view.way,
            len(view.structure),
            float(1.0 / np.median(np.maximum(view.structure.inverse_depth, 1e-3))),
            None if disagreement is None else 1e3 * disagreement,
            'yes' if view.is_station else '',
            'no' if view.bridge is None else _bridge_words(view.bridge),
        )
        for number, (view, disagreement) in enumerate(
            zip(route.views, [*seams, None], strict=True)
        )
    ]
    head = (
        'number',
        'way [m]',
        'features',
        'median depth [m]',
        'seam to the next [mm]',
        'station',
        'bridged by odometry',
    )
    return table(head, rows)


def _bridge_words(bridge: Bridge) -> str:
    turn, deviation = math.degrees(bridge.turn), 1e3 * bridge.deviation
    return f'{bridge.way:.2f} m, {turn:+.0f} deg, to {deviation:.0f} mm'
