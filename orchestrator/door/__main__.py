"""The command `toppling`, and `python -m toppling`: Ctrl-C is heard before anything is imported that takes time."""

from toppling.orchestrator.interrupt import as_program
from toppling.orchestrator.safe_path import safe_as_module, safe_for_children


def main() -> None:
    """Call the verb that the command line names."""
    as_program(_call)


def _call() -> None:
    safe_for_children()
    from toppling.orchestrator.cli import call

    call()


if __name__ == "__main__":
    safe_as_module()
    main()
