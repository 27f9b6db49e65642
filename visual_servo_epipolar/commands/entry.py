"""Where the command ``visual_servo`` begins: numpy is loaded by what comes after."""

import gc

from visual_servo_epipolar.threads import one_thread


def main() -> int:
    """Run the command line and return its exit code."""
    one_thread()
    from visual_servo_epipolar.commands.main import main as run

    try:
        return run()
    finally:
        gc.freeze()  # at the end Python would go through all modules once more, for 0.15 s
