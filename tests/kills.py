"""How often a test of kills at random moments kills: a few times, or as often as CALIB_KILLS says.

Twenty times in each:

    CALIB_KILLS=20 pytest -m "slow or not slow" -k "many_kills or kills_at_random or random_kills or killed_study_ends"
"""

import os

KILLS = int(os.environ.get("CALIB_KILLS", "3"))
