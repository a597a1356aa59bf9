"""What standing rocks say, under curves of hazard or a set of events, in words: the answer, then what it rests on."""

import math
from typing import Any

from toppling.models.files.documents import listed
from toppling.results.drawing.style import printed_unit, short_name, unit_of
from toppling.results.hazard.places import SITE_REACH_KM
from toppling.results.hazard.update import RATES
from toppling.results.weights import sentences

_MOST_NAMED = 6
"""Branches that are stated one by one, at most."""

_LEAST_AGE_YEARS = 100.0
"""Fragile rocks are thousands of years old: a lower number is probably in thousands of years."""

_FIRST_RATES = (1e-4, *sorted(RATES))
"""Annual rates that the first line may be about: it takes the first that the hazard reaches before and after."""

_VARY = {
    "event": "other events", "fragility": "other records like these", "age": "other ages",
    "joint rate": "other scatters of the two measures",
}  # fmt: skip


def answer(statement: dict[str, Any]) -> list[str]:
    """The answer in a few sentences: what the hazard becomes, and what the rocks allow at most."""
    if "branches" not in statement:
        return []
    lines = [line for line in (*_falls(statement), _allowed(statement)) if line]
    counts, several = statement["decided"], len(statement["branches"]) > 1
    if several:
        alive = [branch["survival"] for branch in statement["branches"]]
        lines.append(
            f"Survival under the {len(alive)} branches is {_percent(counts['survival_mean_of_branches'])} on average, "
            f"{_percent(min(alive))} to {_percent(max(alive))}; {counts['branches_rejected'] or 'none'} of them "
            f"{'are' if counts['branches_rejected'] > 1 else 'is'} rejected at {100 * statement['confidence']:g} %"
            + (
                f", with {_percent(counts['weight_rejected'])} of the weight"
                if counts["branches_rejected"]
                else ""
            )
            + "."
        )
        if counts["effective_branches_posterior"] is not None:
            lines.append(
                f"The weights count as {counts['effective_branches_prior']:.3g} equal branches before, and "
                f"{counts['effective_branches_posterior']:.3g} after: that is how much the rocks decide."
            )
    return lines


