"""A paragraph on methods to copy into a paper, with references."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version

import pandas as pd

from toppling.models.contact import FRICTION_SPREAD
from toppling.models.scene import COM_SPREAD_SHARE, Scene
from toppling.results.analysis.friction_comparison import friction_words, frictions
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.document import Block, Document, block
from toppling.results.weights import records_weight

_REFERENCES = (
    "Baker, J. W. (2015). Efficient analytical fragility function fitting using dynamic structural analysis. "
    "Earthquake Spectra 31, 579-599.",
    "Veeraraghavan, S., Hudnut, K. W., and Krishnan, S. (2017). Toppling analysis of the Echo Cliffs precariously "
    "balanced rock. Bulletin of the Seismological Society of America 107, 72-84.",
    "Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference. "
    "Journal of the American Statistical Association 22, 209-212.",
)


def methods_section(content: Content, document: Document) -> list[Block]:  # noqa: ARG001  (as every section)
    """Methods to copy, and references."""
    engine = content.run.provenance().get("engine")
    references = sorted((*_REFERENCES, engine["reference"]) if engine else _REFERENCES)
    cited = block("items", texts=[_program(content), *references])
    return [block("methods", text=methods(content)), "To cite:", cited]


def methods(content: Content) -> str:
    """What was done, in the past tense, with the run's own numbers."""
    remark = content.completeness.remark
    parts = [f"The ensemble was not completed: {remark}."] if remark else []
    return " ".join([*parts, _rock(content), _shaking(content), _engine(content), _statistics(content)])


def _rock(content: Content) -> str:
    table = content.run.scene()
    if table is None:
        return "The rock and its pedestal were taken as rigid bodies."
    row = table.to_pylist()[0]
    report = content.scene.report if content.scene is not None else {}
    scanned = ""
    if stations := report.get("registration", {}).get("stations"):
        scanned = (
            f"{stations} laser scans of rock and pedestal were merged, and the rock was separated from its "
        )
        scanned += "pedestal and closed; "
    return (
        f"{scanned}the rock ({row['volume_m3']:.3g} m³, {row['height_m']:.3g} m high, homogeneous) and its pedestal "
        f"(interface dipping {row['slope_deg']:.1f}°) were taken as rigid bodies under a gravity of "
        f"{row['gravity_m_s2']:g} m/s²."
    )


def _shaking(content: Content) -> str:
    frame = content.frame
    levels = frame["level_pga_m_s2"]
    restitution = ", ".join(f"{value:g}" for value in sorted(frame["restitution"].unique()))
    friction = " and ".join(friction_words(*one) for one in frictions(frame))
    count = frame["realisation"].nunique()
    several = f", in {count} realisations" if count > 1 else ""
    return (
        f"Three-component records ({frame['record_id'].nunique():,}) were scaled to {levels.nunique()} levels of the "
        f"peak horizontal ground acceleration vector between {levels.min():g} and {levels.max():g} m/s² and rotated to "
        f"{frame['azimuth_deg'].nunique()} azimuths{several}. Contact followed Coulomb friction "
        f"(coefficient {friction}) and impacts a coefficient of restitution of {restitution}.{_realisations(content)}"
    )


def _realisations(content: Content) -> str:
    """What the realisations drew of what nobody measured: base, centre of mass, friction and the campaign's own."""
    frame, unmeasured = content.frame, content.run.unmeasured()
    drawn = frame[frame["realisation"] > 0]
    if drawn.empty:
        return ""
    scene = content.scene
    said = [_base_drawn(drawn, scene), _friction_drawn(drawn, unmeasured.get("friction"))]
    if pair := unmeasured.get("restitution"):
        said.append(f"restitution (uniform, {pair[0]:g} to {pair[1]:g})")
    if yaw_deg := unmeasured.get("yaw_deg"):
        said.append(f"a turn of the motion about the vertical (uniform, at most {yaw_deg:g}° either way)")
    if unmeasured.get("either_sense"):
        said.append("the sense of the motion (reversed in one half)")
    if pair := unmeasured.get("above_band"):
        said.append(
            f"motion in the octave above {unmeasured['band_hz']:g} Hz, {pair[0]:g} to {pair[1]:g} times that in the "
            "octave below"
        )
    count = drawn["realisation"].nunique()
    nominal = "One realisation was the nominal scene, and " if (frame["realisation"] == 0).any() else ""
    each = "each of the" if nominal else "Each of the"
    others = f"{each} {count} {'others' if nominal else 'realisations'}" if count > 1 else "the other"
    return f" {nominal}{others} drew {', '.join(said[:-1])} and {said[-1]}."


