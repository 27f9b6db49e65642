"""
The command ``visual_servo``, also ``python -m visual_servo_epipolar``.

numpy is loaded by what comes after.
"""

import gc
import sys

from visual_servo_epipolar.commands.ending import leave_at_once, leave_no_more


def main() -> int:
    """Run the command line and return its exit code."""
    words = [word for word in sys.argv[1:2] if not word.startswith('-')]
    leave_at_once(' '.join(['visual_servo', *words]))
    from visual_servo_epipolar.threads import one_thread

    one_thread()
    from visual_servo_epipolar.commands.main import main as run

    try:
        return run()
    finally:
        leave_no_more()
        gc.freeze()  # at the end Python would go through all modules once more, for 0.15 s


if __name__ == '__main__':
    sys.exit(main())