def _falls(statement: dict[str, Any]) -> list[str]:
    """How the motion at a rate falls: at each site, in each measure, where there are several."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in statement["changes"]:
        groups.setdefault((row.get("site", ""), row.get("measure", statement["measure"])), []).append(row)
    several = len({site for site, _ in groups}) > 1
    return [
        (f"At {site}: " if several else "") + line
        for (site, measure), rows in list(groups.items())[:_MOST_NAMED]
        if (line := _fall({**statement, "changes": rows, "measure": measure}))
    ]


def _fall(statement: dict[str, Any]) -> str:
    """How the motion at a rate falls; empty for a single branch, whose weight cannot change."""
    if len(statement["branches"]) < 2:
        return ""
    by_rate = {row["annual_rate"]: row for row in statement["changes"]}
    for rate in _FIRST_RATES:
        row = by_rate[rate]
        before, after = row["level_prior_mean"], row["level_posterior_mean"]
        if before is None or after is None:
            continue
        unit, measure = printed_unit(statement["measure"]), short_name(statement["measure"])
        change = row["level_change_percent"]
        goes = "stays at" if abs(change) < 0.5 else "falls from" if change < 0 else "rises from"
        spread = "" if None in (row["level_posterior_p05"], row["level_posterior_p95"]) else (
            f" (5-95 %: {row['level_posterior_p05']:.3g} to {row['level_posterior_p95']:.3g})"
        )  # fmt: skip
        level = f"{after:.3g} {unit}" if goes == "stays at" else f"{before:.3g} to {after:.3g} {unit}"
        others = "" if row["level_posterior_mean_low"] is None else (
            f"; the mean would be {row['level_posterior_mean_low']:.3g} to {row['level_posterior_mean_high']:.3g} with "
            f"{_varying(statement)} (95 %)"
        )  # fmt: skip
        return f"The {rate_words(rate)} {measure} {goes} {level}{spread}{others}."
    return ""


def rate_words(rate: float) -> str:
    """A rate as analysts call it: 1e-4, or the return period where it is no power of ten."""
    power = math.log10(rate)
    return f"1e{power:.0f}" if abs(power - round(power)) < 1e-9 else f"{1 / rate:,.0f}-year"


def _allowed(statement: dict[str, Any]) -> str:
    """Factors that the mean of the branches, or the one curve, may be multiplied by."""
    of = statement["mean"]
    which = "the hazard" if len(statement["branches"]) == 1 else "the branches' mean"
    least = _percent(1.0 - statement["confidence"])
    if of["scale_factor"] is None:
        return f"However strong {which}'s motions were, survival would stay above {least}: there are too few events."
    allowed = "already too strong" if of["scale_factor"] < 1 else "compatible as it is"
    return (
        f"The motions of {which} may be multiplied by at most {_with_ends(of, 'scale_factor')}, or its rates by "
        f"{_with_ends(of, 'rate_factor')}, for survival to stay above {least}: it is {allowed}."
    )


def _with_ends(row: dict[str, Any], name: str) -> str:
    value = "any factor" if row[name] is None else f"{row[name]:.3g}"
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    if low is None:
        return value
    return f"{value} ({low:.3g} {'or more' if high is None else f'to {high:.3g}'}, 95 %)"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _varying(statement: dict[str, Any]) -> str:
    return " and ".join(_VARY[name] for name in statement["intervals_carry"])


def all_words(statement: dict[str, Any]) -> str:
    """Everything that is said, a line a sentence."""
    lines = [*answer(statement), *_rock_lines(statement)]
    if statement.get("hazard_ratio") == 1.0:
        component = statement["hazard"]["component"]
        stated = f", though its files say {component}" if component else ""
        lines.append(
            "The hazard is taken to be for the peak of the horizontal vector (SA: the largest of all azimuths)"
            f"{stated}; give --ratio if it is for another component."
        )
    lines += [*statement.get("hazard", {}).get("assumed", ()), *_branch_lines(statement)]
    unit, measure = unit_of(statement["measure"]), short_name(statement["measure"])
    lines += [
        f"a {measure} of {row[statement['measure']]:.3g} {unit} or more is rejected at return periods below "
        f"{row['rejected_return_years']:,.0f} years"
        for row in statement.get("rejected", ())[9::10]
    ]
    return "\n".join(lines)


def age_words(years: float | None) -> str:
    """How long a rock has stood; nothing where that is not known."""
    if years is None:
        return ""
    in_ka = f": is that in ka? Then give --age '{years:g} ka'" if years < _LEAST_AGE_YEARS else ""
    return f", stood for {years:,.0f} years{in_ka}"


def _rock_lines(statement: dict[str, Any]) -> list[str]:
    """What the rocks say about a single event, and what that rests on."""
    unit, measure = unit_of(statement["measure"]), short_name(statement["measure"])
    stood = "the rock has stood" if len(statement["rocks"]) == 1 else "the rocks have stood"
    lines = [
        f"{rock['name']}: median {rock['median']:.3g} {unit}, beta {rock['beta']:.2f}{age_words(rock.get('age_years'))}"
        for rock in statement["rocks"]
    ]
    lines.append(
        f"At {100 * statement['confidence']:g} % confidence no single event has exceeded a {measure} of "
        f"{statement['unexceeded']:.3g} {unit} while {stood}."
    )
    if (apart := statement.get("rocks_apart_km", 0.0)) > SITE_REACH_KM:
        lines.append(f"  they stand up to {apart:,.0f} km apart, and are taken to have felt the same events")
    if statement["unexceeded_low"] is None:
        lines.append(
            "  its uncertainty from the choice of records is unknown: this needs a run with enough records"
        )
    else:
        high = statement["unexceeded_high"]
        ends = f"{statement['unexceeded_low']:.3g} {f'{unit} or more' if high is None else f'to {high:.3g} {unit}'}"
        unfit = max(rock["samples_without_fit"] for rock in statement["rocks"])
        count = max(rock["samples"] for rock in statement["rocks"])
        bare = f"; {unfit} of {count} bootstrap samples have no fit and count as unbounded" if unfit else ""
        lines.append(
            f"  {ends} with other records like these (95 %{bare}), as the jobs come from few earthquakes"
        )
    for rock in statement.get("stood", ()):
        lines += [f"  {sentence}" for sentence in sentences({**rock, "contacts": [rock]})]
        if rock["median_shift_percent"]:
            lines.append(
                f"  with equal weights the median of {rock['rock']} would be {rock['median_bases_alike']:.3g} "
                f"{unit}: the weights shift it by {rock['median_shift_percent']:+.1f} %"
            )
    for rock in statement["rocks"]:
        lines += _reservations(rock, statement["unexceeded"], unit)
    if site := statement.get("random_rock"):
        low, high = site["median_low"], site["median_high"]
        upper = "or more" if high is None else f"to {high:.3g}"
        ends = "" if low is None else f" ({low:.3g} {upper}, 95 %)"
        lines.append(
            f"One fragility of the site, of a rock drawn at random: median {site['median']:.3g} {unit}{ends}, beta "
            f"{site['beta']:.2f} ({site['beta_within']:.2f} within a rock, {site['beta_between']:.2f} between rocks)"
        )
    if statement.get("ages_independent"):
        lines.append(
            "The ages of the rocks are taken as independent, as if each rock had been dated separately."
        )
    return lines


def _reservations(rock: dict[str, Any], unexceeded: float, unit: str) -> list[str]:
    """What limits the trust in one rock's curve: jobs without an answer, and extrapolation."""
    lines = []
    if rock.get("without_answer"):
        jobs = rock["without_answer"] + rock["jobs"]
        lines.append(
            f"  {rock['without_answer']:,} of {jobs:,} jobs of {rock['name']} have no answer and are left out: "
            "jobs near the threshold rock longest and most often lack one"
        )
    if "strongest_shaken" not in rock:
        lines.append(
            f"  the jobs behind the curve of {rock['name']} are unknown, so this may be an extrapolation"
        )
    elif unexceeded > rock["strongest_shaken"]:
        lines.append(
            f"  this extrapolates beyond the strongest shaking of {rock['name']}, "
            f"{rock['strongest_shaken']:.3g} {unit} ({rock['toppled']} toppled of {rock['jobs']} jobs, "
            f"{rock['records']} records)"
        )
    return lines


