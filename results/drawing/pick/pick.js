// Hints on a scan by clicks: the page tells them to the command that serves it, and shows what comes of them.
import { Stage } from "./stage.js";
import { Handles, normalOf, slopeOf } from "./handles.js";
import { polar, width } from "./plot.js";
import { bearingOf } from "./bearings.js";

const at = id => document.getElementById(id);
const MODES = [
  ["look", "L", "Look", "Drag to turn, right-drag to shift, wheel to come nearer; double-click goes to a place, F back to the rock."],
  ["near", "R", "Rock", "Click the rock that is meant, near its top."],
  ["point", "M", "Meet", "Click three or more places around the rock where it meets its pedestal: the plane goes through them."],
  ["plane", "P", "Plane", "Drag the knobs, or use arrow keys on them: the full one lifts the plane on which rock and pedestal meet, the others tilt it."],
  ["touch", "T", "Touch", "Click places along the crevice where rock and pedestal touch."],
  ["daylight", "D", "Daylight", "Click places along the crevice where light passes between rock and pedestal."],
  ["length", "S", "Scale", "Click the two ends of a measured length, then say beside how long it is."],
];
const NAMES = { units: "unit", up: "up", length: "length", near: "rock", plane: "plane", point: "meet", outline: "outline", touch: "touch", daylight: "daylight", pull: "pull", base: "base", touch_only: "touches" };
const OF_CLOUDS = ["near", "point", "plane", "length", "up", "units"];  // a scene that is drawn again keeps none
const offered = name => !(state?.again && OF_CLOUDS.includes(name));
const LISTS = ["point", "touch", "daylight", "pull"];
let mode = "look", ends = [], state = null, hints = null, past = [], future = [], drawnView = -1, framed = "", before = null, shownTable = null, shownFor = "";

