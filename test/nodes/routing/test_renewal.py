"""Renewal of a route by an arrival: its folder is written, or as it was."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.logging import get_logger
from routes import key_view, route_of

from visual_servo_epipolar.core.routes.route import Appearance, in_memory, Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.messages.route_folder import read_route, write_route
from visual_servo_epipolar.nodes.routing.recording import RouteRenewal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_route(route_of(*map(key_view, range(3))), tmp_path / 'hall')
    return tmp_path / 'hall'


def after_arrival(folder: Path, renew: int) -> None:
    route = read_route(folder)
    view, rows = route.views[1], np.arange(4)
    look = Appearance(in_memory(key_view(7).image), view.keypoints.take(rows), rows)
    views = (route.views[0], replace(view, renewed=(look,)), route.views[2])

    def renewed() -> Route:
        return replace(route, views=views)

    run = SimpleNamespace(settings=FollowSettings(renewals=renew), confirmed=1, renewed=renewed)
    renewal = RouteRenewal(get_logger('test'))
    renewal.follow(run, folder)  # type: ignore[arg-type]
    renewal.begin()
    renewal.begin()  # by the next image
    renewal.wait()


@pytest.mark.parametrize('renew', [0, 2])
def test_photographs_of_today_are_written_where_that_is_wanted(folder: Path, renew: int) -> None:
    after_arrival(folder, renew)
    assert [len(view.renewed) for view in read_route(folder).views] == [0, int(renew > 0), 0]


def test_a_full_disk_leaves_the_route_as_it_was(folder: Path, monkeypatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, 'No space left on device')

    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    monkeypatch.setattr(np, 'savez_compressed', full)
    after_arrival(folder, 2)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
