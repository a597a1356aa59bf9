"""The command `toppling` that is struck by Ctrl-C, six times, at the moment when it calls what it was told."""

import importlib
import os
import signal

STRUCK_VARIABLE = "TOPPLING_TEST_STRUCK"


def strike_at(place):
    """Have the terminal's Ctrl-C come, to all processes of the session, as a function `module:name` begins."""
    module, _, names = place.partition(":")
    holder = importlib.import_module(module)
    *above, name = names.split(".")
    for each in above:
        holder = getattr(holder, each)
    genuine = getattr(holder, name)

    def struck(*arguments, **options):
        for _ in range(6):
            os.killpg(0, signal.SIGINT)
        return genuine(*arguments, **options)

    setattr(holder, name, struck)


if __name__ == "__main__":
    from toppling.orchestrator.cli import main

    strike_at(os.environ[STRUCK_VARIABLE])
    main()