async function post(path, content) {
  const answer = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

function make(name, content, attributes = {}) {
  const made = document.createElement(name);
  Object.assign(made, attributes);
  made.append(...[content].flat().filter(each => each !== undefined));
  return made;
}

// Hints: the latest are the page's, the former ones are kept for undo.

function say(next, keep = true) {
  if (keep) { past.push(hints); future = []; }
  hints = next;
  document.body.dataset.current = false;  // until a state says so of these hints
  listHints();
  post("hints", hints).catch(complain);
}
function undo() { if (past.length) { future.push(hints); say(past.pop(), false); } }
function redo() { if (future.length) { past.push(hints); say(future.pop(), false); } }
const without = (name, index) => ({ ...hints, [name]: name === "outline" ? [] : LISTS.includes(name) ? hints[name].filter((_, k) => k !== index) : name === "touch_only" ? false : null });

function add(name, value) {
  const next = { ...hints, [name]: LISTS.includes(name) ? [...hints[name], value] : value };
  if (name === "point") next.plane = null;  // they say the same thing: the later word counts
  if (name === "plane") next.point = [];
  if (["point", "plane"].includes(name)) next.outline = [];
  say(next);
}

// A model that is placed anew has other coordinates: what was said in the former ones is taken back with it.
function placeAnew(changes) {
  ends = [];
  say({ ...hints, near: null, plane: null, point: [], outline: [], touch: [], daylight: [], pull: [], touch_only: false, ...changes });
}

// What is shown.

let stage;
try {
  stage = at("view").stage = new Stage(at("view"), placeMarks);
} catch {
  at("guide").textContent = "This browser shows no WebGL: give the hints as options of the command.";
}

const places = () => [
  ...(hints.near ? [{ name: "near", value: onTop(hints.near) }] : []),
  ...["point", "outline", "touch", "daylight"].flatMap(name => hints[name].map(value => ({ name, value }))),
];

// The rock's hint has no height of its own: it is shown on the cloud's highest point there.
function onTop([x, y]) {
  const [ox, oy, oz] = state.origin_m;
  let top = -Infinity;
  if (stage?.places) for (let j = 0; j < stage.places.length; j += 3)
    if (Math.hypot(stage.places[j] + ox - x, stage.places[j + 1] + oy - y) < 0.02 * stage.home.radius) top = Math.max(top, stage.places[j + 2]);
  return [x, y, (top === -Infinity ? stage?.home.target[2] ?? 0 : top) + oz];
}
const surveyed = place => place.map((value, k) => value + state.origin_m[k]);
const choose = candidate => isChosen(candidate) || add("near", surveyed(candidate.top_m).slice(0, 2).map(value => +value.toFixed(3)));
const local = place => place.map((value, k) => value - state.origin_m[k]);

const planeHint = plane => {
  const [slope, azimuth] = slopeOf(plane.normal);
  return [...surveyed(plane.centre).map(each => +each.toFixed(4)), +slope.toFixed(3), +azimuth.toFixed(2)];
};
// The plane as it is said, or else as it was fitted; none before a rock is known.
function planeNow() {
  const fitted = state.answer?.plane;
  if (!fitted || !hints.plane) return fitted;
  const [x, y, z, slope, azimuth] = hints.plane;
  return { ...fitted, point_m: local([x, y, z]), normal: normalOf(slope, azimuth) };
}
const handles = stage && new Handles(stage, plane => { stage.movePlane(plane); fillPlane(planeHint(plane)); }, plane => add("plane", planeHint(plane)));

let marks = [];
function setMarks() {
  if (!stage) return;
  const tops = (state.candidates || []).map((each, k) => ({ name: "top", place: surveyed(each.top_m), text: `${k + 1}`, title: `${each.height_m.toPrecision(2)} m high`, chosen: isChosen(each), act: () => choose(each) }));
  const said = places().map(({ name, value }) => ({ name, place: value, text: "", title: `${NAMES[name]}: ${told(value)}` }));
  const measured = (ends.length ? ends.map(each => each.place_m) : state.ends_m || []).map(place => ({ name: "end", place, text: "", title: "end of the length" }));
  marks = [...(!offered("near") || (state.answer && tops.length < 2) ? [] : tops), ...said, ...measured].map(each => {
    const made = make("button", each.text, { type: "button", className: `mark ${each.name}${each.chosen ? " chosen" : ""}`, title: each.title });
    if (each.act) made.onclick = each.act; else made.onclick = () => stage.look(local(each.place));
    return { place: local(each.place), made };
  });
  at("marks").replaceChildren(...marks.map(each => each.made));
  placeMarks(stage);
}

let hide;
// Once the eye rests near something, all points there are shown.
let resting, detailed = "";
function lookCloser() {
  const target = stage.controls.target.toArray(), distance = stage.camera.position.distanceTo(stage.controls.target);
  if (!state || !stage.places || distance > 2.2 * stage.home.radius) return;
  const reach = 0.45 * distance, key = JSON.stringify([drawnView, ...target.map(each => Math.round(4 * each / reach)), Math.round(4 * Math.log(reach))]);
  if (key === detailed) return;
  detailed = key;
  fetch("detail", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ at_m: target, reach_m: reach }) })
    .then(async answer => { if (answer.ok && key === detailed) stage.setDetail(await answer.arrayBuffer(), target, reach); });
}

function placeMarks(from) {
  handles?.place();
  clearTimeout(resting);
  resting = setTimeout(lookCloser, 400);
  at("needle").setAttribute("transform", `rotate(${-from.heading()} 24 24)`);
  for (const { place, made } of marks) {
    const on = from.project(place);
    made.hidden = !on;
    if (on) made.style.transform = `translate(${on.x}px, ${on.y}px)`;
  }
  clearTimeout(hide);
  hide = setTimeout(() => { for (const { place, made } of marks) made.classList.toggle("behind", from.hidden(place)); }, 150);
}

const told = value => value.map(each => +each.toFixed(3)).join(", ");
// The candidate whose top is nearest to the rock's is that rock, unless even its top is somewhere else.
function isChosen(candidate) {
  const top = state.answer?.top_m, away = each => Math.hypot(...each.top_m.map((value, k) => value - top[k]));
  return top !== undefined && away(candidate) < 0.2 * candidate.height_m && state.candidates.every(each => away(each) >= away(candidate));
}

