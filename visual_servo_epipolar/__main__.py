"""``python -m visual_servo_epipolar`` is the command ``visual_servo``."""

import sys

from visual_servo_epipolar.commands.main import main

sys.exit(main())
