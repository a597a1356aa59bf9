"""Weights of the drawn bases and of the jobs on them, as a stage of the run determined them.

The writer (`orchestrator.studies.conditioning`) gives the reason of the weights, which is only passed on here. Each
contact has its own weights, because it is a different hypothesis.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from toppling.models.arrays import Array, effective_number
from toppling.models.errors import InputError, refusals
from toppling.models.files.digest import read_table, write_table
from toppling.models.files.documents import read_toml
from toppling.results.run_integrity import CAMPAIGN_FILE, check_plan_id
from toppling.results.schema import SCHEMA

if TYPE_CHECKING:
    import pandas as pd

WEIGHTS_FILE = "weights.parquet"
CONTACT = ["friction_static", "friction_kinetic", "restitution"]
Contact = tuple[float, float, float]

_WEIGHT = pa.field(
    "weight", pa.float64(), metadata={
        "group": "bases", "unit": "1",
        "description": "how much shares of its jobs count, 1 on average over all draws",
    },
)  # fmt: skip
_SCHEMA = pa.schema([*(SCHEMA.field(name) for name in (*CONTACT, "base")), _WEIGHT])
_NOTES = b"toppling.weights"

_no_weights = refusals(
    expected="weights of the bases, as the run wrote them",
    remedy="go on with the run by 'toppling run': it makes them again if they are removed",
)


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of the draws of a base, by contact."""

    # (draws,) with mean 1, for each contact (static and kinetic friction, restitution).
    by_contact: Mapping[Contact, Array]
    reason: str  # evidence as a clause: "the rock stood quake"
    method: str = ""  # definition of the weights for the methods section: "the probability that ..."
    remarks: tuple[str, ...] = ()  # further remarks for a reader
    evidence: Mapping[str, Any] = field(default_factory=dict)  # the evidence in machine-readable form

    def of(self, contact: Contact) -> Array:
        """Weights under a contact; InputError if there are none for it."""
        if contact not in self.by_contact:
            raise InputError(
                "run.contact_without_weights",
                f"no weights of the bases under friction {contact[0]:g}, {contact[1]:g} and restitution {contact[2]:g}",
                where=WEIGHTS_FILE,
                expected="one of " + ", ".join(f"{contact}" for contact in self.by_contact),
                remedy="begin a new run with another --out",
            )
        return self.by_contact[contact]

    def table(self) -> pa.Table:
        """Table of the weight of each base under each contact."""
        rows = [
            {**dict(zip(CONTACT, contact, strict=True)), "base": base, "weight": weight}
            for contact, weights in self.by_contact.items()
            for base, weight in enumerate(weights.tolist())
        ]
        return pa.Table.from_pylist(rows, schema=_SCHEMA)

    def write(self, run: Path, plan_id: str) -> None:
        """Write the weights into the folder of a run, with the id of its plan."""
        notes = {name: value for name, value in vars(self).items() if name != "by_contact"}
        described = {_NOTES: json.dumps({**notes, "plan_id": plan_id})}
        write_table(self.table().replace_schema_metadata(described), run / WEIGHTS_FILE)

    @classmethod
    def read(cls, run: Path) -> Weights:
        """Read the weights that :meth:`write` wrote; InputError if missing, damaged, or of another run."""
        path = run / WEIGHTS_FILE
        if not path.exists():
            raise _no_weights("run.weights_absent", "is not there", path)
        table = read_table(path)
        try:
            notes = json.loads(table.schema.metadata[_NOTES])
            check_plan_id(run, path, notes.pop("plan_id"))
            by_contact = {
                tuple(map(float, contact)): rows.sort_values("base")["weight"].to_numpy(float)
                for contact, rows in table.to_pandas().groupby(CONTACT)
            }
            sound = all(np.isfinite(weight).all() and (weight > 0).all() for weight in by_contact.values())
            if not (by_contact and sound):
                raise _no_weights(
                    "run.weights_unusable", "holds no weights, or one that is not positive", path
                )
            return cls(by_contact, **{**notes, "remarks": tuple(notes["remarks"])})  # type: ignore[arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise _no_weights(
                "run.weights_unreadable", f"is not whole ({type(error).__name__}: {error})", path
            ) from None

    def summary(self, frame: pd.DataFrame) -> dict[str, Any]:
        """JSON summary of the weights of the bases of some rows.

        Returns dict: the evidence, reason, remarks, and in `contacts` for each contact of the rows: the contact,
        weights (of mean 1, by the number of the base), bases and effective_bases.
        """
        contacts = []
        for contact, jobs in frame.groupby(CONTACT):
            used = np.sort(jobs["base"].dropna().astype(int).unique())
            weights = self.of(tuple(map(float, contact)))[used]  # type: ignore[arg-type]  # of three columns
            share = zip(map(str, used), (weights / weights.mean()).tolist(), strict=True) if len(used) else ()
            contacts.append({
                **dict(zip(CONTACT, map(float, contact), strict=True)), "weights": dict(share),
                "bases": len(used), "effective_bases": effective_number(weights) if len(used) else 0.0,
            })  # fmt: skip
        return {**self.evidence, "reason": self.reason, "remarks": list(self.remarks), "contacts": contacts}


