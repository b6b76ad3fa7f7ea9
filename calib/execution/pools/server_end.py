"""What a fork server does as it ends after its parent was killed: it deletes the folder of their socket.

The parent deletes it where it ends by itself. The server, in whose environment the folder stands, preloads this module.
"""

import atexit
import os
import shutil
import time

FOLDER_VARIABLE = "CALIB_SERVER_FOLDER"  # of the server's environment
PARENT_LOOKS, PARENT_LOOK_INTERVAL = 200, 0.01  # s, whether the parent is gone


def _delete(folder: str, parent: int) -> None:
    """Delete the folder, unless the parent lives: it may use the folder for a new server."""
    for _ in range(PARENT_LOOKS):  # a process that is killed closes its pipes before it is gone
        if os.getppid() != parent:
            shutil.rmtree(folder, ignore_errors=True)
            return
        time.sleep(PARENT_LOOK_INTERVAL)


if FOLDER_VARIABLE in os.environ:
    atexit.register(_delete, os.environ.pop(FOLDER_VARIABLE), os.getppid())
