"""Sentences that summarise a fragility or a constraint at the beginning of pages and commands' output."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from toppling.models.files.documents import MOST_NAMED, listed
from toppling.results.analysis import FEW
from toppling.results.analysis.lognormal import CAUSES, Lognormal, parts_words
from toppling.results.drawing.style import LETTERS_PER_IN, digits, printed_unit, short_name, within
from toppling.results.hazard.events import Standing
from toppling.results.hazard.places import SITE_REACH_KM
from toppling.results.hazard.survival import LARGEST_FACTOR
from toppling.results.hazard.update import RATES
from toppling.results.weights import sentences


def what_topples(curve: Lognormal, contact: str, single_base: bool) -> str:
    """Sentence on the median intensity of a fragility, with its interval by cause.

    contact: words for the contact.
    single_base: whether all jobs are on the same one of the possible bases.
    """
    unit, name, strongest = printed_unit(curve.measure), short_name(curve.measure), curve.strongest_shaken
    rested = contact + (", for one of the bases that the scan allows" if single_base else "")
    if strongest is not None and curve.is_beyond_shaken:
        share = float(curve.probability(strongest))
        return (
            "The shaking that topples the rock in one case in two lies beyond what was run: the strongest had a "
            f"{name} of {digits(strongest)} {unit}, where {percent(share)} topple ({rested})."
        )
    half, twentieth = (within(curve.intensity(share), *curve.shaken) for share in (0.5, 0.05))
    return (
        f"Shaking with a {name} of {half} {unit}{interval_words(curve.numbers, *curve.shaken)} topples the "
        f"rock in one case in two, and with {twentieth} {unit} in one in twenty ({rested})."
    )


def interval_words(numbers: dict[str, Any], *shaken: float | None) -> str:
    """The median's 95 % interval with its parts, in brackets after a space; empty where unknown.

    numbers: `Lognormal.numbers`, perhaps among other fields of a statement.
    shaken: `Lognormal.shaken`.
    """
    if numbers.get("median_low") is None:
        return ""
    low, high = (within(numbers[f"median_{end}"], *shaken) for end in ("low", "high"))
    parts = parts_words({name: numbers[f"median_{name}"] for name in CAUSES if f"median_{name}" in numbers})
    return f" (95 %: {low} to {high}{'; ' if parts else ''}{parts})"


LEAST_FRACTION = 5e-4
"""Smallest fraction of a toppling rate or of weight that is reported: 0.1 % after rounding."""

_LEAST_AGE_YEARS = 100.0
"""Age below which a unit of thousands of years is suggested, years: fragile rocks stand for thousands of years."""

_FIRST_RATES = (1e-4, *sorted(RATES))
"""Annual rates for the first sentence, by precedence: the first within both prior and posterior hazard is used."""

_VARY = {
    "event": "other events", "age": "other ages",
    "joint rate": "other scatters of the two measures",
}  # fmt: skip

_OUTSIDE = {
    "unstated_above": "beyond the curve's last point",
    "unstated_below": "below its first point, if its initial slope continues",
}
"""Descriptions of the fractions of a toppling rate from outside a hazard curve's points."""


def answer(statement: dict[str, Any]) -> list[str]:
    """Result in a few sentences: the posterior hazard, and the largest allowed scale factors."""
    if "branches" not in statement:
        return []
    alive, counts = [branch["survival"] for branch in statement["branches"]], statement["decided"]
    several, at = len(alive) > 1, f"at {100 * statement['confidence']:g} %"
    standing = "the standing rock" if len(statement["rocks"]) == 1 else "the standing rocks"
    out, open_ = counts["branches_inconsistent"], counts["branches_undecided"]
    if not several or out == len(alive):
        best = max(statement["branches"], key=lambda branch: branch["survival"])
        low, high = best.get("survival_low"), best.get("survival_high")
        drawn = "" if low is None else f" (95 %: {_change(low, high)})"
        every = "Both" if out == 2 else f"All {out}"
        verdict = (
            f"{every} branches of the hazard are inconsistent with {standing} {at}: survival is at most"
            if several
            else f"Whether the hazard is consistent with {standing} {at} is undecided: survival is"
            if open_
            else f"The hazard is {best['verdict']} with {standing} {at}: survival is"
        )
        if open_:
            drawn += (
                f" by the rates within the curve's points, {percent(best['survival_least'])} with those that may lie "
                "outside: give a curve that extends further"
            )
        return [f"{verdict} {percent(best['survival'])}{drawn}.", _allowed(statement)]
    weight = f", with {percent(counts['weight_inconsistent'])} of the prior weight" if out else ""
    more = f", {open_} undecided by rates outside the curve (give one that extends further)" if open_ else ""
    first = (
        f"{out or 'None'} of the {len(alive)} branches {'are' if out > 1 else 'is'} inconsistent with {standing} "
        f"{at}{weight}{more}: survival is {percent(counts['survival_mean_of_branches'])} on average, "
        f"{percent(min(alive))} to {percent(max(alive))} by branch."
    )
    before, after = (f"{counts[f'effective_branches_{when}']:.3g}" for when in ("prior", "posterior"))
    weighed = f"The branch set counts as {before} equal branches by its prior weights, {after} by the posterior ones."
    lines = [first, *_falls(statement), _allowed(statement), weighed if after != before else ""]
    return list(filter(None, lines))


