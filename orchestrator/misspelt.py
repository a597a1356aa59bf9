"""Commands and choices of the command line that suggest corrections of misspelt words."""

from typing import Any

import click

from toppling.models.spelling import nearest


class Verbs(click.Group):
    """Command group that suggests corrections of misspelt commands."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command named by the first word."""
        word = args[0]
        if self.get_command(ctx, word) is None and not word.startswith("-"):
            meant = nearest(word, self.list_commands(ctx))
            verbs = f"Did you mean '{meant}'?" if meant else f"Verbs: {', '.join(self.list_commands(ctx))}."
            ctx.fail(f"No such verb '{word}'. {verbs}")
        return super().resolve_command(ctx, args)


class OneOf(click.Choice):
    """Choice that suggests corrections of misspelt values."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a value."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            meant = nearest(str(value), self.choices)
            if meant is None:
                raise
            raise click.BadParameter(f"{error.message} Did you mean '{meant}'?", ctx, param) from None
