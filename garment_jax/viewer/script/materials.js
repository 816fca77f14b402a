// The shaders. Light is linear, colours come and go as sRGB; one key light stands at the camera's left.

const LIGHT = `
  vec3 linear(vec3 c) { return pow(c, vec3(2.2)); }
  vec3 shade(vec3 colour, vec3 normal, vec3 toEye, float inner) {
    vec3 n = normalize(normal + vec3(0.0, 0.0, 1e-9)), eye = normalize(toEye);
    if (dot(n, eye) < 0.0) n = -n;
    vec3 up = (viewMatrix * vec4(0.0, 1.0, 0.0, 0.0)).xyz;
    float key = max(dot(n, normalize(vec3(-0.62, 0.25, 0.62) + 0.55 * up)), 0.0);
    float fill = max(dot(n, normalize(vec3(0.8, 0.0, 0.45))), 0.0);
    vec3 sky = mix(vec3(0.25, 0.235, 0.22), vec3(0.42, 0.45, 0.50), 0.5 + 0.5 * dot(n, up));
    vec3 light = sky + 0.88 * key + vec3(0.10, 0.115, 0.14) * fill;
    vec3 lit = linear(colour) * light * inner;
    lit += 0.05 * pow(1.0 - max(dot(n, eye), 0.0), 4.0);
    return pow(min(lit, vec3(1.0)), vec3(1.0 / 2.2));
  }`;

// Linear blend skinning by the matrices of one frame, three texels a joint.
const SKINNING = `
  attribute vec4 joints0, joints1, weights0, weights1;
  uniform highp sampler2D matrices;
  mat4x3 posed() {
    vec4 x = vec4(0.0), y = vec4(0.0), z = vec4(0.0);
    for (int k = 0; k < 8; k++) {
      float weight = k < 4 ? weights0[k] : weights1[k - 4];
      int j = 3 * int((k < 4 ? joints0[k] : joints1[k - 4]) + 0.5);
      x += weight * texelFetch(matrices, ivec2(j, 0), 0);
      y += weight * texelFetch(matrices, ivec2(j + 1, 0), 0);
      z += weight * texelFetch(matrices, ivec2(j + 2, 0), 0);
    }
    return mat4x3(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z, x.w, y.w, z.w);
  }`;

function clothMaterial(shared, colour) {
  return new THREE.ShaderMaterial({
    uniforms: { ...shared, colour: { value: colour }, hot: { value: 0 }, opacity: { value: 1 } },
    side: THREE.DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
    vertexShader: `
      attribute float error;
      varying vec3 vNormal, vToEye;
      varying float vError;
      void main() {
        vec4 view = modelViewMatrix * vec4(position, 1.0);
        vNormal = normalMatrix * normal;
        vToEye = -view.xyz;
        vError = error;
        gl_Position = projectionMatrix * view;
      }`,
    fragmentShader: `
      uniform vec3 colour, heat[6];
      uniform float hot, heatTop, opacity;
      varying vec3 vNormal, vToEye;
      varying float vError;
      ${LIGHT}
      void main() {
        float place = clamp(vError / heatTop, 0.0, 1.0) * 5.0;
        int low = min(int(place), 4);
        vec3 hotColour = mix(heat[low], heat[low + 1], place - float(low));
        vec3 own = mix(colour, hotColour, hot);
        float inner = gl_FrontFacing ? 1.0 : mix(0.62, 0.85, hot);
        vec3 lit = shade(own, vNormal, vToEye, inner);
        gl_FragColor = vec4(mix(lit, own, 0.35 * hot), opacity); // less shade: the colours are to be read
      }`,
  });
}

function bodyMaterial(matrices) {
  return new THREE.ShaderMaterial({
    uniforms: { matrices: { value: matrices } },
    vertexShader: `
      ${SKINNING}
      attribute vec3 colour;
      varying vec3 vNormal, vToEye, vColour;
      void main() {
        vColour = colour;
        mat4x3 skin = posed();
        vec4 view = modelViewMatrix * vec4(skin * vec4(position, 1.0), 1.0);
        vNormal = normalMatrix * (skin * vec4(normal, 0.0));
        vToEye = -view.xyz;
        gl_Position = projectionMatrix * view;
      }`,
    fragmentShader: `
      varying vec3 vNormal, vToEye, vColour;
      ${LIGHT}
      void main() { gl_FragColor = vec4(shade(vColour, vNormal, vToEye, 1.0), 1.0); }`,
  });
}