def by_site_and_measure(
    rows: Sequence[dict[str, Any]], measure: str
) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """Group rows by site and measure, in order; rows without these belong to one site and the given measure."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row.get("site", ""), row.get("measure", measure)), []).append(row)
    return groups


def _falls(statement: dict[str, Any]) -> list[str]:
    """Sentences on the change of the motion at a rate, one per site and measure."""
    groups = by_site_and_measure(statement["changes"], statement["measure"])
    several = len({site for site, _ in groups}) > 1
    return [
        (f"At {site}: " if several else "") + line
        for (site, measure), rows in list(groups.items())[:MOST_NAMED]
        if (line := _fall({**statement, "changes": rows, "measure": measure}))
    ]


def _fall(statement: dict[str, Any]) -> str:
    """Sentence on the change of the motion at a rate; empty where no rate is reached or supported."""
    by_rate = {row["annual_rate"]: row for row in statement["changes"]}
    for rate in _FIRST_RATES:
        row = by_rate[rate]
        before, after = row["level_prior_mean"], row["level_posterior_mean"]
        if before is None or after is None:
            continue
        unit, measure = printed_unit(statement["measure"]), short_name(statement["measure"])
        change = row["level_change_percent"]
        goes = "stays at" if abs(change) < 0.5 else "falls from" if change < 0 else "rises from"
        least, most = (digits(row[f"level_posterior_{end}"]) for end in ("p05", "p95"))
        spread = f" (5-95 %: {least} to {most})" if least and most and least != most else ""
        level = f"{'' if goes == 'stays at' else f'{digits(before)} to '}{digits(after)} {unit}"
        low, high = (digits(row[f"level_posterior_mean_{end}"]) for end in ("low", "high"))
        others = f"; it would be {low} to {high} with {_varying(statement)} (95 %)" if low != high else ""
        return f"The {rate_words(rate)} {measure} of the mean hazard {goes} {level}{spread}{others}."
    return ""


def rate_words(rate: float) -> str:
    """Label of an annual rate: 1e-4, or the return period where it is not a power of ten."""
    power = math.log10(rate)
    return f"1e{power:.0f}" if abs(power - round(power)) < 1e-9 else f"{1 / rate:,.0f}-year"


def _allowed(statement: dict[str, Any]) -> str:
    """Sentence on the largest factors by which the mean hazard, or the single curve, may be scaled."""
    of = statement["mean"]
    which = "the hazard" if len(statement["branches"]) == 1 else "the mean hazard"
    least = f"{100 * (1.0 - statement['confidence']):.3g} %"
    if of["scale_factor"] is None:
        return f"However strong {which}'s motions were, survival would stay above {least}: there are too few events."
    allowed = "already too strong" if of["scale_factor"] < 1 else "compatible as it is"
    allowed += " within its points" * (statement["decided"]["branches_undecided"] > 0)
    return (
        f"The motions of {which} may be multiplied by at most {with_ends(of, 'scale_factor', level=', 95 %')}, or "
        f"its rates by {with_ends(of, 'rate_factor', level=', 95 %')}, for survival to stay above {least}: it is "
        f"{allowed}."
    )


def with_ends(row: dict[str, Any], name: str, words: Callable[[float], str] = digits, level: str = "") -> str:
    """Format a factor or a probability of a statement with its interval, if known, in brackets."""
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    if value is None or value > LARGEST_FACTOR:
        return "any factor"
    if low is None:
        return words(value)
    upper = "or more" if high is None or high > LARGEST_FACTOR else f"to {words(high)}"
    return f"{words(value)} ({words(low)} {upper}{level})"


def percent(share: float) -> str:
    """Format a probability or weight as percentage, without figures of one too small to matter.

    Examples
    --------
    >>> percent(0.5), percent(0.1204), percent(1.0), percent(0.0), percent(3e-5)
    ('50.0 %', '12.0 %', '100 %', '0 %', 'less than 0.01 %')
    """
    if share == 0.0:
        return "0 %"
    return "less than 0.01 %" if 0.0 < share < 1e-4 else f"{digits(100 * share)} %"


def _change(first: float, last: float) -> str:
    return " to ".join(dict.fromkeys(map(percent, (first, last))))


def other_records(statement: dict[str, Any]) -> str:
    """Sources of the fragilities' uncertainty: records, and the bases that their jobs are on."""
    bases = any("median_base" in rock for rock in statement["rocks"])
    return f"other records {'and bases ' if bases else ''}like these"