function listHints() {
  const rows = [];
  const row = (name, index, value, text) => rows.push(make("li", [
    make("span", "", { className: `mark ${name === "length" ? "end" : name}${["plane", "outline", "pull", "units", "up", "base", "touch_only"].includes(name) ? " none" : ""}` }),
    make("span", `${NAMES[name]}: ${text}`),
    make("button", "×", { type: "button", title: "take this hint back", ariaLabel: `take back ${NAMES[name]}`, onclick: () => ["units", "up", "length"].includes(name) ? placeAnew({ [name]: null }) : say(without(name, index)) }),
  ]));
  for (const name of ["units", "up"]) if (hints[name]) row(name, 0, hints[name], hints[name]);
  if (hints.length) row("length", 0, hints.length, `${+hints.length[2].toPrecision(6)} m between two places`);
  if (hints.near) row("near", 0, hints.near, told(hints.near));
  if (hints.plane) row("plane", 0, hints.plane, `${told(hints.plane.slice(0, 3))}; ${told(hints.plane.slice(3, 4))}° toward ${bearingOf(hints.plane[4])}`);
  if (hints.outline.length) row("outline", 0, hints.outline, `${hints.outline.length} places around the contact`);
  for (const name of LISTS) hints[name].forEach((value, index) => row(name, index, value, name === "pull" ? `${+value[1].toFixed(4)} of the weight toward ${bearingOf(value[0])}` : told(value)));
  if (hints.base) row("base", 0, hints.base, hints.base);
  if (hints.touch_only) row("touch_only", 0, true, "there and nowhere else");
  if (hints.point.length && hints.point.length < 3) rows.push(make("li", make("span", `${3 - hints.point.length} more where they meet`, { className: "quiet" })));
  if (!rows.length) rows.push(make("li", make("span", "none yet", { className: "quiet" })));
  at("hints").replaceChildren(...rows);
  at("undo").disabled = !past.length;
  at("redo").disabled = !future.length;
  setMarks();
}

function showError(error) {
  const was = at("error").textContent;
  at("error").hidden = !error;
  at("error").replaceChildren();
  if (!error) return;
  const parts = [make("strong", inWords(`${error.where ? error.where + ": " : ""}${error.what}`))];
  if (error.expected) parts.push(make("p", `Expected: ${inWords(error.expected)}`));
  const here = REMEDIES.filter(([option]) => offered(option) && error.remedy.match(OPTION)?.includes(`--${option}`));
  if (past.length) here.push(["", "take the last hint back", undo]);
  if (here.length) parts.push(make("p", ["What to do here: ", ...here.map(([, text, act]) => make("button", text, { type: "button", onclick: act }))]));
  // The command's own words serve where no control of the page does the same.
  if (error.remedy && !here.some(([option]) => option)) parts.push(make("p", `What to do: ${error.remedy}`));
  at("error").replaceChildren(...parts);
  if (at("error").textContent !== was) at("error").scrollIntoView({ block: "nearest" });
}
// What an option of the command does is a control here.
const OPTION = /--[a-z]+(-[a-z]+)*/g;
const inWords = text => text.replace(OPTION, option => REMEDIES.find(([name]) => offered(name) && option === `--${name}`)?.[1] ?? option);
const field = (form, name) => () => at(form)[name].focus();
const REMEDIES = [
  ...["near", "point", "plane", "touch", "daylight", "length"].map(name => [name, MODES.find(each => each[0] === name)[2], () => { setMode(name); at("view").focus(); }]),
  ["contact", "Touch", () => setMode("touch")], ["pull", "Pull", field("pull", "azimuth")], ["base", "Hidden base", field("base", "kind")],
  ["touch-only", "Touches where I say and nowhere else", field("base", "only")],
  ["up", "Up", field("place", "up")], ["units", "Unit", field("place", "units")],
];
// The server's refusal: what, its code, and lines that begin with "expected:" and "remedy:".
const lineOf = (error, name) => error.message.match(new RegExp(`^ *${name}: (.*)$`, "m"))?.[1] ?? "";
function complain(error) {
  showError({ what: error.message.split("\n")[0].replace(/ \[[\w.]+\]$/, ""), where: "", expected: lineOf(error, "expected"), remedy: lineOf(error, "remedy") });
}

