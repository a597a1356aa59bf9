"""What an object shows of itself at a prompt and in a notebook."""

from html import escape


class Described:
    """A class whose `_facts` (quantity: value in words) are its printed form, and a table in notebooks."""

    def _facts(self) -> dict[str, object]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{name}: {value}' for name, value in self._facts().items())})"
        )

    def _repr_html_(self) -> str:
        facts = {escape(name): escape(str(value)) for name, value in self._facts().items()}
        rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in facts.items())
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
