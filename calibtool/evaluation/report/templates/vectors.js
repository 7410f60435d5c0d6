"use strict";
// Error vectors in three dimensions, drawn in parallel projection. No library, nothing loaded.
(() => {
  const find = (id) => document.getElementById(id);
  const data = JSON.parse(find("vectors-data").textContent);
  const canvas = find("vectors-view"), context = canvas.getContext("2d");
  const method = find("vectors-method"), slider = find("vectors-scale");
  const points = data.positions_m;
  const low = [0, 1, 2].map((k) => Math.min(...points.map((p) => p[k])));
  const high = [0, 1, 2].map((k) => Math.max(...points.map((p) => p[k])));
  const centre = low.map((v, k) => (v + high[k]) / 2);
  const radius = Math.max(Math.hypot(...low.map((v, k) => high[k] - v)) / 2, 1e-3);
  const start = { azimuth: -0.9, elevation: 0.45, zoom: 1 };
  let view = { ...start };

  // Screen coordinates of a point in m; z up, the viewer at the azimuth and elevation.
  function projector(width, height) {
    const scale = (0.5 * Math.min(width, height) * view.zoom) / radius;
    const [sa, ca] = [Math.sin(view.azimuth), Math.cos(view.azimuth)];
    const [se, ce] = [Math.sin(view.elevation), Math.cos(view.elevation)];
    return (p) => {
      const [x, y, z] = p.map((v, k) => v - centre[k]);
      return [width / 2 + scale * (ca * y - sa * x), height / 2 - scale * (ce * z - se * (ca * x + sa * y))];
    };
  }

  function segment(a, b) {
    context.moveTo(...a);
    context.lineTo(...b);
  }

  function box(project, ink, quiet) {
    context.strokeStyle = quiet;
    context.lineWidth = 1;
    context.beginPath();
    const corner = (i) => project([0, 1, 2].map((k) => (i & (1 << k) ? high[k] : low[k])));
    for (let i = 0; i < 8; i++) for (let k = 0; k < 3; k++) if (!(i & (1 << k))) segment(corner(i), corner(i | (1 << k)));
    context.stroke();
    context.fillStyle = ink;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    for (let k = 0; k < 3; k++) {
      const middle = low.map((v, j) => (j === k ? (v + high[j]) / 2 : v));
      const [x, y] = project(middle);
      const text = `${"xyz"[k]} ${low[k].toFixed(2)} … ${high[k].toFixed(2)} m`.replaceAll("-", "−");
      const half = context.measureText(text).width / 2 + 4;
      context.fillText(text, Math.max(half, Math.min(canvas.clientWidth - half, x)), y + 14);
    }
  }

  function draw() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const project = projector(width, height);
    box(project, colour("--ink"), colour("--grid"));
    const chosen = Number(method.value), shown = data.methods[chosen];
    const factor = shown.factor * 10 ** Number(slider.value);
    find("vectors-factor").textContent = `× ${factor.toPrecision(2) * 1}`;
    const hue = colour(chosen === 0 ? "--m0" : `--m${1 + ((chosen - 1) % 6)}`);
    context.strokeStyle = context.fillStyle = hue;
    context.lineWidth = 1.5;
    context.beginPath();
    points.forEach((p, i) => {
      const from = project(p), to = project(p.map((v, k) => v + factor * 1e-3 * shown.errors_mm[i][k]));
      segment(from, to);
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(dx, dy);
      if (length > 4) {
        const [ux, uy] = [(dx / length) * 5, (dy / length) * 5];
        segment(to, [to[0] - ux - uy / 2, to[1] - uy + ux / 2]);
        segment(to, [to[0] - ux + uy / 2, to[1] - uy - ux / 2]);
      }
    });
    context.stroke();
    for (const p of points) {
      const [x, y] = project(p);
      context.fillRect(x - 1, y - 1, 2, 2);
    }
  }

  function turn(azimuth, elevation) {
    view.azimuth += azimuth;
    view.elevation = Math.max(-1.57, Math.min(1.57, view.elevation + elevation));
    draw();
  }

  const keys = {
    ArrowLeft: () => turn(0.1, 0), ArrowRight: () => turn(-0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    "+": () => { view.zoom *= 1.2; draw(); }, "-": () => { view.zoom /= 1.2; draw(); },
  };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(-0.008 * event.movementX, 0.008 * event.movementY);
  });
  method.addEventListener("change", draw);
  slider.addEventListener("input", draw);
  find("vectors-reset").addEventListener("click", () => {
    view = { ...start };
    slider.value = 0;
    draw();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => (d.open = d.querySelectorAll("tr").length < 200)));
  find("workspace").hidden = false;
  new ResizeObserver(draw).observe(canvas);
  draw();
})();
