// The plane on which rock and pedestal meet, as a handle: one knob lifts it, two tilt it, by mouse or arrow keys.
const KNOBS = [["lift", "lift or lower the plane"], ["tilt", "tilt the plane"], ["tilt", "tilt the plane across"]];
const SHARE = 0.8;

export const normalOf = (slope, azimuth) => {
  const lean = slope * Math.PI / 180, way = azimuth * Math.PI / 180;
  return [Math.sin(lean) * Math.cos(way), Math.sin(lean) * Math.sin(way), Math.cos(lean)];
};
export const slopeOf = ([x, y, z]) => [Math.atan2(Math.hypot(x, y), z) * 180 / Math.PI, (Math.atan2(y, x) * 180 / Math.PI + 360) % 360];

export class Handles {
  // onMove is told each place of the plane while it is dragged, onSet where it is let go.
  constructor(stage, onMove, onSet) {
    Object.assign(this, { stage, onMove, onSet, shown: false });
    this.knobs = KNOBS.map(([kind, title], k) => {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", className: `knob ${kind}`, title: `${title}: drag, or arrow keys`, hidden: true });
      made.onpointerdown = event => this.take(event, k);
      made.onpointermove = event => this.drag(event, k);
      made.onpointerup = event => this.release(event);
      made.onkeydown = event => this.press(event, k);
      document.getElementById("marks").after(made);
      return made;
    });
  }

  show(on) {
    this.shown = on;
    this.stage.showPlane(on);
    this.place();
  }

  set(plane) {
    if (this.held) return;
    if (!plane) { this.plane = null; return this.place(); }
    const home = this.stage.home, up = plane.normal, at = plane.point_m;
    const over = up[0] * (home.target[0] - at[0]) + up[1] * (home.target[1] - at[1]);
    this.plane = { centre: [home.target[0], home.target[1], at[2] - over / up[2]], normal: [...up] };
    this.place();
  }

  // Where the knobs are: above the middle, and at two ends of the plane.
  spots() {
    const { centre, normal } = this.plane, size = SHARE * this.stage.home.radius;
    const up = new THREE.Vector3(...normal), u = new THREE.Vector3(1, 0, 0).addScaledVector(up, -up.x).normalize(), v = up.clone().cross(u);
    return [u.clone().addScaledVector(v, 1).setLength(0.75 * size), u.setLength(size), v.setLength(size)].map(arm => ({ arm, at: new THREE.Vector3(...centre).add(arm) }));
  }

  place() {
    const spots = this.shown && this.plane ? this.spots() : [];
    this.knobs.forEach((knob, k) => {
      const on = spots[k] && this.stage.project(spots[k].at.toArray());
      knob.hidden = !on;
      if (on) knob.style.transform = `translate(${on.x}px, ${on.y}px)`;
    });
  }

  take(event, k) {
    this.knobs[k].setPointerCapture(event.pointerId);
    this.held = { y: event.clientY, x: event.clientX, from: structuredClone(this.plane) };
    event.preventDefault();
    this.knobs[k].focus({ preventScroll: true });
  }

  drag(event, k) {
    if (!this.held) return;
    this.plane = structuredClone(this.held.from);
    const { at } = this.spots()[k], normal = new THREE.Vector3(...this.plane.normal);
    const here = this.stage.project(at.toArray()), step = 0.01 * this.stage.home.radius;
    const there = this.stage.project(at.clone().addScaledVector(normal, step).toArray());
    if (!here || !there) return;
    const way = [(there.x - here.x) / step, (there.y - here.y) / step], square = way[0] ** 2 + way[1] ** 2;
    if (square < 1) return;  // seen from above: nothing to tell the height by
    this.move(k, ((event.clientX - this.held.x) * way[0] + (event.clientY - this.held.y) * way[1]) / square);
  }

  // Moves a knob along the normal: the first takes the plane along, the others turn it about its middle.
  move(k, distance) {
    const { arm } = this.spots()[k], normal = new THREE.Vector3(...this.plane.normal);
    if (k === 0) this.plane.centre = this.plane.centre.map((each, i) => each + distance * this.plane.normal[i]);
    else {
      const turned = normal.clone().addScaledVector(arm.clone().normalize(), -distance / arm.length()).normalize();
      if (turned.z > 0.5) this.plane.normal = turned.toArray();
    }
    this.place();
    this.onMove(this.plane);
  }

  release() {
    const held = this.held;
    this.held = null;
    if (held && JSON.stringify(held.from) !== JSON.stringify(this.plane)) this.onSet(this.plane);
  }

  press(event, k) {
    const step = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.move(k, step * (event.shiftKey ? 0.02 : 0.004) * this.stage.home.radius);
    clearTimeout(this.later);
    this.later = setTimeout(() => this.onSet(this.plane), 700);
  }
}
