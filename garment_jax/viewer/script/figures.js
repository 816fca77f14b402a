// The figures on the stage: one garment a clip, one body for all of them.

class GarmentFigure {
  constructor(clip, faces, edges, shared) {
    const n = clip.vertices;
    const dynamic = (size) => new THREE.BufferAttribute(new Float32Array(n * size), size).setUsage(THREE.DynamicDrawUsage);
    this.clip = clip;
    this.faces = faces;
    this.position = dynamic(3);
    this.normal = dynamic(3);
    this.error = dynamic(1);
    this.mark = dynamic(1); // 0 none, 1 inside the body, 2 through itself
    const attributes = { position: this.position, normal: this.normal, error: this.error, mark: this.mark };
    const geometry = (index) => {
      const made = new THREE.BufferGeometry();
      for (const [name, attribute] of Object.entries(attributes)) made.setAttribute(name, attribute);
      if (index) made.setIndex(new THREE.BufferAttribute(index, 1));
      return made;
    };
    const surface = geometry(faces);
    this.cloth = new THREE.Mesh(surface, clothMaterial(shared, new THREE.Vector3(...clip.colour)));
    this.shadow = new THREE.Mesh(surface, shadowMaterial(shared));
    this.wire = new THREE.LineSegments(geometry(edges), wireMaterial());
    this.marks = new THREE.Points(geometry(null), markMaterial(shared));
    this.group = new THREE.Group();
    this.group.add(this.shadow, this.cloth, this.wire, this.marks);
    [this.shadow, this.cloth, this.wire, this.marks].forEach((thing, order) => {
      thing.frustumCulled = false; // its bounds change with every frame
      thing.renderOrder = order;
    });
  }

  // Takes frame's positions, normals, errors and marks; returns { rmse, largest, inside, crossing } where known.
  show(frame, truth, step) {
    const { steps, vertices: n, marks } = this.clip;
    const positions = this.position.array;
    for (let i = 0, at = 3 * n * frame; i < 3 * n; i++, at++) positions[i] = step * steps[at];
    vertexNormals(positions, this.faces, this.normal.array);
    this.position.needsUpdate = this.normal.needsUpdate = true;
    const figures = {};
    if (truth && truth !== this.clip) {
      Object.assign(figures, measureFrame(steps, truth.steps, frame, n, 100 * step, this.error.array));
      this.error.needsUpdate = true;
    }
    if (marks) {
      const row = Math.ceil(n / 8) * frame;
      this.mark.array.fill(0);
      for (const [value, name] of [[2, "crossing"], [1, "inside"]]) {
        const bits = marks[name];
        if (!bits) continue;
        for (let i = 0; i < n; i++) if ((bits[row + (i >> 3)] >> (i & 7)) & 1) this.mark.array[i] = value;
        figures[name] = countBits(bits, row, row + Math.ceil(n / 8));
      }
      this.mark.needsUpdate = true;
    }
    return figures;
  }

  // `see`: the choices; `over`: drawn over other clips, where the truth lets them shine through.
  dress(see, over) {
    const measured = this.clip.measured && see.error;
    const through = over && this.clip.isTruth;
    const { uniforms } = this.cloth.material;
    uniforms.hot.value = measured ? 1 : 0;
    uniforms.opacity.value = through ? 0.42 : 1;
    this.cloth.material.transparent = through;
    this.cloth.material.depthWrite = !through;
    this.cloth.renderOrder = through ? 5 : 1;
    this.wire.visible = see.wire;
    const ink = over ? this.clip.colour.map((c) => 0.55 * c) : [0.04, 0.05, 0.07];
    this.wire.material.uniforms.ink.value.set(...ink);
    this.marks.visible = see.inside && Boolean(this.clip.marks);
  }
}

class BodyFigure {
  constructor(body, shared) {
    this.matrices = body.matrices;
    this.size = 12 * body.joints;
    this.texels = new Float32Array(this.size);
    this.texture = new THREE.DataTexture(this.texels, 3 * body.joints, 1, THREE.RGBAFormat, THREE.FloatType);
    const geometry = new THREE.BufferGeometry();
    const normals = new Float32Array(body.vertices.length);
    vertexNormals(body.vertices, body.faces, normals);
    geometry.setAttribute("position", new THREE.BufferAttribute(body.vertices, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
    const colours = Float32Array.from(body.colours, (byte) => byte / 255);
    geometry.setAttribute("colour", new THREE.BufferAttribute(colours, 3));
    for (const half of [0, 1]) {
      for (const [name, values] of [["joints", body.skinJoints], ["weights", body.skinWeights]]) {
        const own = Float32Array.from({ length: values.length / 2 }, (_, i) => values[8 * (i >> 2) + 4 * half + (i & 3)]);
        geometry.setAttribute(`${name}${half}`, new THREE.BufferAttribute(own, 4));
      }
    }
    geometry.setIndex(new THREE.BufferAttribute(body.faces, 1));
    this.group = new THREE.Group();
    this.group.add(
      new THREE.Mesh(geometry, shadowMaterial(shared, this.texture)),
      new THREE.Mesh(geometry, bodyMaterial(this.texture)),
    );
    this.group.children.forEach((thing, order) => {
      thing.frustumCulled = false;
      thing.renderOrder = order;
    });
  }

  show(frame) {
    this.texels.set(this.matrices.subarray(this.size * frame, this.size * (frame + 1)));
    this.texture.needsUpdate = true;
  }
}
