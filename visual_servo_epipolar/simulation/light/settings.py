"""Settings of the light: by which the photograph was taken, by which the robot drives."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import fixed, setting, Settings
from visual_servo_epipolar.simulation.light.lights import CEILING, Light, LIGHTS

DAY = ('noon', 'ceiling', 'dusk', 'lamp_right', 'lamp_side')
EACH = 'each'  # of DAY in turn, by the seed


@dataclass(frozen=True, kw_only=True)
class LightSettings(Settings):
    """Light of the photograph and of the run, and how the camera's exposure follows it."""

    light: str = setting(
        CEILING,
        'Light of the run; each: one of five in turn, by the seed',
        choices=(*LIGHTS, EACH),
    )
    photograph_light: str = fixed(CEILING, 'Light of the photograph', choices=tuple(LIGHTS))
    exposure: str = setting(
        'fixed', 'Exposure: fixed, or auto as it follows the light', choices=('fixed', 'auto')
    )
    target_grey: float = setting(
        100.0, 'Mean grey that the exposure aims at', low=10.0, high=200.0
    )
    max_gain: float = setting(
        4.0, 'Largest gain of the exposure, the noise grows with it', low=1.0, high=64.0
    )
    exposure_step: float = setting(
        0.25, 'Largest step of the exposure from image to image [stops]', low=0.1, high=4.0
    )

    def light_of(self, seed: int) -> Light:
        """Return the light of a run with that seed."""
        return LIGHTS[DAY[seed % len(DAY)] if self.light == EACH else self.light]
