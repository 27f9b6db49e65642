"""Route: a value that exists is one that can be followed."""

from dataclasses import replace
import math

import numpy as np
import pytest
from routes import key_view, route_of

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.following.follower import Confirmation
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features


@pytest.mark.parametrize('way', [0.0, -1.0, math.nan, math.inf])
def test_ways_that_do_not_rise_are_refused(way: float) -> None:
    with pytest.raises(ValueError, match='ways of key views must be finite and rise'):
        route_of(key_view(0), replace(key_view(1), way=way))


def test_a_pose_that_is_not_finite_is_refused() -> None:
    lost = replace(key_view(1), pose=np.array([0.0, math.nan, 0.0]))
    with pytest.raises(ValueError, match='pose of a key view must be three finite numbers'):
        route_of(key_view(0), lost)


@pytest.mark.parametrize(
    ('station', 'reverse', 'match'),
    [(0, False, 'begins forward'), (1, True, 'begins in reverse'), (2, False, 'one of 0 to 1')],
)
def test_a_station_that_the_direction_cannot_reach_is_refused(
    station: int, reverse: bool, match: str
) -> None:
    route = route_of(replace(key_view(0), is_station=True), *map(key_view, range(1, 3)))
    with pytest.raises(InputError, match=match):
        RouteRun(route, FollowSettings(station=station, reverse=reverse), ServoSettings())


def test_a_start_beyond_the_station_fails_with_what_to_do() -> None:
    route = route_of(key_view(0), replace(key_view(1), is_station=True), key_view(2))
    run = RouteRun(route, FollowSettings(station=0), ServoSettings(), way=1.8)
    step = run.step(route.views[0].image, 0)
    assert run.ended and 'behind; repeat the route in reverse' in step.reason


def test_a_car_keeps_to_its_curvature() -> None:
    route = route_of(*map(key_view, range(3)))
    car = ServoSettings(base='car', law='smooth', max_curvature=1.5)
    base = RouteRun(route, FollowSettings(max_speed=0.2), car).base
    assert base.max_curvature == car.drive.max_curvature == 1.5
    assert (base.limits.max_linear, base.limits.max_angular) == (0.2, car.max_angular)


def test_a_run_that_did_not_arrive_renews_nothing() -> None:
    route = route_of(*map(key_view, range(3)))
    run = RouteRun(route, FollowSettings(renewals=2), ServoSettings())
    run._confirmed[1] = Confirmation(0.0, key_view(9).image, Features())
    assert run.confirmed == 1 and run.renewed().views == route.views
