"""What a rock says of its base by having stood a recorded shaking: a weight for each draw of the base.

Each draw is shaken with the recorded motion some times. A draw on which the rock stood k of n times lets it stand with
probability (k + 1/2) / (n + 1) (Jeffreys' prior), so that no weight becomes 0: nothing was seen to topple. Over several
motions these probabilities are multiplied. Each contact has weights of its own, as it is another hypothesis.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.arrays import Array
from toppling.models.digest import read_json, write_json
from toppling.models.documents import read_toml
from toppling.models.errors import InputError, refusals
from toppling.models.shares import effective_number, jeffreys_mean
from toppling.results.belonging import check_plan_id

FOLDER = "stood"
"""Of a run: the motions that its rock is known to have stood, their shakes, and the weights."""
FILE = "weights.json"
SCHEMA_VERSION = 1
CONTACT = ["friction_static", "friction_kinetic", "restitution"]
SAME = 1e-9
"""Share by which weights may differ and still be one."""
Contact = tuple[float, float, float]


_no_weights = refusals(
    expected="weights of the bases by the motions that the rock stood, as the run wrote them",
    remedy="go on with the run by 'toppling run': it makes them anew if they are removed",
)


@dataclass(frozen=True)
class Motion:
    """A recorded motion that the rock is known to have stood.

    Parameters
    ----------
    record_id, sha : str
    files : tuple of str
        As given by whoever knows.
    azimuths_known : bool
        Whether it is known where the components pointed; else the motion shook from all sides.
    """

    record_id: str
    sha: str
    files: tuple[str, ...]
    azimuths_known: bool


@dataclass(frozen=True, eq=False)
class Stood:
    """Weights of the draws of a base, by contact.

    Parameters
    ----------
    motions : tuple of Motion
    shakes : int
        Of each draw with each motion.
    weights : mapping
        Of each contact (static and kinetic friction, restitution) an array (draws,) whose mean is 1.
    """

    motions: tuple[Motion, ...]
    shakes: int
    weights: Mapping[Contact, Array]

    def of(self, contact: Contact) -> Array:
        """Weights under a contact.

        Raises
        ------
        InputError
            If the draws were not shaken under it.
        """
        if contact not in self.weights:
            raise InputError(
                f"no weights of the bases under friction {contact[0]:g}, {contact[1]:g} and restitution {contact[2]:g}",
                where="weights by what the rock stood",
                expected="one of " + ", ".join(f"{one}" for one in self.weights),
                remedy="begin a new run with another --out",
            )
        return self.weights[contact]

    def joined(self, other: Stood) -> Stood:
        """Weights by the motions of both, under the contacts of the other."""
        both = {contact: self.of(contact) * weights for contact, weights in other.weights.items()}
        weights = {contact: product / product.mean() for contact, product in both.items()}
        return Stood(self.motions + other.motions, self.shakes, weights)

    def refuse_twins(self, motions: Sequence[Motion]) -> None:
        """Refuse motions that these weights hold.

        Raises
        ------
        InputError
            By their names.
        """
        known = {one.sha for one in self.motions}
        if twice := [one.record_id for one in motions if one.sha in known]:
            raise InputError(
                f"the run counts {_and(twice)} already",
                where="--stood",
                expected="each shaking once, as what is told twice would count twice",
                remedy="leave it out: the run's own weights hold it",
            )

    def write(self, path: Path, plan_id: str | None = None) -> None:
        """Write the weights as JSON with its digest, and of which plan's run they are."""
        write_json(
            path,
            {
                "schema_version": SCHEMA_VERSION,
                "plan_id": plan_id,
                "shakes": self.shakes,
                "motions": [{**vars(one), "files": list(one.files)} for one in self.motions],
                "contacts": [
                    {**dict(zip(CONTACT, contact, strict=True)), "weights": weights.tolist()}
                    for contact, weights in self.weights.items()
                ],
            },
        )

    @classmethod
    def read(cls, path: Path) -> Stood:
        """Read what :meth:`write` wrote into a run.

        Raises
        ------
        InputError
            If the file is not there, not as it was written, or of another run.
        """
        try:
            told = read_json(path, required=True)
            check_plan_id(path.parent.parent, path, told.get("plan_id"))
            if told["schema_version"] != SCHEMA_VERSION:
                raise _no_weights(f"is of schema version {told['schema_version']}", path)
            weights: dict[Contact, Array] = {}
            for one in told["contacts"]:
                static, kinetic, restitution = (float(one[name]) for name in CONTACT)
                weights[static, kinetic, restitution] = np.array(one["weights"], float)
            motions = tuple(Motion(**{**one, "files": tuple(one["files"])}) for one in told["motions"])
            sound = all(
                len(each) and np.isfinite(each).all() and (each > 0).all() for each in weights.values()
            )
            if not (weights and motions and sound):
                raise _no_weights("holds no weights, or one that is not positive", path)
            return cls(motions, int(told["shakes"]), weights)
        except InputError:
            raise
        except FileNotFoundError:
            raise _no_weights("is not there", path) from None
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise _no_weights(f"is not whole ({type(error).__name__}: {error})", path) from None


def stood_of(run: Path) -> Stood | None:
    """Weights of a run's bases; None of a run whose campaign knows of no motion that its rock stood.

    Raises
    ------
    InputError
        If the campaign knows of one and the weights are not there, or are damaged.
    """
    asked = (run / FOLDER).exists()
    with contextlib.suppress(InputError, FileNotFoundError):  # damaged: who rests on the campaign says so
        asked |= "stood" in read_toml(run / "campaign.toml")
    return Stood.read(run / FOLDER / FILE) if asked else None


