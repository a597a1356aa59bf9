"""The command `toppling`, and `python -m toppling`: Ctrl-C is handled before slow imports."""

from toppling.orchestrator.interrupt import as_program
from toppling.orchestrator.processes import safe_as_module, safe_for_children


def main() -> None:
    """Run the command line."""
    as_program(_call)


def _call() -> None:
    safe_for_children()
    from toppling.orchestrator.cli import call

    call()


if __name__ == "__main__":
    safe_as_module()
    main()
