// What the page needs of three.js (MIT licence, three.LICENSE). The file three.min.js is made from it by:
//   npm install three@0.187.0 esbuild
//   npx esbuild three.entry.js --bundle --minify --format=iife --global-name=THREE --target=es2022 --outfile=three.min.js \
//     "--banner:js=/* three.js 0.187.0, MIT licence: see three.LICENSE; made from three.entry.js */"
export {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, ColorManagement, CylinderGeometry, DataTexture,
  DoubleSide, EdgesGeometry, FloatType, Group, LineBasicMaterial,
  LineSegments, LinearFilter, LinearSRGBColorSpace, Mesh, MeshBasicMaterial, PerspectiveCamera, PlaneGeometry,
  Points, RGBAFormat, Scene, ShaderMaterial, SphereGeometry, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