def _base_drawn(drawn: pd.DataFrame, scene: Scene | None) -> str:
    """Base and centre of mass, or the centre of mass alone where the scene keeps no draws of its base."""
    bases = drawn["base"].nunique()
    if bases:
        of = f" of the scene's {len(scene.unseen)}" if scene is not None and scene.unseen is not None else ""
        return f"one of the possible unseen bases ({bases}{of} in use) with a centre of mass"
    std_m = None if scene is None else scene.com_std_m
    spread = (
        f"{100 * COM_SPREAD_SHARE:g} % of the rock's height in each direction" if std_m is None
        else f"{', '.join(f'{1e3 * one:.2g}' for one in std_m)} mm toward east, north and up"
    )  # fmt: skip
    return f"a centre of mass (normal, standard deviation {spread})"


def _friction_drawn(drawn: pd.DataFrame, uniform: Sequence[float] | None) -> str:
    factor = drawn["friction_factor"].dropna()
    if uniform:
        return f"friction (static and kinetic alike, uniform, {uniform[0]:g} to {uniform[1]:g})"
    ends = "" if factor.empty else f"; drawn: {factor.min():.2f} to {factor.max():.2f}"
    return f"a factor on friction (lognormal, {100 * FRICTION_SPREAD:g} %{ends})"


def _engine(content: Content) -> str:
    provenance, frame = content.run.provenance(), content.frame
    versions, cited = provenance.get("versions", {}), provenance.get("engine", {})
    physics = ", ".join(sorted(frame["physics_version"].dropna().astype(str).unique()))
    physics = physics or versions.get("physics", "unknown")
    presets = ", ".join(sorted(frame["preset"].unique()))
    names = sorted(frame["engine"].unique(), reverse=True)
    engines = " and ".join(_engine_words(name, versions, cited) for name in names)
    answered = int(frame["toppled"].notna().sum())
    return (
        f"Each of {len(frame):,} combinations was integrated in six degrees of freedom in the frame of the pedestal "
        f"with toppling {versions.get('toppling', version('toppling'))} (physics version {physics}, preset {presets}) "
        f"on {engines}, following Veeraraghavan et al. (2017); {answered:,} had an answer. "
        "A rock counts as toppled once it cannot come back."
    )


def _engine_words(name: str, versions: Mapping[str, str], cited: Mapping[str, str]) -> str:
    """An engine with its version, and its authors where the run states them."""
    number = f" {versions[name]}" if name in versions else ""
    if cited.get("name") != name:
        return f"{name}{number}"
    return f"{cited['title']}{number} ({cited['authors']})"


def _statistics(content: Content) -> str:
    reasons = ["a hazard deaggregation"] if records_weight(content.frame) is not None else []
    if weights := content.run.weights():
        reasons.append(weights.method)
    weighted = f", weighted by {' and by '.join(reasons)}" if reasons else ""
    return (
        f"Toppling probabilities are shares of the jobs with an answer{weighted}; their 95 % intervals are Wilson's "
        "(1927) with the number of distinct records as trials, since scaled and rotated copies of one record are not "
        "independent. Fragility curves are lognormal, by maximum likelihood (Baker, 2015), with 95 % intervals from "
        f"{content.samples} bootstrap samples of records. Measures of intensity are ranked by the log loss of "
        "predictions for records left out of the fit."
    )


def _program(content: Content) -> str:
    provenance = content.run.provenance()
    made = str(provenance.get("created_at", ""))[:4]
    number = provenance.get("versions", {}).get("toppling", version("toppling"))
    physics = provenance.get("versions", {}).get("physics")
    return (
        f"The toppling developers{f' ({made})' if made else ''}. toppling: toppling probability of precariously "
        f"balanced rocks under ensembles of earthquake records, version {number}"
        f"{f', physics version {physics}' if physics else ''}."
    )
