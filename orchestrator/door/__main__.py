"""The command `toppling`, and `python -m toppling`: Ctrl-C is heard before anything is imported that takes time."""

from toppling.orchestrator.interrupt import as_program


def main() -> None:
    """Call the verb that the command line names."""
    as_program(_call)


def _call() -> None:
    from toppling.orchestrator.cli import call

    call()


if __name__ == "__main__":
    main()