def _varying(statement: dict[str, Any]) -> str:
    names = {"fragility": other_records(statement), **_VARY}
    return " and ".join(names[name] for name in statement["intervals_carry"])


def all_words(statement: dict[str, Any]) -> list[str]:
    """Complete statement in words, one sentence per line: the answer, then what it rests on."""
    return [*answer(statement), *what_it_rests_on(statement)]


def what_it_rests_on(statement: dict[str, Any], *, branches: bool = True) -> list[str]:
    """Sentences on rocks, hazard, branches, events and rates."""
    lines = _rock_lines(statement)
    if "hazard" in statement and statement["hazard_ratio"] == 1.0:
        component = statement["hazard"]["component"]
        stated = f", though its files say {component}" if component else ""
        lines.append(
            "The hazard is taken to be for the peak of the horizontal vector (SA: the largest of all azimuths)"
            f"{stated}; give --ratio if it is for another component."
        )
    if "branches" in statement:
        lines.append(
            "If the hazard is ergodic, each of its earthquakes has another site term, although the rock's site has "
            "one: survival is then understated. Branches of site terms, with single-station sigma, are exact."
        )
        lost = max(sum(branch.get(name, 0.0) for name in _OUTSIDE) for branch in statement["branches"])
        if lost > 0.01:
            lines.append(
                f"Up to {percent(lost)} of a branch's toppling rate may lie outside its points: not counted."
            )
    lines += [
        *(_branch_lines(statement) if branches else ()),
        *_tree_lines(statement),
        *_event_lines(statement),
    ]
    for row in statement.get("rates", ())[9::10]:
        unit, measure = printed_unit(statement["measure"]), short_name(statement["measure"])
        lines.append(
            f"{measure} of {digits(row[statement['measure']])} {unit} or more is inconsistent at return periods below "
            f"{row['inconsistent_return_years']:,.0f} years."
        )
    return [*lines, *(f"Note: {note}." for note in statement.get("notes", ()))]


def age_words(rock: dict[str, Any]) -> str:
    """Clause on a rock's stated age; empty without an age."""
    if not rock.get("age"):
        return ""
    years = rock["age_years"]
    in_ka = f": is that in ka? Then give --age '{years:g} ka'" if years < _LEAST_AGE_YEARS else ""
    return f", stood for {rock['age']}{in_ka}"


def ages_words(rocks: Sequence[Standing], width_in: float = math.inf) -> str:
    """Line on the ages of rocks, of each if the width allows; empty without ages."""
    ages = {rock.name: rock.age for rock in rocks if rock.age}
    if len(set(ages.values())) == 1:
        return f"standing for {next(iter(ages.values()))}"
    by_rock = "; ".join(f"{name}: {age}" for name, age in ages.items())
    return by_rock if len(by_rock) <= LETTERS_PER_IN * width_in else f"{len(ages)} rocks, each with its age"


def _rock_lines(statement: dict[str, Any]) -> list[str]:
    """Lines on the rocks, their single-event constraint, and its basis."""
    lines: list[str] = []
    for rock in statement["rocks"]:
        lines += filter(None, (_rock_line(rock, statement["measure"]), rock.get("narrowed_by")))
    if "unexceeded" in statement:
        lines += _single_event_lines(statement)
    unit = printed_unit(statement["measure"]) if "unexceeded" in statement else ""
    for rock in statement["rocks"]:
        lines += _reservations(rock, statement.get("unexceeded"), unit)
    if site := statement.get("random_rock"):
        low, high, beyond = site["median_low"], site["median_high"], site["beyond"]
        upper = "or more" if high is None else f"to {within(high, beyond)}"
        ends = "" if low is None else f" ({within(low, beyond)} {upper}, 95 %)"
        lines.append(
            "One fragility of the site, of a rock drawn at random: median "
            f"{within(site['median'], beyond)} {unit}{ends}, beta {site['beta']:.2f} "
            f"({site['beta_within']:.2f} within a rock, {site['beta_between']:.2f} between rocks)"
        )
    if statement.get("ages_independent"):
        lines.append("The ages of the rocks are taken as independent, as if each had been dated separately.")
    return lines


