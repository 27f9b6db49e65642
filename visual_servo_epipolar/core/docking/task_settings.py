"""Settings of docking on request: which dock this is, retries, and how long what may take."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting, Settings


@dataclass(frozen=True, kw_only=True)
class DockTaskSettings(Settings):
    """Settings of the action dock_robot: names as docking_server has them."""

    dock_id: str = setting(
        '', 'Name of the dock of the photograph; empty: that of every request', read_only=True
    )
    dock_type: str = setting(
        '', 'Type of the dock of the photograph; empty: that of every request', read_only=True
    )
    max_retries: int = setting(3, 'Further attempts after one that failed', low=0, high=100)
    initial_perception_timeout: float = setting(
        5.0, 'Longest wait for the photograph to be seen [s]', low=0.1, high=600.0
    )
    dock_approach_timeout: float = setting(
        300.0, 'Longest approach in one attempt [s]', low=1.0, high=86400.0
    )
    servo_timeout: float = setting(
        5.0, 'Longest silence of the servo while it should drive [s]', low=0.2, high=600.0
    )
    wait_for_charge: bool = setting(
        False, 'Docked is what charges, by battery_state; false: what has arrived', read_only=True
    )
    charging_threshold: float = setting(
        0.5, 'Current of battery_state above which it charges [A]', low=0.0, high=1000.0
    )
    wait_charge_timeout: float = setting(
        5.0, 'Longest wait at the dock for that current [s]', low=0.1, high=600.0
    )
