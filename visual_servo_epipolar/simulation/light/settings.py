"""Settings of the light: by which the photograph was taken, by which the robot drives."""

from dataclasses import dataclass
from typing import NamedTuple

from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.simulation.light.lights import CEILING, Light, LIGHTS

DAY = ('noon', 'ceiling', 'dusk', 'lamp_right', 'lamp_side')
SAME, EACH = 'same', 'each'  # each: one of DAY, by the seed
LAMPS, PICTURES, FURNITURE, STOREY = 'lamps', 'pictures', 'furniture', 'storey'


class RoomChange(NamedTuple):
    """Change of a room: the name of what changes, whether it has, and the seed of how."""

    name: str = 'none'
    has_changed: bool = False
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class LightSettings(Settings):
    """
    Light of the photograph and of the run, what changed in the room, and how a camera follows.

    What passes does so when the disturbances of the image do.
    """

    light: str = setting(
        CEILING, 'Light of the run; each: one of five, by the seed', choices=(*LIGHTS, EACH)
    )
    photograph_light: str = fixed(CEILING, 'Light of the photograph', choices=tuple(LIGHTS))
    passing_light: str = internal(
        SAME, 'Light that passes; same: none does', choices=(SAME, *LIGHTS)
    )
    passing_exposure: float = internal(
        1.0, 'Factor of the exposure that passes', low=0.1, high=10.0
    )
    changed: str = fixed(
        'none',
        'What is another in the run: a monitor shows something else, a door stands open; in a '
        'storey: lamps and windows, a third of the pictures, furniture; storey: all three',
        choices=('none', 'monitor', 'door', LAMPS, PICTURES, FURNITURE, STOREY),
    )
    changed_seed: int = internal(0, 'Seed of what changed in a storey', low=0, high=2**31 - 1)
    gamma: float = internal(
        1.0, 'Gamma of the run: grey is to the power of it, white stays white', low=0.4, high=2.5
    )
    exposure: str = setting(
        'fixed', 'Exposure: fixed, or auto as it follows the light', choices=('fixed', 'auto')
    )
    target_grey: float = internal(
        100.0, 'Mean grey that the exposure aims at', low=10.0, high=200.0
    )
    max_gain: float = internal(
        4.0, 'Largest gain of the exposure, the noise grows with it', low=1.0, high=64.0
    )
    exposure_step: float = internal(
        0.25, 'Largest step of the exposure from image to image [stops]', low=0.1, high=4.0
    )
    white_balance: str = internal(
        'fixed', 'White balance of a camera of colours', choices=('fixed', 'auto')
    )
    flicker: float = internal(0.0, 'Share of the light that flickers', low=0.0, high=1.0)
    flicker_rate: float = internal(100.0, 'Rate of the flicker [Hz]', low=1.0, high=1000.0)

    def thing(self, *, has_changed: bool) -> RoomChange:
        """Return what changes, and whether it has, in the photograph or in the run."""
        has_changed = has_changed and self.changed != 'none'
        return RoomChange(self.changed, has_changed, self.changed_seed)

    def light_of(self, seed: int) -> Light:
        """Return the light of a run with that seed."""
        return LIGHTS[DAY[seed % len(DAY)] if self.light == EACH else self.light]