def _branch_lines(statement: dict[str, Any]) -> list[str]:
    """What is said of each branch, where they are few, and of all of them."""
    branches = statement.get("branches", ())
    lines = []
    for branch in branches if len(branches) <= _MOST_NAMED else ():
        verdict = "rejected" if branch["rejected"] else "kept"
        lines.append(
            f"{branch['name']}: topples at {branch['toppling_rate']:.2e} a year, "
            f"survival {branch['survival']:.3g}, {verdict}; "
            + (
                "the rocks survive under no branch"
                if branch["posterior_weight"] is None
                else f"weight {branch['prior_weight']:.3g} becomes {branch['posterior_weight']:.3g}"
            )
        )
        lines += _over_draws(branch, statement)
        lines += _outside(branch, 1.0 - statement["confidence"])
        lines += _taken_at(branch)
    if len(branches) > _MOST_NAMED:
        lines += _many(statement)
    if branches and all(branch["rejected"] for branch in branches):
        ranked = branches[0]["posterior_weight"] is not None
        lines.append("Every branch is rejected" + (": the weights only rank them." if ranked else "."))
    for level in dict.fromkeys(row["level"] for row in statement.get("levels", ())):
        moved = next(row["moved"] for row in statement["levels"] if row["level"] == level)
        rows = [row for row in statement["levels"] if row["level"] == level]
        lines.append(
            f"logic-tree level {level}: the rocks move {_percent(moved)} of its weight ("
            + ", ".join(f"{r['choice']} {r['prior_weight']:.3g} to {r['posterior_weight']:.3g}" for r in rows)
            + ")"
        )
    if shares := statement.get("parts"):
        lines.append(
            "Of the toppling rate, "
            + ", ".join(f"{_percent(part['share'])} is from {part['part']}" for part in shares)
            + "."
        )
    return lines


def _many(statement: dict[str, Any]) -> list[str]:
    """The branches that gain and lose most, where there are too many to name."""
    branches = statement["branches"]
    lines = _taken_at(branches[0])
    if branches[0]["posterior_weight"] is not None:
        ranked = sorted(branches, key=lambda branch: branch["posterior_weight"] / branch["prior_weight"])
        for word, branch in (("most", ranked[-1]), ("least", ranked[0])):
            lines.append(
                f"  {word} favoured: {branch['name']}, survival {branch['survival']:.3g}, weight "
                f"{branch['prior_weight']:.3g} becomes {branch['posterior_weight']:.3g}"
            )
    lost = max(branch["unstated_above"] + branch["unstated_below"] for branch in branches)
    if lost > 0.01:
        lines.append(
            f"  up to {_percent(lost)} of a branch's toppling rate may lie outside its points: not counted"
        )
    return lines


def _taken_at(branch: dict[str, Any]) -> list[str]:
    """Site that a branch's curve is of, and how far that is from the one asked for."""
    named = f"{branch['site_name']}, " if branch.get("site_name") else ""
    if "site_longitude_deg" not in branch:
        return [f"  taken at {branch['site_name']}"] if branch.get("site_name") else []
    away = branch.get("site_distance_km")
    return [
        f"  taken at {named}longitude {branch['site_longitude_deg']:g}, latitude {branch['site_latitude_deg']:g}"
        + ("" if away is None else f", {away:.1f} km from --site")
    ]