def _rock_line(rock: dict[str, Any], measure: str) -> str:
    """Line on a rock's fragility, with its age or location where stated."""
    away = rock.get("site_distance_km")
    return (
        f"{rock['name']}: {fragility_words(rock, measure)}{age_words(rock)}"
        + (f", at {rock['site']}" if "site" in rock else "")
        + ("" if away is None else f", {away:.1f} km from --site")
    )


def fragility_words(rock: dict[str, Any], measure: str) -> str:
    """Describe the fragility of a statement's rock."""
    shaken = rock.get("strongest_shaken"), rock.get("weakest_shaken")
    words = rock.get("fragility") or (
        f"median {short_name(measure)} {within(rock['median'], *shaken)} {printed_unit(measure)}"
        f"{interval_words(rock, *shaken)}, beta {rock['beta']:.2f}"
    )
    return f"{words} ({rock['toppled']:,} topplings in {rock['jobs']:,} jobs)" if rock.get("jobs") else words


def _single_event_lines(statement: dict[str, Any]) -> list[str]:
    """Lines on the intensity that no single event exceeded, with its uncertainty."""
    unit, measure = printed_unit(statement["measure"]), short_name(statement["measure"])
    stood = "the rock has stood" if len(statement["rocks"]) == 1 else "the rocks have stood"
    if statement["unexceeded_low"] is None:
        interval = (
            "the uncertainty from the choice of records is unknown, which needs a run with enough records"
        )
    else:
        high = statement["unexceeded_high"]
        unfit = max(rock["samples_without_fit"] for rock in statement["rocks"])
        count = max(rock["samples"] for rock in statement["rocks"])
        interval = (
            f"95 %: {digits(statement['unexceeded_low'])} {'or more' if high is None else f'to {digits(high)}'} with "
            f"{other_records(statement)}"
            + (f"; {unfit} of {count} bootstrap samples have no fit and count as unbounded" if unfit else "")
        )
    lines = [
        f"At {100 * statement['confidence']:g} % confidence no single event's {measure} has exceeded "
        f"{digits(statement['unexceeded'])} {unit} while {stood} ({interval})."
    ]
    if (apart := statement.get("rocks_apart_km", 0.0)) > SITE_REACH_KM:
        lines.append(f"  they stand up to {apart:,.0f} km apart, and are taken to have felt the same events")
    for rock in statement.get("stood", ()):
        lines += [f"  {sentence}" for sentence in sentences({**rock, "contacts": [rock]})]
        if rock["median_shift_percent"]:
            lines.append(
                f"  with equal weights the median of {rock['rock']} would be {digits(rock['median_bases_alike'])} "
                f"{unit}: the weights shift it by {rock['median_shift_percent']:+.1f} %"
            )
    return lines


def _reservations(rock: dict[str, Any], unexceeded: float | None, unit: str) -> list[str]:
    """Caveats of a rock's curve: jobs without an answer, and extrapolation."""
    lines = []
    if rock.get("without_answer"):
        jobs = rock["without_answer"] + rock["jobs"]
        lines.append(
            f"  {rock['without_answer']:,} of {jobs:,} jobs of {rock['name']} have no answer and are left out: "
            "jobs near the threshold rock longest and most often lack one"
        )
    if unexceeded is None:
        return lines
    if "strongest_shaken" not in rock:
        lines.append(
            f"  the jobs behind the curve of {rock['name']} are unknown, so this may be an extrapolation"
        )
    elif unexceeded > rock["strongest_shaken"]:
        lines.append(
            f"  this extrapolates beyond the strongest shaking of {rock['name']}, "
            f"{digits(rock['strongest_shaken'])} {unit} ({rock['records']} records)"
        )
    return lines


def _branch_lines(statement: dict[str, Any]) -> list[str]:
    """Lines on all branches if they are few, or else those that the rocks favour most and least."""
    branches = sorted(statement.get("branches", ()), key=lambda branch: -branch["survival"])
    if not branches:
        return []
    few = len(branches) <= MOST_NAMED
    lines, at = [], f"at {100 * statement['confidence']:g} %"
    for branch in branches if few else [*branches[: MOST_NAMED - 1], branches[-1]]:
        weights = ""
        if len(branches) > 1 and branch["posterior_weight"] is not None:
            weights = (
                f"; prior to posterior weight {_change(branch['prior_weight'], branch['posterior_weight'])}"
            )
        lines.append(
            f"{branch['name']}: topples at {branch['toppling_rate']:.2e} a year, "
            f"survival {percent(branch['survival'])}, {branch['verdict']} {at}{weights}"
        )
        if few:
            lines += [*_reserved(branch, statement), *_taken_at(branch)]
    if not few:
        lines.append(
            f"  and {len(branches) - MOST_NAMED} branches between the last two: in branches.csv (--out) and --json"
        )
        lines += _taken_at(branches[0])
    return lines