def weights_of(rows: pd.DataFrame, draws: int) -> dict[Contact, Array]:
    """Weights of draws by the shakes of them.

    Parameters
    ----------
    rows : DataFrame
        Rows of results; a shake without an answer tells nothing.
    draws : int
        Number of draws of the base.

    Raises
    ------
    InputError
        If a motion has no answer at all.
    """
    found = {}
    for contact, jobs in rows.groupby(CONTACT):
        chances = [_chances(str(name), shakes, draws) for name, shakes in jobs.groupby("record_id")]
        log = np.log(chances).sum(axis=0)
        weights = np.exp(np.maximum(log - log.max(), -600.0))  # the least number is still above 0
        found[tuple(map(float, contact))] = weights / weights.mean()
    return found  # type: ignore[return-value]  # of three columns


def weighed(frame: pd.DataFrame, stood: Stood) -> pd.DataFrame:
    """Rows by the weights of their bases: `base_weight`, of mean 1 over the bases in use, also within `record_weight`.

    Nothing is known of the base of the nominal scene (realisation 0), so that it has the mean weight. Where all weights
    are one, the motions tell nothing, and the frame stays as it is.
    """
    factor = pd.Series(1.0, frame.index)
    for contact, jobs in frame.groupby(CONTACT):
        drawn = jobs["base"].dropna().astype(int)
        if len(drawn):
            weights = stood.of(tuple(map(float, contact)))  # type: ignore[arg-type]  # of three columns
            factor[drawn.index] = weights[drawn.to_numpy()] / weights[drawn.unique()].mean()
    if (factor.sub(1.0).abs() < SAME).all():
        return frame
    return frame.assign(base_weight=factor, record_weight=frame.get("record_weight", 1.0) * factor)


def unweighed(frame: pd.DataFrame) -> pd.DataFrame:
    """The same rows with all bases alike; records keep their weights."""
    weight = records_weight(frame)
    bare = frame.drop(columns=["base_weight", "record_weight"], errors="ignore")
    return bare if weight is None else bare.assign(record_weight=weight)


def records_weight(frame: pd.DataFrame) -> pd.Series | None:
    """Weight that rows have by their record alone; None where records weigh alike."""
    if "record_weight" not in frame or "base_weight" not in frame:
        return frame.get("record_weight")
    weight = frame["record_weight"] / frame["base_weight"]
    return None if (weight.sub(1.0).abs() < SAME).all() else weight


def told_of(stood: Stood, frame: pd.DataFrame) -> dict[str, Any]:
    """What a program reads of the weights of a run's bases.

    Returns
    -------
    dict
        files, records, azimuths_unknown, shakes, and in `contacts` of each contact of the rows: the contact, weights
        (of mean 1, by the number of the base), bases and effective_bases.
    """
    contacts = []
    for contact, jobs in frame.groupby(CONTACT):
        used = np.sort(jobs["base"].dropna().astype(int).unique())
        weights = stood.of(tuple(map(float, contact)))[used]  # type: ignore[arg-type]  # of three columns
        contacts.append(
            {
                **dict(zip(CONTACT, map(float, contact), strict=True)),
                "weights": {
                    str(base): float(each / weights.mean()) for base, each in zip(used, weights, strict=True)
                },
                "bases": len(used),
                "effective_bases": effective_number(weights) if len(used) else 0.0,
            }
        )
    return {
        "files": sorted({file for one in stood.motions for file in one.files}),
        "records": [one.record_id for one in stood.motions],
        "azimuths_unknown": [one.record_id for one in stood.motions if not one.azimuths_known],
        "shakes": stood.shakes,
        "contacts": contacts,
    }


def sentences(told: Mapping[str, Any]) -> list[str]:
    """What a person should know of the weights (`told_of`)."""
    motions = _and(told["records"])
    several = len(told["contacts"]) > 1
    said = []
    for one in told["contacts"]:
        under = f" with friction {one['friction_static']:g}" if several else ""
        if one["bases"] - one["effective_bases"] < 1e-6:
            said.append(
                f"That the rock stood {motions} tells nothing of its base{under}: its {one['bases']} draws weigh alike"
            )
        else:
            heaviest = max(one["weights"].values()) / one["bases"]
            said.append(
                f"The rock stood {motions}: its {one['bases']} bases, weighted by how likely it stands that on "
                f"each{under}, say as much as {one['effective_bases']:.1f} equal ones; the heaviest has "
                f"{100 * heaviest:.0f} % of the weight"
            )
    if told["azimuths_unknown"]:
        said.append(
            f"Where the components of {_and(told['azimuths_unknown'])} pointed is not known: it shook from all sides"
        )
    return said


def _chances(name: str, shakes: pd.DataFrame, draws: int) -> Array:
    """Probability that the rock stands one motion on each base; on one without an answer the mean of the others."""
    known = shakes[shakes["toppled"].notna() & shakes["base"].notna()]
    if not len(known):
        messages = shakes["message"].dropna() if "message" in shakes else shakes["toppled"].dropna()
        reason = messages.mode()
        raise InputError(
            f"none of {len(shakes)} shakes with {name} has an answer"
            + (f" ({reason.iloc[0]})" if len(reason) else ""),
            where="--stood",
            expected="a motion that the engine of the run shakes the rock with",
            remedy="see 'toppling records show' of the motion, or leave it out",
        )
    base = known["base"].to_numpy(int)
    answered = np.bincount(base, minlength=draws)
    standing = np.bincount(base[~known["toppled"].to_numpy(bool)], minlength=draws)
    chance = jeffreys_mean(standing, answered)
    return np.where(answered > 0, chance, chance[answered > 0].mean())


def _and(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
