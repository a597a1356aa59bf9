// The cloud in three dimensions: what is drawn, the eye, and which point a click means.
const COLOURS = { 0: "#d9a066", 1: "#7d8b99", 2: "#c3c9bd" };
const REACH_PX = 7;
const FOV_DEG = 35;

export class Stage {
  constructor(view, onDraw) {
    this.view = view;
    this.onDraw = onDraw;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    view.prepend(this.renderer.domElement);
    this.world = new THREE.Scene();
    this.world.background = new THREE.Color("#f4f6f8");
    this.camera = new THREE.PerspectiveCamera(FOV_DEG, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.draw());
    this.renderer.localClippingEnabled = true;
    this.parts = [];
    this.overlay = new THREE.Group();
    this.world.add(this.overlay);
    this.home = { target: [0, 0, 0], radius: 1 };
    new ResizeObserver(() => this.fit()).observe(view);
    this.fit();
  }

  // Points of the whole cloud, then finer ones around the rock.
  setCloud(buffer, counts, spacings) {
    this.clear();
    const all = this.points(buffer, 0, counts[0] + counts[1]);
    this.places = all.places;
    this.label = all.label;
    let first = 0;
    counts.forEach((count, k) => {
      if (count) this.add({ places: all.places.subarray(3 * first, 3 * (first + count)), colours: all.colours.subarray(3 * first, 3 * (first + count)) }, spacings[k]);
      first += count;
    });
    this.measure();
    this.draw();
  }

  // All points of a cube, in place of the thinned ones there.
  setDetail(buffer, middle, reach) {
    const spacing = new DataView(buffer).getFloat32(0, true), count = (buffer.byteLength - 4) / 14;
    if (this.detail) { this.remove(this.detail); this.detail = null; }
    const faces = [];
    if (count > 100) {
      for (let axis = 0; axis < 3; axis++) for (const sign of [1, -1]) {
        const normal = new THREE.Vector3();
        normal.setComponent(axis, sign);
        faces.push(new THREE.Plane(normal, -sign * middle[axis] - reach));
      }
      this.detail = this.add(this.points(buffer, 4, count), spacing);
    }
    for (const part of this.parts) if (part !== this.detail) Object.assign(part.material, { clippingPlanes: faces, clipIntersection: true, needsUpdate: true });
    this.draw();
  }

  points(buffer, start, total) {
    const places = new Float32Array(buffer, start, 3 * total), colours = new Float32Array(3 * total);
    const bright = new Uint8Array(buffer, start + 12 * total, total), label = new Uint8Array(buffer, start + 13 * total, total);
    const tints = Object.values(COLOURS).map(name => new THREE.Color(name));
    for (let i = 0; i < total; i++) {
      const tint = tints[label[i]], light = bright[i] / 255;
      colours[3 * i] = tint.r * light; colours[3 * i + 1] = tint.g * light; colours[3 * i + 2] = tint.b * light;
    }
    return { places, colours, label };
  }

