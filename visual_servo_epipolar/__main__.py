"""``python -m visual_servo_epipolar`` is the command ``visual_servo``."""

import sys

from visual_servo_epipolar.commands.entry import main

sys.exit(main())