function showAnswer(answer) {
  at("result").hidden = !answer;
  if (!answer) return;
  at("result").classList.toggle("stale", !state.current);
  at("stale").textContent = state.current ? "" : state.stage ? "(being worked out)" : "(of earlier hints)";
  const rows = [["volume", answer.volume], ["height", `${answer.height_m.toPrecision(3)} m`],
    ["pedestal", `dips ${answer.slope_deg.toFixed(1)}° toward ${bearingOf(answer.downhill_azimuth_deg)}`],
    ["surface", `${(100 * answer.surface.seen_share).toFixed(0)} % seen, ${(100 * answer.surface.invented_share).toFixed(0)} % invented`]];
  at("numbers").replaceChildren(...rows.flatMap(([name, value]) => [make("dt", name), make("dd", value)]));
  const notes = [...answer.sentences, ...answer.notes], warns = note => note.startsWith("warning");
  at("warnings").replaceChildren(...notes.filter(warns).map(each => make("li", inWords(each))));
  at("notes").replaceChildren(...notes.filter(each => !warns(each)).map(each => make("li", inWords(each))));
  if (!answer.toppling) {
    at("plot").replaceChildren();
    at("next").hidden = true;
    at("least").textContent = state.stage ? "" : answer.sentences[0] || "";
    return;
  }
  const key = JSON.stringify(answer.toppling);
  if (key !== shownFor) { before = shownTable; shownTable = answer.toppling; shownFor = key; }
  at("plot").replaceChildren(polar(answer.toppling, before));
  const least = answer.toppling.reduce((a, b) => a.median_m_s2 < b.median_m_s2 ? a : b);
  at("least").replaceChildren("Least acceleration that topples it: ", make("b", `${least.low_m_s2.toFixed(2)} to ${least.high_m_s2.toFixed(2)} m/s²`),
    ` (${Math.round(100 * answer.level)} % of the bases; median ${least.median_m_s2.toFixed(2)}), of ground that accelerates toward ${bearingOf(least.azimuth_deg)}. Over all azimuths the interval is ${(100 * width(answer.toppling)).toFixed(0)} % of its median wide` + (before ? `, ${(100 * width(before)).toFixed(0)} % before (dashed).` : "."));
  showNext(answer.next, width(answer.toppling));
}

// The pull by which the interval is expected to narrow most, and where to say what it bore.
function showNext(found, now) {
  const percent = share => Math.round(100 * share), [pull] = found.filter(each => each.kind === "pull" && percent(each.width) < percent(now));
  at("next").hidden = !pull;
  if (!pull) return;
  const toward = bearingOf(pull.from_deg), act = () => { at("pull").azimuth.value = toward; at("pull").ratio.focus(); };
  at("next").replaceChildren("What narrows it most: ", make("button", `a pull toward ${toward}`, { type: "button", onclick: act }), ` (to about ${percent(pull.width)} %)`);
}

function showCandidates(list) {
  at("rivals").hidden = !list || !offered("near") || (list.length < 2 && state.answer !== null);
  at("candidates").replaceChildren(...(list || []).map((each, k) => make("li", make("button",
    `${k + 1}: ${each.height_m.toPrecision(2)} m high, top at ${told(surveyed(each.top_m).slice(0, 2))}`,
    { type: "button", className: isChosen(each) ? "chosen" : "", onclick: () => choose(each) }))));
}