  add({ places, colours }, spacing) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    // three.js takes a size for an opening of 90 degrees.
    const size = 1.1 * spacing / Math.tan(FOV_DEG * Math.PI / 360);
    const part = new THREE.Points(geometry, new THREE.PointsMaterial({ size, vertexColors: true }));
    part.userData.places = places;
    this.parts.push(part);
    this.world.add(part);
    return part;
  }

  remove(part) {
    this.world.remove(part);
    part.geometry.dispose();
    part.material.dispose();
    this.parts = this.parts.filter(each => each !== part);
  }

  clear() {
    for (const part of [...this.parts]) this.remove(part);
    this.detail = null;
  }

  // What the eye goes home to: the rock, or the whole cloud where it is not known yet.
  measure() {
    const some = this.label.includes(0);
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const all = { low: [...low], high: [...high] };
    for (let i = 0; i < this.label.length; i++)
      for (let k = 0; k < 3; k++) {
        const value = this.places[3 * i + k];
        if (value < all.low[k]) all.low[k] = value;
        if (value > all.high[k]) all.high[k] = value;
        if (some && this.label[i] !== 0) continue;
        if (value < low[k]) low[k] = value;
        if (value > high[k]) high[k] = value;
      }
    this.home = { target: low.map((value, k) => (value + high[k]) / 2), radius: Math.hypot(...low.map((value, k) => high[k] - value)) / 2 };
    const whole = Math.hypot(...all.low.map((value, k) => all.high[k] - value));
    this.camera.near = 0.005 * this.home.radius;
    this.camera.far = 10 * whole;
    this.camera.updateProjectionMatrix();
    this.controls.minDistance = 0.02 * this.home.radius;
    this.controls.maxDistance = 4 * whole;
  }

  frame(eye = [0.55, -0.78, 0.3]) {
    const half = Math.atan(Math.tan(FOV_DEG * Math.PI / 360) * Math.min(1, this.camera.aspect));
    const length = Math.hypot(...eye), distance = 1.05 * this.home.radius / Math.sin(half);
    this.camera.position.set(...this.home.target.map((place, k) => place + distance * eye[k] / length));
    this.controls.target.set(...this.home.target);
    this.controls.update();
    this.draw();
  }

  look(place) {
    const shift = new THREE.Vector3(...place).sub(this.controls.target);
    this.controls.target.add(shift);
    this.camera.position.add(shift);
    this.controls.update();
    this.draw();
  }

  turn(right, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.applyAxisAngle(new THREE.Vector3(0, 0, 1), right);
    const side = new THREE.Vector3(-offset.y, offset.x, 0).normalize(), lifted = offset.clone().applyAxisAngle(side, -up);
    if (Math.hypot(lifted.x, lifted.y) > 0.05 * lifted.length()) offset.copy(lifted);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.draw();
  }

  nearer(factor) {
    const offset = this.camera.position.clone().sub(this.controls.target).multiplyScalar(factor);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.draw();
  }

  fit() {
    const { clientWidth: wide, clientHeight: high } = this.view;
    if (!wide || !high) return;
    this.renderer.setSize(wide, high, false);
    this.camera.aspect = wide / high;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.renderer.render(this.world, this.camera);
      this.onDraw(this);
    });
  }

  // A place on the screen in pixels of the view, with its depth; nothing behind the eye.
  project(place) {
    const seen = new THREE.Vector3(...place).applyMatrix4(this.camera.matrixWorldInverse);
    if (seen.z > -this.camera.near) return null;
    const depth = -seen.z;
    seen.applyMatrix4(this.camera.projectionMatrix);
    return { x: (seen.x + 1) / 2 * this.view.clientWidth, y: (1 - seen.y) / 2 * this.view.clientHeight, depth };
  }

  // Calls with distance in pixels and depth of each shown point near a place of the screen.
  near(x, y, reach, call) {
    this.camera.updateMatrixWorld();
    const m = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse).elements;
    const wide = this.view.clientWidth / 2, high = this.view.clientHeight / 2;
    for (const { userData: { places: p } } of this.parts) for (let j = 0; j < p.length; j += 3) {
      const w = m[3] * p[j] + m[7] * p[j + 1] + m[11] * p[j + 2] + m[15];
      if (w <= 0) continue;
      const dx = ((m[0] * p[j] + m[4] * p[j + 1] + m[8] * p[j + 2] + m[12]) / w + 1) * wide - x;
      if (dx > reach || dx < -reach) continue;
      const dy = (1 - (m[1] * p[j] + m[5] * p[j + 1] + m[9] * p[j + 2] + m[13]) / w) * high - y;
      if (dx * dx + dy * dy <= reach * reach) call(Math.hypot(dx, dy), w);
    }
  }

  // The place on the ray of a click at the depth of the foremost point near it, and the eye; null where nothing is.
  hit(x, y) {
    let front = Infinity;
    for (const reach of [REACH_PX, 3 * REACH_PX]) {
      this.near(x, y, reach, (away, depth) => { front = Math.min(front, depth * (1 + 0.002 * away)); });
      if (front < Infinity) break;
    }
    if (front === Infinity) return null;
    const eye = this.camera.position;
    const ray = new THREE.Vector3(2 * x / this.view.clientWidth - 1, 1 - 2 * y / this.view.clientHeight, 0.5).unproject(this.camera).sub(eye).normalize();
    const along = this.camera.getWorldDirection(new THREE.Vector3());
    const at = ray.multiplyScalar(front / ray.dot(along)).add(eye);
    return { at_m: at.toArray(), eye_m: eye.toArray() };
  }

  hidden(place) {
    const on = this.project(place);
    if (!on) return true;
    let front = Infinity;
    this.near(on.x, on.y, 4, (away, depth) => { front = Math.min(front, depth); });
    return front < on.depth - 0.03 * this.home.radius;
  }

  heading() {
    const along = new THREE.Vector3().subVectors(this.controls.target, this.camera.position);
    return Math.atan2(along.x, along.y) * 180 / Math.PI;
  }

  // Lines of the interface: where rock and pedestal meet, and the plane's square.
  setPlane(plane) {
    this.overlay.clear();
    if (plane) {
      const line = (points, colour, through) => {
        const geometry = new THREE.BufferGeometry().setFromPoints(points.map(point => new THREE.Vector3(...point)));
        const made = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour, depthTest: !through, transparent: true, opacity: through ? 0.9 : 1 }));
        made.renderOrder = through ? 2 : 0;
        this.overlay.add(made);
      };
      this.outline = plane.outline_m;
      for (const ring of [plane.outline_m, ...(plane.outlines || []).map(each => each.outline_m)])
        if (ring.length) line([...ring, ring[0]], "#0057b7", true);
      this.plane = this.sheet(plane);
      this.plane.visible = Boolean(this.aims);
      this.overlay.add(this.plane);
    }
    this.draw();
  }

  showPlane(on) {
    this.aims = on;
    if (this.plane) this.plane.visible = on;
    this.draw();
  }

  // The plane alone, while it is dragged.
  movePlane({ centre, normal }) {
    if (this.plane) this.overlay.remove(this.plane);
    this.plane = this.sheet({ point_m: centre, normal });
    this.overlay.add(this.plane);
    this.draw();
  }

  sheet({ point_m: point, normal }) {
    const up = new THREE.Vector3(...normal), u = new THREE.Vector3(1, 0, 0).addScaledVector(up, -up.x).normalize(), v = up.clone().cross(u);
    const centre = new THREE.Vector3(...this.home.target);
    centre.addScaledVector(up, up.dot(new THREE.Vector3(...point).sub(centre)));
    const size = this.home.radius * 1.1, corners = [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]];
    const places = corners.flatMap(([a, b]) => centre.clone().addScaledVector(u, a * size).addScaledVector(v, b * size).toArray());
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
    return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: "#0057b7", transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false }));
  }
}