// A flat shadow on the floor; the stencil keeps what overlaps from darkening twice.
function shadowMaterial(shared, matrices) {
  const [declaration, point] = matrices
    ? [SKINNING, "posed() * vec4(position, 1.0)"]
    : ["", "position"];
  return new THREE.ShaderMaterial({
    uniforms: { ...shared, ...(matrices ? { matrices: { value: matrices } } : {}) },
    side: THREE.DoubleSide,
    transparent: true,
    depthWrite: false,
    stencilWrite: true,
    stencilFunc: THREE.EqualStencilFunc,
    stencilRef: 0,
    stencilZPass: THREE.IncrementStencilOp,
    vertexShader: `
      ${declaration}
      uniform float floorHeight;
      void main() {
        vec4 world = modelMatrix * vec4(${point}, 1.0);
        world.xz += vec2(0.28, -0.16) * (world.y - floorHeight);
        world.y = floorHeight + 0.002;
        gl_Position = projectionMatrix * viewMatrix * world;
      }`,
    fragmentShader: "void main() { gl_FragColor = vec4(0.05, 0.07, 0.10, 0.17); }",
  });
}

function wireMaterial() {
  return new THREE.ShaderMaterial({
    transparent: true,
    uniforms: { ink: { value: new THREE.Vector3(0.04, 0.05, 0.07) }, strength: { value: 0.42 } },
    vertexShader: "void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
    fragmentShader:
      "uniform vec3 ink; uniform float strength; void main() { gl_FragColor = vec4(ink, strength); }",
  });
}

// Marks lie inside the body or between folds: they are drawn 4 cm nearer to the eye, so that no surface hides them.
function markMaterial(shared) {
  return new THREE.ShaderMaterial({
    transparent: true,
    uniforms: shared,
    vertexShader: `
      attribute float mark;
      uniform float pixels;
      varying float vMark;
      void main() {
        vec4 view = modelViewMatrix * vec4(position, 1.0);
        gl_Position = projectionMatrix * view;
        vec4 nearer = projectionMatrix * (view + vec4(0.0, 0.0, 0.04, 0.0));
        gl_Position.z = nearer.z / nearer.w * gl_Position.w;
        vMark = mark;
        if (mark < 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
        gl_PointSize = pixels * clamp(22.0 / gl_Position.w, 5.0, 14.0);
      }`,
    fragmentShader: `
      varying float vMark;
      void main() {
        float r = length(gl_PointCoord - 0.5);
        if (r > 0.5) discard;
        vec3 own = vMark > 1.5 ? vec3(0.98, 0.55, 0.0) : vec3(0.84, 0.06, 0.42);
        gl_FragColor = vec4(r > 0.34 ? vec3(1.0) : own, 1.0);
      }`,
  });
}

function floorMaterial(shared) {
  return new THREE.ShaderMaterial({
    transparent: true,
    depthWrite: false,
    side: THREE.DoubleSide,
    uniforms: shared,
    vertexShader: `
      varying vec3 vWorld;
      void main() {
        vWorld = (modelMatrix * vec4(position, 1.0)).xyz;
        gl_Position = projectionMatrix * viewMatrix * vec4(vWorld, 1.0);
      }`,
    fragmentShader: `
      uniform vec3 grid, centre;
      varying vec3 vWorld;
      float lines(float spacing) {
        vec2 at = vWorld.xz / spacing;
        vec2 away = abs(fract(at - 0.5) - 0.5) / max(fwidth(at), vec2(1e-6));
        return 1.0 - min(min(away.x, away.y), 1.0);
      }
      void main() {
        float fade = 1.0 - smoothstep(1.0, 4.0, distance(vWorld.xz, centre.xz));
        gl_FragColor = vec4(grid, fade * max(0.75 * lines(1.0), 0.30 * lines(0.25)));
      }`,
  });
}