async function show(next) {
  state = next;
  if (!hints) hints = state.hints;
  if (stage && state.view.number !== drawnView) {
    const answer = await fetch(`cloud/${state.view.number}`);
    if (answer.ok) {
      stage.setCloud(await answer.arrayBuffer(), state.view.counts, state.view.spacings_m);
      // Another rock, or another frame: one looks there; another split of the same rock leaves the eye where it is.
      const subject = JSON.stringify([state.hints.units, state.hints.up, state.hints.length, state.hints.near, state.answer !== null]);
      if (framed !== subject) stage.frame();
      framed = subject;
      drawnView = state.view.number;
    }
  }
  if (stage && !handles.held) { stage.setPlane(planeNow()); handles.set(planeNow()); }
  for (const button of at("modes").children) button.hidden = !offered(button.dataset.mode);
  const busy = state.stage !== "";
  at("stage").className = busy ? "busy" : "";
  at("stage").textContent = busy ? state.stage : state.current ? `up to date; ${state.points.toLocaleString("en")} points` : state.error ? "refused: see the error" : "waiting for a hint";
  at("legend").innerHTML = state.answer ? '<span class="rock"></span>rock<span class="pedestal"></span>pedestal<span class="rest"></span>neither<span class="contact"></span>' : "";
  if (state.answer) at("legend").append(state.answer.contacts ? ["contacts: around all", ...state.answer.plane.outlines.map(each => `inside those of ${Math.round(100 * each.probability)} %`)].join(", ") : "contact");
  showError(state.error);
  showAnswer(state.answer);
  showCandidates(state.candidates);
  at("save").disabled = state.saving || !(state.current || (busy && !state.error));
  at("why").textContent = !at("save").disabled || state.saving ? "" : state.error ? "Nothing to save: see the error above." : "Nothing to save yet: no scene came of these hints.";
  at("saved").textContent = state.saving ? "saving ..." : state.saved ? `Saved to ${state.target}, with hints.toml, by which the scan repeats.` : "";
  fillPlane();
  fillPlace();
  fillBase();
  listHints();
  document.body.dataset.current = state.current;
  document.body.dataset.saved = state.saved;
}

function fillPlane(dragged) {
  const form = at("plane"), plane = planeNow();
  form.hidden = !plane || !offered("plane");
  if (!plane || form.contains(document.activeElement) || (handles?.held && !dragged)) return;
  const [height, slope, azimuth] = dragged ? dragged.slice(2) : [plane.point_m[2] + state.origin_m[2], ...slopeOf(plane.normal)];
  form.z.value = height.toFixed(3);
  form.slope.value = slope.toFixed(2);
  form.azimuth.value = bearingOf(azimuth, 1);
}

function fillPlace() {
  const form = at("place"), free = !state.placed;
  form.hidden = !offered("up");
  for (const field of form.elements) field.disabled = !free;
  if (form.contains(document.activeElement)) return;
  if (form.units.length === 1) form.units.append(...state.units.map(name => make("option", name)));
  form.up.value = hints.up || "";
  form.units.value = hints.units || "";
  const apart = ends.length === 2 ? Math.hypot(...ends[0].place_m.map((each, k) => each - ends[1].place_m[k])) : null;
  at("apart").textContent = !free ? "placed already" : apart === null ? "length: Scale, then two clicks" : `${apart.toPrecision(4)} m between the ends`;
  at("metres").hidden = apart === null;
}

function fillBase() {
  const form = at("base");
  if (form.kind.length === 1) form.kind.append(...state.kinds.map(name => make("option", name)));
  form.kind.value = hints.base || "";
  form.only.checked = hints.touch_only;
  form.only.disabled = hints.touch.length < 3 && !hints.touch_only;
}

async function follow() {
  for (let number = 0, lost = 0; ;) {
    try {
      const next = await (await fetch(`state/${number}`)).json();
      number = next.number;
      lost = 0;
      await show(next);
    } catch (error) {
      if (++lost > 3) {
        at("stage").className = "";
        at("stage").textContent = error instanceof TypeError ? "the command has ended" : `${error}`;
        document.body.dataset.ended = "true";
        return;
      }
      await new Promise(done => setTimeout(done, 400));
    }
  }
}

// What one does.

function setMode(name) {
  mode = name;
  for (const button of at("modes").children) button.setAttribute("aria-checked", button.dataset.mode === name);
  at("view").classList.toggle("aims", !["look", "plane"].includes(name));
  handles?.show(name === "plane");
  at("guide").textContent = MODES.find(each => each[0] === name)[3];
}

async function pickAt(x, y) {
  const hit = stage?.hit(x, y);
  if (!hit || mode === "look" || mode === "plane") return;
  const name = mode;
  try {
    const picked = await post("pick", hit), place = picked.place_m;
    if (name === "length") {
      ends = ends.length === 1 ? [...ends, picked] : [picked];
      fillPlace();
      setMarks();
      if (ends.length === 2) at("place").metres.focus();
    } else add(name, name === "near" ? place.slice(0, 2) : place);
  } catch (error) { complain(error); }
}

