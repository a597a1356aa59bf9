"""The command `toppling` that stores every moment, and dies between writing and renaming a part if it is told to."""

import os
import pathlib
import signal
import sys

FATAL_RENAME_VARIABLE = "TOPPLING_TEST_FATAL_RENAME"

if __name__ == "__main__":
    from toppling.orchestrator import cli, execution

    execution._FLUSH_S = (0.3, 0.3)
    left = int(os.environ.get(FATAL_RENAME_VARIABLE, "-1"))
    genuine_replace = pathlib.Path.replace

    def replace(self, target):
        global left
        if "part-" in self.name:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return genuine_replace(self, target)

    pathlib.Path.replace = replace
    sys.exit(cli.main())