def _over_draws(branch: dict[str, Any], statement: dict[str, Any]) -> list[str]:
    """State the interval of a branch's survival over records and ages, and whether the verdict depends on them."""
    low, high, least = branch["survival_low"], branch["survival_high"], 1.0 - statement["confidence"]
    if low is None:
        return []
    hangs = "; the verdict depends on them" if low < least <= high else ""
    return [f"  survival {low:.3g} to {high:.3g} with {_varying(statement)} (95 %){hangs}"]


def _outside(branch: dict[str, Any], least: float) -> list[str]:
    """State the rate that may lie outside a hazard curve's points, and whether the verdict depends on it."""
    shares = {
        "beyond the curve's last point": branch["unstated_above"],
        "below its first point, if its initial slope continues": branch["unstated_below"],
    }
    lines = [
        f"  {100 * share:.0f} % of its toppling rate may lie {where}: not counted"
        for where, share in shares.items()
        if share > 0.01
    ]
    if branch["survival_least"] < least <= branch["survival"]:
        lines.append(
            f"  including it, survival would be {branch['survival_least']:.3g} and the branch rejected: give a curve "
            "that extends further"
        )
    return lines


_FEW_EVENTS = 5.0
"""Effective number of events below which a branch's survival hangs on a few."""

_NAMED_BRANCHES = 12


def event_words(statement: dict[str, Any]) -> str:
    """The statement in words, the answer first."""
    rocks = statement["rocks"]
    lines = [*answer(statement)] + [
        f"{rock['name']}: {rock['fragility']}, at {rock['site']}"
        + ("" if rock["site_distance_km"] is None else f", {rock['site_distance_km']:.1f} km from --site")
        for rock in rocks
    ]
    count = len(statement["branches"])
    stand = "the rock stands" if len(rocks) == 1 else f"all {len(rocks)} rocks stand"
    lines.append(
        f"Under {statement['events']:,} events of {count} {'branch' if count == 1 else 'branches'}, "
        f"{stand} with {statement['decided']['survival_mean_of_branches']:.3g}."
    )
    ranked = sorted(statement["branches"], key=lambda row: row["rank"])
    for row in ranked[:_NAMED_BRANCHES]:
        lines += _branch_words(row)
    if len(ranked) > _NAMED_BRANCHES:
        lines.append(f"and {len(ranked) - _NAMED_BRANCHES} branches more, in branches.csv (--out) and --json")
    if all(row["rejected"] for row in ranked):
        lines.append("Every branch is rejected.")
    few = [row["name"] for row in ranked if 0 < row["effective_events"] < _FEW_EVENTS]
    none = [row["name"] for row in ranked if row["effective_events"] == 0]
    if few:
        lines.append(
            f"Fewer than {_FEW_EVENTS:g} events bear the toppling rate of {listed(few, 4)}: simulate more years."
        )
    if none:
        lines.append(
            f"No event topples under {listed(none, 4)}: its true rate may be up to 3 events in the time simulated."
        )
    if len(statement["models"]) > 1:
        best, least = statement["models"][0], statement["models"][-1]
        lines.append(
            f"Of {len(statement['models'])} ground-motion models {best['model']} agrees best, "
            f"{best['bayes_factor']:.2g} times the average; the least, {least['model']}, "
            f"{least['bayes_factor']:.2g} times."
        )
    predicted = {row["left_out"]: row["survival_predicted"] for row in statement["left_out"]}
    lines += [
        f"Without {name}: the other rocks predict that it stands with {0.0 if chance is None else chance:.3g}"
        for name, chance in predicted.items()
    ]
    return "\n".join([*lines, *(f"Note: {note}." for note in statement["notes"])])


def _branch_words(row: dict[str, Any]) -> list[str]:
    weight = (
        "the rocks stand under no branch" if row["posterior_weight"] is None
        else f"weight {row['prior_weight']:.3g} becomes {row['posterior_weight']:.3g}"
    )  # fmt: skip
    factor = (
        "motions of any strength keep" if row["scale_factor"] is None
        else f"motions up to {row['scale_factor']:.2f} times as strong keep"
    )  # fmt: skip
    return [
        f"{row['name']}: topples at {row['toppling_rate']:.2e} a year, survival {row['survival']:.3g} "
        f"({row['survival_low']:.2g} to {row['survival_high']:.2g}, 95 %), "
        f"{'rejected' if row['rejected'] else 'kept'}; {weight}; {factor} it standing"
    ]
