// A rock on its pedestal, turned with the mouse; where the page holds poses, it plays them beside the seismogram.
const data = JSON.parse(document.getElementById("data").textContent);
const view = document.getElementById("view");

function decoded(text, Kind) {
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

function surface(told) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(decoded(told.positions, Float32Array), 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(decoded(told.normals, Float32Array), 3));
  geometry.setIndex(new THREE.BufferAttribute(decoded(told.index, Uint32Array), 1));
  return new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: told.colour, side: THREE.DoubleSide }));
}

function curve(points, colour, { dashed = false, through = false } = {}) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points.map(point => new THREE.Vector3(...point)));
  const size = data.camera.radius;
  const material = dashed
    ? new THREE.LineDashedMaterial({ color: colour, dashSize: 0.05 * size, gapSize: 0.03 * size, depthTest: !through })
    : new THREE.LineBasicMaterial({ color: colour, depthTest: !through });
  const line = new THREE.Line(geometry, material);
  if (dashed) line.computeLineDistances();
  if (through) line.renderOrder = 2;
  return line;
}

// A line of some width, as screens draw lines one pixel wide.
function rod(points, colour) {
  const path = new THREE.CatmullRomCurve3(points.map(point => new THREE.Vector3(...point)), false, "catmullrom", 0);
  const geometry = new THREE.TubeGeometry(path, 8 * points.length, 0.008 * data.camera.radius, 6);
  return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour }));
}

const stage = (() => {
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch {
    view.textContent = "This browser shows no WebGL: the pictures beside this page show the same.";
    return null;
  }
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  view.prepend(renderer.domElement);
  const world = new THREE.Scene();
  world.background = new THREE.Color("#f4f6f8");
  const camera = new THREE.PerspectiveCamera(35, 1, 0.01 * data.camera.radius, 200 * data.camera.radius);
  camera.up.set(0, 0, 1);
  world.add(new THREE.HemisphereLight("#ffffff", "#8a8578", 2.0));
  const sun = new THREE.DirectionalLight("#ffffff", 2.0);
  camera.add(sun);  // from the upper left of the eye, wherever it goes
  sun.position.set(-0.8, 0.9, 1.0);
  sun.target = camera;
  world.add(camera);
  const rock = new THREE.Group();
  rock.add(surface(data.rock));
  rock.position.set(...data.rock.origin);
  world.add(rock, surface(data.pedestal));
  for (const line of data.lines) world.add(rod(line.points, line.colour), curve(line.points, line.colour, { dashed: true, through: true }));
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.target.set(...data.camera.target);
  controls.minDistance = 0.3 * data.camera.radius;
  controls.maxDistance = 30 * data.camera.radius;

  function draw() {
    renderer.render(world, camera);
    const along = new THREE.Vector3().subVectors(controls.target, camera.position);
    const heading = Math.atan2(along.x, along.y) * 180 / Math.PI;  // clockwise from north
    document.getElementById("needle").setAttribute("transform", `rotate(${-heading} 24 24)`);
  }
  // The rock fills the view whatever its shape: the narrower angle decides how far off the eye stands.
  function frame() {
    const half = 0.5 * camera.fov * Math.PI / 180;
    const narrow = Math.atan(Math.tan(half) * Math.min(1, camera.aspect));
    const distance = 1.08 * data.camera.radius / Math.sin(narrow);
    camera.position.set(...data.camera.target.map((place, k) => place + distance * data.camera.eye[k]));
    controls.update();
  }
  let framed = false;
  function fit() {
    const { clientWidth: width, clientHeight: height } = view;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (!framed) { frame(); framed = true; }
    draw();
  }
  controls.addEventListener("change", draw);
  new ResizeObserver(fit).observe(view);
  renderer.domElement.addEventListener("dblclick", () => { frame(); draw(); });
  return { world, rock, draw, fit };
})();

const slider = document.getElementById("time");
const replay = data.replay;
const frames = replay ? replay.poses.length : 0;
const timeOf = frame => replay.start + frame * replay.step;

