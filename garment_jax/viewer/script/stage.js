// The canvas: clips side by side in panels of one size, or over each other, through one camera.

const FIELD = 30; // degrees, vertical

class Stage {
  constructor(canvas, facts, floor) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, stencil: true });
    this.renderer.autoClear = false;
    this.renderer.setScissorTest(true);
    this.camera = new THREE.PerspectiveCamera(FIELD, 1, 0.05, 60);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => (this.stale = true));
    this.controls.minDistance = 0.2;
    this.controls.maxDistance = 25;
    this.scene = new THREE.Scene();
    this.shared = {
      floorHeight: { value: floor },
      heatTop: { value: 1 },
      heat: { value: facts.heat.map((c) => new THREE.Vector3(...c)) },
      grid: { value: new THREE.Vector3() },
      centre: { value: new THREE.Vector3() },
      pixels: { value: 1 },
    };
    this.floor = new THREE.Mesh(new THREE.PlaneGeometry(10, 10).rotateX(-Math.PI / 2), floorMaterial(this.shared));
    this.floor.position.y = floor;
    this.floor.renderOrder = -1;
    this.scene.add(this.floor);
    this.garments = [];
    this.body = null;
    this.panels = [];
    this.stale = true;
  }

  // The view at the start: the whole figure, half from the side.
  frameFigure(root, height, forward) {
    this.figure = { root, height, forward };
    this.size = height * 1.16;
    const yaw = Math.atan2(forward[0], forward[2]) + (35 * Math.PI) / 180;
    const away = new THREE.Vector3(Math.sin(yaw), 0.18, Math.cos(yaw)).normalize();
    const middle = this.shared.floorHeight.value + height / 2;
    this.controls.target.set(root[0], middle, root[2]);
    this.camera.position.copy(this.controls.target).addScaledVector(away, this.fitting());
    this.controls.update();
    this.stale = true;
  }

  fitting() {
    const half = Math.tan((FIELD * Math.PI) / 360);
    return this.size / 2 / half / Math.min(1, this.camera.aspect / 0.62);
  }

  // Panels in columns where the stage is wide, in rows where it is tall.
  layOut(count) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.shared.pixels.value = ratio;
    let columns = 1;
    let best = 0;
    for (let c = 1; c <= count; c++) {
      const fit = Math.min(height / Math.ceil(count / c), width / c / 0.62);
      if (fit > best * 1.02) [best, columns] = [fit, c];
    }
    const rows = Math.ceil(count / columns);
    const [w, h] = [width / columns, height / rows];
    this.panels = Array.from({ length: count }, (_, i) => ({
      x: (i % columns) * w, y: Math.floor(i / columns) * h, width: w, height: h,
    }));
    const before = this.size ? this.fitting() : 0;
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    if (before) {
      const offset = this.camera.position.clone().sub(this.controls.target);
      this.camera.position.copy(this.controls.target).addScaledVector(offset, this.fitting() / before);
    }
    this.controls.update();
    this.stale = true;
  }

  // Moves the figures to `root`, and the camera with them where it `follow`s.
  place(root, follow) {
    for (const { group } of [...this.garments, ...(this.body ? [this.body] : [])]) group.position.set(...root);
    if (follow && this.root) {
      const [x, z] = [root[0] - this.root[0], root[2] - this.root[2]];
      for (const point of [this.camera.position, this.controls.target]) {
        point.x += x;
        point.z += z;
      }
      this.controls.update();
    }
    this.root = root;
    this.stale = true;
  }

  colour(paper, grid) {
    this.renderer.setClearColor(new THREE.Color(paper));
    const line = new THREE.Color(grid);
    line.convertLinearToSRGB(); // the shaders take and give sRGB
    this.shared.grid.value.set(line.r, line.g, line.b);
    this.stale = true;
  }

  draw(see) {
    const over = see.overlay && this.garments.length > 1;
    if (this.body) this.body.group.visible = see.body;
    this.floor.position.x = this.controls.target.x;
    this.floor.position.z = this.controls.target.z;
    this.shared.centre.value.copy(this.controls.target);
    this.garments.forEach((garment) => garment.dress(see, over));
    this.panels.forEach((panel, i) => {
      const bottom = this.canvas.clientHeight - panel.y - panel.height;
      this.renderer.setViewport(panel.x, bottom, panel.width, panel.height);
      this.renderer.setScissor(panel.x, bottom, panel.width, panel.height);
      this.renderer.clear();
      this.garments.forEach((garment, k) => (garment.group.visible = over || k === i));
      this.renderer.render(this.scene, this.camera);
    });
    this.stale = false;
  }
}
