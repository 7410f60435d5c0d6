// A scene in parallel projection on a canvas, z upwards: drag or use the arrow keys to turn, wheel or + and - to zoom.
// paint(pen) is called for every picture; pen draws lines, dots, faces and words given in the frame of the base, in m.
function sceneOn(canvas, low, high, paint) {
  const context = canvas.getContext("2d");
  const centre = low.map((v, i) => (v + high[i]) / 2);
  const radius = Math.max(Math.hypot(...low.map((v, i) => high[i] - v)) / 2, 1e-3);
  const start = { turn: -0.9, tilt: 0.45, zoom: Number(canvas.dataset.zoom) || 1 };
  let { turn, tilt, zoom } = start, drawn = [];
  const colour = name => getComputedStyle(canvas).getPropertyValue(name).trim() || name;

  function project(p) {  // to pixels, and how far in front
    const [x, y, z] = p.map((v, i) => v - centre[i]);
    const c = Math.cos(turn), s = Math.sin(turn), scale = zoom * Math.min(canvas.width, canvas.height) / 2.2 / radius;
    const side = c * x - s * y, depth = s * x + c * y;
    return [canvas.width / 2 + scale * side, canvas.height / 2 - scale * (Math.cos(tilt) * z + Math.sin(tilt) * depth),
      Math.sin(tilt) * z - Math.cos(tilt) * depth];
  }
  const add = (depth, draw) => drawn.push([depth, draw]);
  const pen = {
    radius, colour,
    line(path, shade, width, front = 0) {
      const points = path.map(project), inside = points.reduce((sum, p) => sum + p[2], 0) / points.length;
      add(inside + front, () => {
        context.strokeStyle = shade; context.lineWidth = width * devicePixelRatio; context.lineJoin = "round"; context.lineCap = "round";
        context.beginPath(); points.forEach(([x, y], i) => i ? context.lineTo(x, y) : context.moveTo(x, y)); context.stroke();
      });
    },
    arrow(from, to, shade, width) {
      pen.line([from, to], shade, width);
      const a = project(from), b = project(to), long = Math.hypot(b[0] - a[0], b[1] - a[1]);
      if (long < 3 * devicePixelRatio) return;
      const head = Math.min(6 * devicePixelRatio, 0.4 * long), u = [(b[0] - a[0]) / long, (b[1] - a[1]) / long];
      add(b[2], () => {
        context.fillStyle = shade; context.beginPath(); context.moveTo(b[0], b[1]);
        context.lineTo(b[0] - head * (u[0] + 0.45 * u[1]), b[1] - head * (u[1] - 0.45 * u[0]));
        context.lineTo(b[0] - head * (u[0] - 0.45 * u[1]), b[1] - head * (u[1] + 0.45 * u[0])); context.fill();
      });
    },
    dot(p, shade, size, front = 0) {
      const [x, y, depth] = project(p);
      add(depth + front, () => {
        context.fillStyle = shade; context.beginPath(); context.arc(x, y, size * devicePixelRatio, 0, 2 * Math.PI); context.fill();
      });
    },
    face(corners, rgb) {  // lit from above and from the reader's left; seen from both sides
      const [a, b, c] = corners.map(project), area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
      if (!area) return;
      const [p, q, r] = corners, u = q.map((v, i) => v - p[i]), w = r.map((v, i) => v - p[i]);
      const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const size = Math.hypot(...n) || 1, side = (Math.cos(turn) * n[0] - Math.sin(turn) * n[1]) / size;
      const flip = area > 0 ? -1 : 1, light = 0.62 + 0.28 * flip * n[2] / size - 0.12 * flip * side;
      add((a[2] + b[2] + c[2]) / 3, () => {
        context.fillStyle = context.strokeStyle = `rgb(${rgb.map(v => Math.round(255 * v * light)).join(",")})`;
        context.lineWidth = 1; context.beginPath(); [a, b, c].forEach(([x, y], i) => i ? context.lineTo(x, y) : context.moveTo(x, y));
        context.closePath(); context.fill(); context.stroke();
      });
    },
    word(text, p, shade) {
      const [x, y] = project(p);
      add(Infinity, () => { context.fillStyle = shade; context.font = `${12 * devicePixelRatio}px system-ui, sans-serif`; context.fillText(text, x + 3, y - 3); });
    },
    frame(size, shade) {
      [["x", [size, 0, 0]], ["y", [0, size, 0]], ["z", [0, 0, size]]].forEach(([name, end]) => { pen.arrow([0, 0, 0], end, shade, 1.2); pen.word(name, end, shade); });
    },
    floor(z, shade) {  // lines a round length apart, and what that length is
      const wide = high.map((v, i) => v - low[i]), step = rounded(Math.max(wide[0], wide[1]) / 5 || radius / 3);
      const [x0, y0] = [0, 1].map(i => Math.floor(low[i] / step) * step), [x1, y1] = [0, 1].map(i => Math.ceil(high[i] / step) * step);
      for (let x = x0; x <= x1 + step / 2; x += step) pen.line([[x, y0, z], [x, y1, z]], shade, 0.7, -1e3);
      for (let y = y0; y <= y1 + step / 2; y += step) pen.line([[x0, y, z], [x1, y, z]], shade, 0.7, -1e3);
      return step;
    },
    scale(step, shade) {  // a bar of one step in the corner
      const long = step * zoom * Math.min(canvas.width, canvas.height) / 2.2 / radius, d = devicePixelRatio, y = canvas.height - 14 * d;
      add(Infinity, () => {
        context.strokeStyle = context.fillStyle = shade; context.lineWidth = 2 * d; context.beginPath();
        context.moveTo(14 * d, y - 4 * d); context.lineTo(14 * d, y); context.lineTo(14 * d + long, y); context.lineTo(14 * d + long, y - 4 * d);
        context.stroke(); context.font = `${12 * d}px system-ui, sans-serif`;
        context.fillText(step >= 1 ? `${step} m` : `${Math.round(step * 1000)} mm`, 14 * d + long + 6 * d, y + 2 * d);
      });
    },
  };
  function rounded(v) { const power = 10 ** Math.floor(Math.log10(v)); return power * [1, 2, 5].filter(s => s * power <= v * 1.000001).pop(); }
  function draw() {
    canvas.width = Math.max(canvas.clientWidth, 1) * devicePixelRatio; canvas.height = Math.max(canvas.clientHeight, 1) * devicePixelRatio;
    drawn = []; paint(pen);
    drawn.sort((a, b) => a[0] - b[0]).forEach(([, one]) => one());
  }
  let from = null;
  canvas.onpointerdown = e => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
  canvas.onpointerup = canvas.onpointercancel = () => { from = null; };
  canvas.onpointermove = e => {
    if (!from) return;
    turn += (e.clientX - from[0]) / 150; tilt = Math.min(Math.max(tilt + (e.clientY - from[1]) / 150, -1.57), 1.57);
    from = [e.clientX, e.clientY]; draw();
  };
  canvas.onwheel = e => { if (canvas.dataset.wheel !== "no" || e.ctrlKey) { e.preventDefault(); zoom *= Math.exp(-e.deltaY / 600); draw(); } };
  canvas.ondblclick = () => { ({ turn, tilt, zoom } = start); draw(); };
  canvas.onkeydown = e => {
    const steps = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (steps) { turn += steps[0]; tilt = Math.min(Math.max(tilt + steps[1], -1.57), 1.57); }
    else if (e.key === "+" || e.key === "-") zoom *= e.key === "+" ? 1.15 : 1 / 1.15;
    else return;
    e.preventDefault(); draw();
  };
  addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  return draw;
}