// Ground acceleration: three components on one scale, and the tilt below, over the time that the slider covers.
const PAD = { left: 46, right: 8, top: 4, bottom: 18 };
const traces = document.getElementById("traces");
function drawTraces() {
  const canvas = traces.querySelector("canvas"), scale = devicePixelRatio || 1;
  const width = traces.clientWidth, height = traces.clientHeight;
  canvas.width = width * scale; canvas.height = height * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.font = "11px system-ui, sans-serif";
  const end = timeOf(frames - 1), across = time => PAD.left + (time - replay.start) / (end - replay.start) * (width - PAD.left - PAD.right);
  const rows = [...["east", "north", "up"].map((name, k) => ({ name, values: replay.ground.values[k], step: replay.ground.step, from: replay.ground.start, colour: replay.colours[k], most: replay.ground.peak, least: -replay.ground.peak })),
    { name: "tilt °", values: replay.tilt, step: replay.step, from: replay.start, colour: "#222", most: Math.max(...replay.tilt, 1e-3), least: 0 }];
  pen.fillStyle = "#444"; pen.textBaseline = "bottom"; pen.textAlign = "center";
  const round = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find(step => (end - replay.start) / step <= width / 70) || 200;
  for (let time = Math.ceil(replay.start / round) * round; time <= end; time += round) {
    const x = across(time);
    if (x < width - 24) pen.fillText(+time.toFixed(2) + " s", x, height - 1);
    pen.strokeStyle = "#eee"; pen.beginPath(); pen.moveTo(x, PAD.top); pen.lineTo(x, height - PAD.bottom); pen.stroke();
  }
  const band = (height - PAD.top - PAD.bottom) / rows.length;
  rows.forEach((row, k) => {
    const top = PAD.top + k * band + 3, low = top + band - 6;
    const up = value => low - (value - row.least) / (row.most - row.least) * (low - top);
    pen.strokeStyle = "#ddd"; pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(PAD.left, up(0)); pen.lineTo(width - PAD.right, up(0)); pen.stroke();
    pen.strokeStyle = row.colour; pen.lineWidth = 1.1;
    pen.beginPath();
    row.values.forEach((value, i) => {
      const x = across(row.from + i * row.step);
      i ? pen.lineTo(x, up(value)) : pen.moveTo(x, up(value));
    });
    pen.stroke();
    pen.fillStyle = row.colour; pen.textAlign = "left"; pen.textBaseline = "middle";
    pen.fillText(row.name, 2, (top + low) / 2);
    pen.fillStyle = "#666"; pen.textAlign = "right";
    pen.textBaseline = "top"; pen.fillText(row.most < 10 ? row.most.toPrecision(2) : Math.round(row.most), PAD.left - 3, top - 3);
  });
  if (replay.noReturn !== null) {
    const x = across(replay.noReturn);
    pen.strokeStyle = pen.fillStyle = replay.alarm; pen.setLineDash([5, 3]); pen.lineWidth = 1.5;
    pen.beginPath(); pen.moveTo(x, PAD.top); pen.lineTo(x, height - PAD.bottom); pen.stroke();
    pen.setLineDash([]); pen.textBaseline = "top";
    const left = x > width - 80;
    pen.textAlign = left ? "right" : "left"; pen.fillText("no return", x + (left ? -4 : 4), PAD.top);
  }
}

const told = document.getElementById("told"), button = document.getElementById("play");
const speed = document.getElementById("speed"), cursor = document.getElementById("cursor");
let arrow = null;
if (replay && stage) {
  stage.world.add(curve(replay.poses.map(pose => pose.slice(0, 3)), "#555555", { through: true }));
  if (replay.noReturn !== null) {
    const mark = new THREE.Mesh(new THREE.SphereGeometry(0.035 * data.camera.radius, 20, 14),
      new THREE.MeshBasicMaterial({ color: replay.alarm, depthTest: false }));
    mark.position.set(...replay.noReturnAt);
    mark.renderOrder = 3;
    stage.world.add(mark);
  }
  arrow = new THREE.ArrowHelper(new THREE.Vector3(1, 0, 0), new THREE.Vector3(...replay.arrowAt), 1, replay.arrowColour);
  for (const part of [arrow.line, arrow.cone]) { part.material.depthTest = false; part.renderOrder = 4; }
  stage.world.add(arrow);
}

function show(frame) {
  const [x, y, z, qx, qy, qz, qw] = replay.poses[frame];
  const time = timeOf(frame);
  const at = Math.round((time - replay.ground.start) / replay.ground.step);
  const ground = replay.ground.values.map(values => values[at] ?? 0);
  const strength = Math.hypot(...ground);
  const past = replay.noReturn !== null && time >= replay.noReturn;
  slider.value = frame;
  view.dataset.frame = frame;
  told.value = `${time.toFixed(2)} s, tilt ${replay.tilt[frame].toFixed(2)}°, ground ${strength.toFixed(1)} m/s²` + (past ? ", past no return" : "");
  told.classList.toggle("past", past);
  cursor.style.left = `${PAD.left + frame / (frames - 1) * (traces.clientWidth - PAD.left - PAD.right)}px`;
  if (!stage) return;
  stage.rock.position.set(x, y, z);
  stage.rock.quaternion.set(qx, qy, qz, qw);
  const length = 0.9 * data.camera.radius * strength / replay.ground.strongest;
  arrow.visible = length > 0.02 * data.camera.radius;
  if (arrow.visible) {
    arrow.setDirection(new THREE.Vector3(...ground).normalize());
    arrow.setLength(length, Math.min(0.12 * data.camera.radius, 0.5 * length), Math.min(0.07 * data.camera.radius, 0.3 * length));
  }
  stage.draw();
}

let playing = false, since = 0, from = 0;
function tick(now) {
  if (!playing) return;
  const frame = from + Math.floor((now - since) / 1000 * speed.value / replay.step);
  if (frame >= frames) { show(frames - 1); stop(); return; }
  show(frame);
  requestAnimationFrame(tick);
}
function stop() { playing = false; button.textContent = "play"; }
function go() {
  from = +slider.value >= frames - 1 ? 0 : +slider.value;
  since = performance.now(); playing = true; button.textContent = "pause"; requestAnimationFrame(tick);
}
if (replay) {
  button.onclick = () => playing ? stop() : go();
  speed.onchange = () => { if (playing) go(); };
  slider.oninput = () => { stop(); show(+slider.value); };
  const seek = event => {
    const share = (event.clientX - traces.getBoundingClientRect().left - PAD.left) / (traces.clientWidth - PAD.left - PAD.right);
    stop(); show(Math.round(Math.min(1, Math.max(0, share)) * (frames - 1)));
  };
  traces.onpointerdown = event => { traces.setPointerCapture(event.pointerId); seek(event); };
  traces.onpointermove = event => { if (event.buttons) seek(event); };
  document.addEventListener("keydown", event => {
    if (event.code === "Space" && !["BUTTON", "SELECT"].includes(event.target.tagName)) { event.preventDefault(); button.click(); }
  });
  new ResizeObserver(() => { drawTraces(); show(+slider.value); }).observe(traces);
  if (stage) stage.fit();
  show(0);
} else if (stage) {
  stage.fit();
}
