"""What must be the same, bit for bit, however a run went."""

import pyarrow as pa

from toppling.results.reader import open_run
from toppling.results.schema import SCHEMA, SORT_ORDER, describe

ANSWERS = [entry.name for entry in SCHEMA if describe(entry)["group"] in ("identity", "imposed", "outcome")]


def sorted_answers(rows):
    table = rows if isinstance(rows, pa.Table) else pa.Table.from_pylist(rows, schema=SCHEMA)
    return table.sort_by([(name, "ascending") for name in SORT_ORDER]).select(ANSWERS).to_pylist()


def answers_of(folder):
    return sorted_answers(open_run(folder).table())
