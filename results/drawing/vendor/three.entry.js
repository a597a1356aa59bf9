// What the pages use of three.js. Bundled into three.min.js by
//   npm install three@0.187.0 esbuild@0.28.2
//   npx esbuild three.entry.js --bundle --minify --format=iife --global-name=THREE --charset=utf8 --legal-comments=none --outfile=three.min.js
export {
  ArrowHelper, BufferAttribute, BufferGeometry, CatmullRomCurve3, Color, DirectionalLight, DoubleSide, Group, HemisphereLight,
  Line, LineBasicMaterial, LineDashedMaterial, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Plane, Points,
  PointsMaterial, Scene, SphereGeometry, TubeGeometry, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
