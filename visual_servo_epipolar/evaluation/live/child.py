"""
Child: a module runs as by ``python -m``, in a process that ends with the one that started it.

``python -m visual_servo_epipolar.evaluation.live.child PARENT MODULE [ARGUMENT ...]``, where
PARENT is the number of that process.
"""

import runpy
import sys

from visual_servo_epipolar.processes import end_with


def main() -> None:
    """Run the module, unless the parent has ended meanwhile."""
    _, parent, *command = sys.argv
    if end_with(int(parent)):
        sys.argv[:] = command
        runpy.run_module(command[0], run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    main()
