"""How often each test of kills at random moments kills: a few times, or as often as CALIB_KILLS says.

`python tests/benchmarks/repeat_kills.py --kills 20` runs all of them with more.
"""

import os

KILLS = int(os.environ.get("CALIB_KILLS", "3"))