for (const [name, key, text, guide] of MODES) {
  const button = make("button", [text, make("kbd", key)], { type: "button", title: guide, onclick: () => setMode(name) });
  button.dataset.mode = name;
  button.setAttribute("role", "radio");
  at("modes").append(button);
}
setMode("look");

let down = null;
const canvas = stage?.renderer.domElement;
canvas?.addEventListener("pointerdown", event => { down = { x: event.clientX, y: event.clientY, button: event.button }; at("view").focus({ preventScroll: true }); });
canvas?.addEventListener("pointerup", event => {
  if (!down || down.button !== 0 || Math.hypot(event.clientX - down.x, event.clientY - down.y) > 4) return;
  const box = canvas.getBoundingClientRect();
  pickAt(event.clientX - box.left, event.clientY - box.top);
});
canvas?.addEventListener("dblclick", event => {
  const box = canvas.getBoundingClientRect(), hit = mode === "look" && stage.hit(event.clientX - box.left, event.clientY - box.top);
  if (hit) stage.look(hit.at_m);
});

const TURNS = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
document.addEventListener("keydown", event => {
  if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
  const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
  if (event.ctrlKey || event.metaKey) {
    const act = { Z: event.shiftKey ? redo : undo, Y: redo, S: () => at("save").click() }[key];
    if (act) { event.preventDefault(); act(); }
    return;
  }
  const chosen = MODES.find(each => each[1] === key);
  if (chosen && offered(chosen[0])) setMode(chosen[0]);
  else if (key === "Escape") setMode("look");
  else if (key === "F") stage?.frame();
  else if (document.activeElement !== at("view")) return;
  else if (TURNS[key]) stage?.turn(...TURNS[key]);
  else if (key === "+" || key === "=") stage?.nearer(0.85);
  else if (key === "-") stage?.nearer(1 / 0.85);
  else if (key === "Enter") pickAt(at("view").clientWidth / 2, at("view").clientHeight / 2);
  else return;
  event.preventDefault();
});

// The azimuth of a form's field, as the command line reads it; the field shows how to write one where it is none.
async function directionIn(form) {
  try { return (await post("azimuth", form.azimuth.value)).azimuth_deg; } catch (error) {
    form.azimuth.setCustomValidity(lineOf(error, "expected") || error.message);
    form.azimuth.reportValidity();
    return null;
  }
}
for (const name of ["pull", "plane"]) at(name).azimuth.oninput = event => event.target.setCustomValidity("");

at("undo").onclick = undo;
at("redo").onclick = redo;
at("save").onclick = () => post("save", {}).catch(complain);
at("end").onclick = () => post("end", {}).catch(complain);
at("pull").onsubmit = async event => {
  event.preventDefault();
  const form = event.target, azimuth = await directionIn(form);
  if (azimuth === null) return;
  add("pull", [azimuth, +form.ratio.value]);
  form.reset();
  document.activeElement?.blur();
};
at("base").kind.onchange = event => { add("base", event.target.value || null); event.target.blur(); };
at("base").only.onchange = event => { add("touch_only", event.target.checked); event.target.blur(); };
at("place").up.onchange = event => placeAnew({ up: event.target.value || null });
at("place").units.onchange = event => placeAnew({ units: event.target.value || null, length: null });
at("place").onsubmit = event => {
  event.preventDefault();
  const metres = +event.target.metres.value;
  if (ends.length === 2 && metres > 0) placeAnew({ units: null, length: [ends[0].model, ends[1].model, metres] });
  event.target.reset();
  document.activeElement?.blur();
};
at("plane").onsubmit = async event => {
  event.preventDefault();
  const form = event.target, { centre: [x, y] } = handles.plane, azimuth = await directionIn(form);
  if (azimuth === null) return;
  add("plane", [+(x + state.origin_m[0]).toFixed(4), +(y + state.origin_m[1]).toFixed(4), +form.z.value, +form.slope.value, azimuth]);
  document.activeElement?.blur();
};
follow();
