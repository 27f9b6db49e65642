"""Against the bound: as exact as all views allow, and as sure as it is exact."""

from map_bound import errors_of, TrialErrors
from map_study import StudySettings
import pytest

TRIALS, FEW = 40, 16


@pytest.fixture(
    scope='module',
    params=[False, pytest.param(True, marks=pytest.mark.long)],
    ids=['room', 'wall'],
)
def errors(request: pytest.FixtureRequest) -> TrialErrors:
    """Return the errors of drives through a room, or before one wall."""
    return errors_of(StudySettings(wall=request.param), range(TRIALS))


def test_every_drive_ends_with_a_pose(errors: TrialErrors) -> None:
    assert errors.silent == 0


def test_no_estimate_could_be_much_more_exact(errors: TrialErrors) -> None:
    assert (errors.rms <= 1.2 * errors.bound).all()
    assert (errors.rms >= 0.75 * errors.bound).all()  # three deviations of luck


def test_it_is_as_sure_as_it_is_exact(errors: TrialErrors) -> None:
    assert 0.9 <= errors.normalised_error <= 1.2


def test_wrong_matches_are_dropped_and_hardly_any_other(errors: TrialErrors) -> None:
    assert errors.found == errors.wrong > 100
    assert errors.innocent <= 0.005 * 57 * TRIALS


@pytest.mark.long
@pytest.mark.parametrize('wall', [False, True], ids=['room', 'wall'])
def test_as_well_where_images_are_tracked_to_hundredths_of_a_pixel(wall: bool) -> None:
    errors = errors_of(StudySettings(wall=wall, noise=0.03), range(FEW))
    assert errors.silent == 0
    assert (errors.rms <= 1.5 * errors.bound).all()  # luck of few trials
    assert 0.8 <= errors.normalised_error <= 1.25


@pytest.mark.long
@pytest.mark.parametrize('wall', [False, True], ids=['room', 'wall'])
def test_single_sightings_that_slip_are_left_out(wall: bool) -> None:
    errors = errors_of(StudySettings(wall=wall, slips=0.05), range(FEW))
    assert errors.silent == 0
    assert (errors.rms <= 1.5 * errors.bound).all()
    assert 0.8 <= errors.normalised_error <= 1.25
