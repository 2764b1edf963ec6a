// The map on a canvas: what is drawn, and which part of the world is seen.

const COLOURS = ["paper", "grid", "free", "seen", "wall", "path", "scan", "particle", "text"];
// A fit leaves this margin, and shows at least so much [m].
const MARGIN = 0.06;
const LEAST = 6;
// Longest side of the picture of the grid.
const MOST_CELLS = 4096;

export class View {
  constructor(canvas, onMoved) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.onMoved = onMoved;
    this.clear();
    new ResizeObserver(() => this.redraw()).observe(canvas);
    const theme = matchMedia("(prefers-color-scheme: dark)");
    theme.addEventListener("change", () => { this.picture = null; this.redraw(); });
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    this.listen();
  }

  clear() {
    this.shown = null;
    this.picture = null;
    // What is seen: its centre [m] and pixels per metre; null before there is anything to see.
    this.eye = null;
    this.isFitted = true;
    this.redraw();
  }

  // Shows arrays of numbers: walls as x1 y1 x2 y2, path as x y heading, scan as x y, particles as x y heading weight; and the grid.
  show(shown) {
    this.shown = shown;
    this.picture = null;
    this.redraw();
  }

  fit() {
    this.isFitted = true;
    this.onMoved(false);
    this.redraw();
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => { this.frame = null; this.draw(); });
  }

  // The eye that sees all walls and the path.
  wanted(width, height) {
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [numbers, stride] of [[this.shown.walls, 2], [this.shown.path, 3]]) {
      for (let i = 0; i + 1 < numbers.length; i += stride) {
        left = Math.min(left, numbers[i]);
        right = Math.max(right, numbers[i]);
        low = Math.min(low, numbers[i + 1]);
        high = Math.max(high, numbers[i + 1]);
      }
    }
    if (left > right) [left, right, low, high] = [0, 0, 0, 0];
    const wide = Math.max(LEAST, right - left), tall = Math.max(LEAST, high - low);
    const scale = (1 - 2 * MARGIN) * Math.min(width / wide, height / tall);
    return { x: (left + right) / 2, y: (low + high) / 2, scale };
  }

  draw() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== columns || this.canvas.height !== rows) Object.assign(this.canvas, { width: columns, height: rows });
    const style = getComputedStyle(this.canvas);
    const colour = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    const context = this.context;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colour.paper;
    context.fillRect(0, 0, width, height);
    if (!this.shown) return;
    this.look(width, height);
    this.drawMetres(width, height, colour);
    this.drawGrid(colour);
    this.drawWalls(colour);
    this.drawPath(colour);
    this.drawPoints(this.shown.scan, 2, 2.5, colour.scan, 0.75);
    this.drawParticles(colour);
    this.drawRobot(colour);
    this.drawScaleBar(height, colour);
  }

  // Moves the eye to what is wanted: softly, as the map grows.
  look(width, height) {
    if (!this.isFitted && this.eye) return;
    const wanted = this.wanted(width, height);
    const eye = this.eye ?? wanted;
    const share = this.calm.matches ? 1 : 0.2;
    const towards = (name) => eye[name] + share * (wanted[name] - eye[name]);
    this.eye = { x: towards("x"), y: towards("y"), scale: towards("scale") };
    const off = Math.max(Math.abs(wanted.x - this.eye.x) * wanted.scale, Math.abs(wanted.y - this.eye.y) * wanted.scale,
      width * Math.abs(wanted.scale / this.eye.scale - 1));
    if (off < 0.5) this.eye = wanted; else this.redraw();
  }

  // A point of the world in pixels of the page; y points up in the world.
  place(x, y) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [width / 2 + (x - this.eye.x) * this.eye.scale, height / 2 - (y - this.eye.y) * this.eye.scale];
  }

  world(column, row) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [this.eye.x + (column - width / 2) / this.eye.scale, this.eye.y - (row - height / 2) / this.eye.scale];
  }

  // Metres between lines: 1, 2 or 5 times a power of ten, at least so many pixels.
  spacing(pixels) {
    const least = pixels / this.eye.scale;
    const power = 10 ** Math.floor(Math.log10(least));
    return power * [1, 2, 5, 10].find((factor) => factor * power >= least);
  }

  drawMetres(width, height, colour) {
    const context = this.context, step = this.spacing(60);
    const [[left, high], [right, low]] = [this.world(0, 0), this.world(width, height)];
    context.beginPath();
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      const column = Math.round(this.place(x, 0)[0]) + 0.5;
      context.moveTo(column, 0);
      context.lineTo(column, height);
    }
    for (let y = Math.ceil(low / step) * step; y <= high; y += step) {
      const row = Math.round(this.place(0, y)[1]) + 0.5;
      context.moveTo(0, row);
      context.lineTo(width, row);
    }
    context.strokeStyle = colour.grid;
    context.lineWidth = 1;
    context.stroke();
  }

  drawGrid(colour) {
    const grid = this.shown.grid;
    if (!grid) return;
    this.picture ??= picture(grid, this.shown.cells, colour);
    const { x, y, width, height, resolution } = grid;
    const [left, top] = this.place(x, y + height * resolution);
    const side = resolution * this.eye.scale;
    this.context.imageSmoothingEnabled = side < 4;
    this.context.drawImage(this.picture, left, top, width * side, height * side);
  }

  drawWalls(colour) {
    const { context, shown: { walls } } = this;
    context.beginPath();
    for (let i = 0; i + 3 < walls.length; i += 4) {
      context.moveTo(...this.place(walls[i], walls[i + 1]));
      context.lineTo(...this.place(walls[i + 2], walls[i + 3]));
    }
    context.strokeStyle = colour.wall;
    context.lineWidth = Math.min(5, Math.max(1.8, 0.09 * this.eye.scale));
    context.lineCap = "round";
    context.stroke();
  }

  drawPath(colour) {
    const { context, shown: { path } } = this;
    context.beginPath();
    for (let i = 0; i + 1 < path.length; i += 3) context.lineTo(...this.place(path[i], path[i + 1]));
    context.strokeStyle = colour.path;
    context.lineWidth = 1.8;
    context.lineJoin = "round";
    context.stroke();
  }

  drawPoints(numbers, stride, size, colour, alpha) {
    const context = this.context;
    context.fillStyle = colour;
    context.globalAlpha = alpha;
    for (let i = 0; i + 1 < numbers.length; i += stride) {
      const [column, row] = this.place(numbers[i], numbers[i + 1]);
      context.fillRect(column - size / 2, row - size / 2, size, size);
    }
    context.globalAlpha = 1;
  }

  // A particle is a tick along its heading.
  drawParticles(colour) {
    const { context, shown: { particles } } = this;
    context.beginPath();
    for (let i = 0; i + 3 < particles.length; i += 4) {
      const [column, row] = this.place(particles[i], particles[i + 1]);
      const heading = particles[i + 2];
      context.moveTo(column, row);
      context.lineTo(column + 14 * Math.cos(heading), row - 14 * Math.sin(heading));
    }
    context.strokeStyle = colour.particle;
    context.globalAlpha = 0.55;
    context.lineWidth = 1.5;
    context.stroke();
    context.globalAlpha = 1;
    this.drawPoints(particles, 4, 4, colour.particle, 0.8);
  }

  drawRobot(colour) {
    const { context, shown: { path } } = this;
    if (path.length < 3) return;
    const [column, row] = this.place(path.at(-3), path.at(-2));
    context.save();
    context.translate(column, row);
    context.rotate(-path.at(-1));
    context.beginPath();
    context.moveTo(11, 0);
    context.lineTo(-7, 7);
    context.lineTo(-4, 0);
    context.lineTo(-7, -7);
    context.closePath();
    context.fillStyle = colour.path;
    context.strokeStyle = colour.paper;
    context.lineWidth = 2;
    context.stroke();
    context.fill();
    context.restore();
  }

  drawScaleBar(height, colour) {
    const context = this.context, metres = this.spacing(80), length = metres * this.eye.scale;
    const [left, row] = [18, height - 20];
    context.beginPath();
    context.moveTo(left, row - 5);
    context.lineTo(left, row);
    context.lineTo(left + length, row);
    context.lineTo(left + length, row - 5);
    context.strokeStyle = colour.text;
    context.lineWidth = 1.5;
    context.stroke();
    context.fillStyle = colour.text;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${metres} m`, left + length / 2, row - 7);
  }

  // Drag to move, wheel or two fingers to come nearer, double click to see all; arrows, + and - likewise.
  listen() {
    const fingers = new Map();
    const place = (event) => [event.offsetX, event.offsetY];
    const spread = () => {
      const [[a, b], [c, d]] = fingers.values();
      return { x: (a + c) / 2, y: (b + d) / 2, distance: Math.hypot(a - c, b - d) };
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, place(event));
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const before = fingers.get(event.pointerId), now = place(event);
      if (fingers.size === 1) {
        fingers.set(event.pointerId, now);
        this.move(now[0] - before[0], now[1] - before[1]);
      } else if (fingers.size === 2) {
        const from = spread();
        fingers.set(event.pointerId, now);
        const to = spread();
        this.move(to.x - from.x, to.y - from.y);
        this.zoom(to.distance / Math.max(1, from.distance), to.x, to.y);
      }
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    }
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
    }, { passive: false });
    this.canvas.addEventListener("dblclick", () => this.fit());
    this.canvas.addEventListener("keydown", (event) => {
      const { clientWidth: width, clientHeight: height } = this.canvas;
      const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
      const factor = { "+": 1.25, "=": 1.25, "-": 0.8 }[event.key];
      if (moves[event.key]) this.move(...moves[event.key]);
      else if (factor) this.zoom(factor, width / 2, height / 2);
      else if (event.key === "0") this.fit();
      else return;
      event.preventDefault();
    });
  }

  move(columns, rows) {
    if (!this.eye || (columns === 0 && rows === 0)) return;
    this.eye = { ...this.eye, x: this.eye.x - columns / this.eye.scale, y: this.eye.y + rows / this.eye.scale };
    this.moved();
  }

  // The place under the pointer stays.
  zoom(factor, column, row) {
    if (!this.eye) return;
    const [x, y] = this.world(column, row);
    const scale = Math.min(2000, Math.max(0.05, this.eye.scale * factor));
    const kept = this.eye.scale / scale;
    this.eye = { x: x + (this.eye.x - x) * kept, y: y + (this.eye.y - y) * kept, scale };
    this.moved();
  }

  moved() {
    this.isFitted = false;
    this.onMoved(true);
    this.redraw();
  }
}

// The cells as a picture, first row at the top, coarser where there are very many.
function picture({ width, height }, cells, colour) {
  const every = Math.ceil(Math.max(width, height) / MOST_CELLS);
  const [columns, rows] = [Math.ceil(width / every), Math.ceil(height / every)];
  const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  const words = new Uint32Array(image.data.buffer);
  const paint = [0, bits(colour.free), bits(colour.seen)];
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const cell = cells[row * every * width + column * every];
      words[(rows - 1 - row) * columns + column] = paint[cell];
    }
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

// A colour `#rrggbb` as the bytes of a pixel.
function bits(colour) {
  const [red, green, blue] = [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}