def weights_of(run: Path) -> Weights | None:
    """Weights of a run's bases, or None if its campaign requests none; InputError if they are missing or damaged."""
    return Weights.read(run) if are_due(run) else None


def are_due(run: Path) -> bool:
    """Whether a run has weights of its bases, or its campaign requests them."""
    if any((run / name).exists() for name in (WEIGHTS_FILE, "stood")):
        return True
    try:
        return "stood" in read_toml(run / CAMPAIGN_FILE)
    except InputError:  # damaged: reported by callers that need the campaign
        return False


def weighted_rows(frame: pd.DataFrame, weights: Weights) -> pd.DataFrame:
    """Add `base_weight`, of mean 1 over the bases in use, to rows, and multiply `record_weight` by it.

    The nominal scene (realisation 0), whose base is not among the draws, has weight 1. With equal weights the frame is
    returned unchanged.
    """
    factor = frame[CONTACT[0]] * 0.0 + 1.0
    for contact, jobs in frame.groupby(CONTACT):
        drawn = jobs["base"].dropna().astype(int)
        if len(drawn):
            weight = weights.of(tuple(map(float, contact)))  # type: ignore[arg-type]  # of three columns
            factor[drawn.index] = weight[drawn.to_numpy()] / weight[drawn.unique()].mean()
    if np.allclose(factor, 1.0):
        return frame
    return frame.assign(base_weight=factor, record_weight=frame.get("record_weight", 1.0) * factor)


def unweighted_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows with equal weights of the bases; records keep their weights."""
    weight = records_weight(frame)
    bare = frame.drop(columns=["base_weight", "record_weight"], errors="ignore")
    return bare if weight is None else bare.assign(record_weight=weight)


def records_weight(frame: pd.DataFrame) -> pd.Series | None:
    """Weight of each row due to its record alone; None where records have equal weights."""
    if "record_weight" not in frame or "base_weight" not in frame:
        return frame.get("record_weight")
    weight = frame["record_weight"] / frame["base_weight"]
    return None if np.allclose(weight, 1.0) else weight


def sentences(summary: Mapping[str, Any]) -> list[str]:
    """Sentences for a reader on weights (:meth:`Weights.summary`)."""
    several = len(summary["contacts"]) > 1
    reason, found = summary["reason"], []
    for contact in summary["contacts"]:
        under = f" with friction {contact['friction_static']:g}" if several else ""
        if contact["bases"] - contact["effective_bases"] < 1e-6:
            found.append(
                f"That {reason} does not constrain its base{under}: its {contact['bases']} draws weigh alike"
            )
        else:
            heaviest = max(contact["weights"].values()) / contact["bases"]
            found.append(
                f"{reason[0].upper()}{reason[1:]}: its {contact['bases']} bases, weighted by how likely that is on each"
                f"{under}, say as much as {contact['effective_bases']:.1f} equal ones; the heaviest has "
                f"{100 * heaviest:.0f} % of the weight"
            )
    return found + list(summary["remarks"])