def _tree_lines(statement: dict[str, Any]) -> list[str]:
    """Lines on the changed choices of a logic tree, and on contributions to the toppling rate."""
    lines = []
    for level in dict.fromkeys(row["level"] for row in statement.get("levels", ())):
        rows = [row for row in statement["levels"] if row["level"] == level]
        if rows[0]["moved"] < LEAST_FRACTION:
            continue
        lines.append(
            f"logic-tree level {level}: the rocks move {percent(rows[0]['moved'])} of its weight ("
            + ", ".join(f"{r['choice']} {_change(r['prior_weight'], r['posterior_weight'])}" for r in rows)
            + ")"
        )
    if parts := [part for part in statement.get("parts", ()) if (part["share"] or 0.0) >= LEAST_FRACTION]:
        named = ", ".join(f"{percent(part['share'])} is from {part['part']}" for part in parts)
        lines.append(f"Of the toppling rate, {named}.")
    return lines


def _taken_at(branch: dict[str, Any]) -> list[str]:
    """Line on the site of a branch's curve and its distance from the requested site."""
    named = [branch["site_name"]] if branch.get("site_name") else []
    if "site_longitude_deg" in branch:
        place = f"longitude {branch['site_longitude_deg']:g}, latitude {branch['site_latitude_deg']:g}"
        away = branch.get("site_distance_km")
        named += [place] if away is None else [place, f"{away:.1f} km from --site"]
    return [f"  taken at {', '.join(named)}"] if named else []


def _reserved(branch: dict[str, Any], statement: dict[str, Any]) -> list[str]:
    """Caveats of a branch's survival: interval over draws, and rates outside its curve's points."""
    low, high, least = branch["survival_low"], branch["survival_high"], 1.0 - statement["confidence"]
    lines = []
    if low is not None:
        hangs = "; the verdict depends on them" if low < least <= high else ""
        lines.append(f"  survival {_change(low, high)} with {_varying(statement)} (95 %){hangs}")
    for name, where in _OUTSIDE.items():
        if (share := branch.get(name, 0.0)) > 0.01:
            lines.append(f"  {100 * share:.0f} % of its toppling rate may lie {where}: not counted")
    if branch["verdict"] == "undecided":
        lines.append(f"  including it, survival would be {percent(branch['survival_least'])}")
    return lines


def _event_lines(statement: dict[str, Any]) -> list[str]:
    """Lines on a set of events: number of events, agreement of ground-motion models, and leave-one-out predictions."""
    if "events" not in statement:
        return []
    branches, models = statement["branches"], statement["models"]
    of = "1 branch" if len(branches) == 1 else f"{len(branches)} branches"
    lines = [f"This rests on {statement['events']:,} events of {of}."]
    if not any(row["level_prior_mean"] for row in statement["changes"]):
        lines.append(
            f"Fewer than ten events support a rate of {rate_words(RATES[0])} or less: none is stated."
        )
    few = [row["name"] for row in branches if 0 < row["effective_events"] < FEW]
    none = [row["name"] for row in branches if row["effective_events"] == 0]
    if few:
        lines.append(f"Fewer than {FEW} events bear the toppling rate of {listed(few)}: simulate more years.")
    if none:
        lines.append(
            f"No event topples under {listed(none)}: its true rate may be up to 3 events in the time simulated."
        )
    best, least = models[0], models[-1]
    if len(models) > 1 and best["bayes_factor"] is None:
        lines.append("The rocks survive under no ground-motion model, so that none can be preferred.")
    elif len(models) > 1:
        lines.append(
            f"Of {len(models)} ground-motion models {best['model']} agrees best, {best['bayes_factor']:.2g} times the "
            f"average; the least, {least['model']}, {least['bayes_factor']:.2g} times."
        )
    predicted = {row["left_out"]: row["survival_predicted"] for row in statement["left_out"]}
    return lines + [
        f"Without {name}: the other rocks predict that it stands with {percent(chance or 0.0)}"
        for name, chance in predicted.items()
    ]
