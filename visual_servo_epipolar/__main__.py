"""
The command ``visual_servo``, also ``python -m visual_servo_epipolar``.

numpy is loaded by what comes after.
"""

import sys

from visual_servo_epipolar.processes import one_thread


def main() -> int:
    """Run the command line and return its exit code."""
    one_thread()
    try:
        from visual_servo_epipolar.commands.main import main as run

        return run()
    except KeyboardInterrupt:  # while modules are loaded
        return 130


if __name__ == '__main__':
    sys.exit(main())
