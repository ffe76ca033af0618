// @ts-check
// A look at the map: where from, what is drawn, and what fingers, mouse and keys do to it.

import { theme, timeColour } from "./colours.js";
import { CloudView } from "./cloud.js";

const SCALE = [0.4, 2000]; // pixels a metre
const PATH_SHADES = 24;
const FLASH_MS = 2600;
const CHI_95 = 5.991; // 95 % of chi-squared with two degrees of freedom
const STEP_PIXELS = 1.5;

export class Camera {
  constructor() {
    /** Middle of the picture, m. */
    this.x = 0;
    this.y = 0;
    /** Pixels of the device to a metre. */
    this.scale = 40;
    this.width = 1;
    this.height = 1;
  }

  /**
   * @param {number} x m
   * @param {number} y m
   * @returns {[number, number]} pixels
   */
  pixel(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  /**
   * @param {number} px
   * @param {number} py
   * @returns {[number, number]} m
   */
  point(px, py) {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  /**
   * A square picture whose upper left corner is at x, y; nothing if it is out of sight. Neighbours meet without a seam.
   * @param {CanvasRenderingContext2D} pen
   * @param {CanvasImageSource} picture
   * @param {number} x m
   * @param {number} y m
   * @param {number} side m
   */
  picture(pen, picture, x, y, side) {
    const [left, top] = this.pixel(x, y).map(Math.round);
    const [right, bottom] = this.pixel(x + side, y - side).map(Math.round);
    if (right < 0 || bottom < 0 || left > this.width || top > this.height) return;
    pen.drawImage(picture, left, top, right - left, bottom - top);
  }

  /**
   * @param {number} factor
   * @param {number} px stays where it is
   * @param {number} py
   */
  zoom(factor, px, py) {
    const [x, y] = this.point(px, py);
    this.scale = Math.min(SCALE[1], Math.max(SCALE[0], this.scale * factor));
    const [nx, ny] = this.point(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }
}

export class View {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./state.js").Robot[]} robots drawn on one map
   */
  constructor(canvas, robots) {
    this.canvas = canvas;
    this.robots = robots;
    this.camera = new Camera();
    this.cloud = new CloudView();
    this.follows = true;
    this.fits = true;
    this.is3d = false;
    this.measures = false;
    /** @type {[number, number][]} m */
    this.measured = [];
    /** Frames drawn, and the time of the last ones, ms. */
    this.frames = 0;
    /** @type {number[]} */
    this.frameTimes = [];
    /** What lies over the picture: left, bottom, right, top, pixels of the page. */
    this.margins = [0, 0, 0, 0];
    this.isDue = true;
    this.#listen();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** Draws in the next frame. */
  draw() {
    if (!this.isDue) return;
    this.isDue = false;
    requestAnimationFrame(() => {
      this.isDue = true;
      const begun = performance.now();
      if (this.#paint()) this.draw();
      this.frames++;
      this.frameTimes.push(performance.now() - begun);
      this.frameTimes.splice(0, this.frameTimes.length - 120);
    });
  }

  /**
   * @param {number} px
   * @param {number} py
   * @returns {import("./state.js").Robot} the robot that is nearest to a point of the picture
   */
  nearest(px, py) {
    const off = (/** @type {import("./state.js").Robot} */ { status }) => {
      const [x, y] = this.camera.pixel(status?.pose?.[0] ?? Infinity, status?.pose?.[1] ?? Infinity);
      return Math.hypot(x - px, y - py);
    };
    return this.robots.reduce((best, robot) => (off(robot) < off(best) ? robot : best));
  }

  /** All that is known is in the picture, and stays so. */
  fit() {
    this.fits = true;
    this.follows = false;
    this.draw();
  }

  follow() {
    this.follows = true;
    this.fits = false;
    this.draw();
  }

  #look() {
    const { camera } = this;
    const pose = this.robots[0]?.status?.pose;
    const [left, bottom, right, top] = this.margins.map((margin) => margin * devicePixelRatio);
    const free = [Math.max(50, camera.width - left - right), Math.max(50, camera.height - top - bottom)];
    if (this.fits) {
      const extents = this.robots.map((robot) => robot.extent()).filter((extent) => extent !== null);
      if (extents.length > 0) {
        const [west, south] = [0, 1].map((side) => Math.min(...extents.map((extent) => extent[side])));
        const [east, north] = [2, 3].map((side) => Math.max(...extents.map((extent) => extent[side])));
        const fits = Math.min(free[0] / (east - west), free[1] / (north - south)) * 0.94;
        camera.scale = Math.min(SCALE[1], Math.max(SCALE[0], fits));
        this.#centre((west + east) / 2, (south + north) / 2);
      }
    } else if (this.follows && pose) {
      this.#centre(pose[0], pose[1]);
    }
  }

  /**
   * Puts a point in the middle of what nothing lies over.
   * @param {number} x m
   * @param {number} y m
   */
  #centre(x, y) {
    const [left, bottom, right, top] = this.margins.map((margin) => (margin * devicePixelRatio) / this.camera.scale);
    this.camera.x = x + (right - left) / 2;
    this.camera.y = y + (top - bottom) / 2;
  }

  /** @returns {boolean} something still moves */
  #paint() {
    const { canvas, camera } = this;
    const ratio = devicePixelRatio;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (width === 0 || height === 0) return false;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    [camera.width, camera.height] = [width, height];
    const pen = canvas.getContext("2d");
    if (!pen) return false;
    this.#look();
    pen.fillStyle = theme().ground;
    pen.fillRect(0, 0, width, height);
    if (this.is3d) {
      for (const robot of this.robots) if (robot.cloud.length > 0) this.cloud.draw(pen, width, height, robot.cloud);
      return false;
    }
    let moves = false;
    for (const robot of this.robots) {
      robot.map.draw(pen, camera, robot.status?.is_apart ? 0.35 : 1);
      moves = robot.map.drawGhosts(pen, camera) || moves;
    }
    for (const robot of this.robots) {
      drawPath(pen, camera, robot, ratio);
      moves = drawClosures(pen, camera, robot, ratio) || moves;
      drawParticles(pen, camera, robot, ratio);
      drawLandmarks(pen, camera, robot, ratio);
      drawScan(pen, camera, robot, ratio);
      drawRobot(pen, camera, robot, ratio, this.robots.length > 1);
    }
    drawScale(pen, camera, ratio, this.margins[1]);
    this.#drawMeasure(pen, ratio);
    return moves;
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {number} ratio
   */
  #drawMeasure(pen, ratio) {
    if (this.measured.length === 0) return;
    const points = this.measured.map(([x, y]) => this.camera.pixel(x, y));
    pen.strokeStyle = pen.fillStyle = theme().ink;
    pen.lineWidth = 1.5 * ratio;
    pen.setLineDash([5 * ratio, 4 * ratio]);
    pen.beginPath();
    points.forEach(([px, py]) => pen.lineTo(px, py));
    pen.stroke();
    pen.setLineDash([]);
    for (const [px, py] of points) {
      pen.beginPath();
      pen.arc(px, py, 4 * ratio, 0, 2 * Math.PI);
      pen.stroke();
    }
    if (points.length < 2) return;
    const [[ax, ay], [bx, by]] = this.measured;
    const text = `${Math.hypot(bx - ax, by - ay).toFixed(2)} m`;
    label(pen, text, (points[0][0] + points[1][0]) / 2, (points[0][1] + points[1][1]) / 2 - 10 * ratio, ratio);
  }

  /**
   * @param {number} px
   * @param {number} py
   */
  #measure(px, py) {
    if (this.measured.length >= 2) this.measured = [];
    this.measured.push(this.camera.point(px, py));
    this.draw();
  }

  #listen() {
    const { canvas } = this;
    /** @type {Map<number, [number, number]>} */
    const fingers = new Map();
    let moved = 0;
    const at = (/** @type {MouseEvent} */ event) => {
      const box = canvas.getBoundingClientRect();
      const ratio = devicePixelRatio;
      return /** @type {[number, number]} */ ([(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio]);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, at(event));
      moved = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = at(event);
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      moved += Math.hypot(dx, dy);
      const others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      fingers.set(event.pointerId, now);
      if (others.length > 0) this.#pinch(others[0], before, now);
      else if (this.is3d) this.cloud.turn(dx / devicePixelRatio, dy / devicePixelRatio);
      else if (moved > 4) this.pan(dx, dy);
      this.draw();
    });
    const lift = (/** @type {PointerEvent} */ event) => {
      if (fingers.delete(event.pointerId) && fingers.size === 0 && moved <= 4 && this.measures) {
        this.#measure(...at(event));
      }
    };
    canvas.addEventListener("pointerup", lift);
    canvas.addEventListener("pointercancel", (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("dblclick", () => this.measures || this.follow());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const factor = Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0016));
      this.zoomBy(factor, ...at(event));
    }, { passive: false });
  }

  /**
   * @param {[number, number]} other finger that rests
   * @param {[number, number]} before
   * @param {[number, number]} now
   */
  #pinch(other, before, now) {
    const apart = (/** @type {[number, number]} */ a) => Math.max(1, Math.hypot(a[0] - other[0], a[1] - other[1]));
    this.zoomBy(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
  }

  /**
   * @param {number} dx pixels
   * @param {number} dy
   */
  pan(dx, dy) {
    this.follows = this.fits = false;
    this.camera.x -= dx / this.camera.scale;
    this.camera.y += dy / this.camera.scale;
    this.draw();
  }

  /**
   * @param {number} factor
   * @param {number} px
   * @param {number} py
   */
  zoomBy(factor, px = this.camera.width / 2, py = this.camera.height / 2) {
    this.fits = false;
    if (this.is3d) this.cloud.zoom = Math.min(20, Math.max(0.2, this.cloud.zoom * factor));
    else this.camera.zoom(factor, px, py);
    this.draw();
  }
}

/** @typedef {import("./state.js").Robot} Robot */
/** @typedef {CanvasRenderingContext2D} Pen */

/** @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio */
function drawPath(pen, camera, robot, ratio) {
  const { path, pathLength } = robot;
  if (pathLength < 2) return;
  const [begin, end] = [path[2], path[4 * (pathLength - 1) + 2]];
  const span = Math.max(end - begin, 1e-6);
  pen.lineWidth = 2 * ratio;
  pen.lineJoin = "round";
  let [lastX, lastY] = camera.pixel(path[0], path[1]);
  let shade = -1;
  let trusted = 1;
  for (let k = 1; k < pathLength; k++) {
    const [px, py] = camera.pixel(path[4 * k], path[4 * k + 1]);
    if (Math.hypot(px - lastX, py - lastY) < STEP_PIXELS && k < pathLength - 1) continue;
    const next = Math.floor((PATH_SHADES * (path[4 * k + 2] - begin)) / span);
    if (next !== shade || path[4 * k + 3] !== trusted) {
      if (shade >= 0) pen.stroke();
      [shade, trusted] = [next, path[4 * k + 3]];
      pen.strokeStyle = timeColour(shade / PATH_SHADES);
      pen.setLineDash(trusted ? [] : [2 * ratio, 4 * ratio]);
      pen.beginPath();
      pen.moveTo(lastX, lastY);
    }
    pen.lineTo(px, py);
    [lastX, lastY] = [px, py];
  }
  pen.stroke();
  pen.setLineDash([]);
}

/** @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio */
function drawClosures(pen, camera, { closures, closed }, ratio) {
  pen.strokeStyle = theme().closure;
  pen.lineWidth = ratio;
  pen.globalAlpha = 0.6;
  pen.beginPath();
  for (let k = 0; k + 4 <= closures.length; k += 4) {
    pen.moveTo(...camera.pixel(closures[k], closures[k + 1]));
    pen.lineTo(...camera.pixel(closures[k + 2], closures[k + 3]));
  }
  pen.stroke();
  pen.globalAlpha = 1;
  const age = closed ? (performance.now() - closed.since) / FLASH_MS : 1;
  if (!closed || age >= 1) return false;
  const [px, py] = camera.pixel(closed.ends[2], closed.ends[3]);
  pen.lineWidth = 3 * ratio;
  pen.globalAlpha = 1 - age;
  pen.beginPath();
  pen.arc(px, py, (8 + 40 * age) * ratio, 0, 2 * Math.PI);
  pen.stroke();
  pen.globalAlpha = 1;
  return true;
}

/** @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio */
function drawParticles(pen, camera, { particles }, ratio) {
  pen.strokeStyle = theme().particle;
  pen.lineWidth = ratio;
  pen.beginPath();
  for (let k = 0; k + 4 <= particles.length; k += 4) {
    const [px, py] = camera.pixel(particles[k], particles[k + 1]);
    const heading = particles[k + 2];
    pen.moveTo(px, py);
    pen.lineTo(px + 9 * ratio * Math.cos(heading), py - 9 * ratio * Math.sin(heading));
  }
  pen.stroke();
}

/** Each with its 95 % ellipse. @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio */
function drawLandmarks(pen, camera, { landmarks }, ratio) {
  pen.strokeStyle = pen.fillStyle = theme().closure;
  pen.lineWidth = ratio;
  for (let k = 0; k + 5 <= landmarks.length; k += 5) {
    const [x, y, xx, xy, yy] = landmarks.subarray(k, k + 5);
    const [px, py] = camera.pixel(x, y);
    const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
    const [long, short] = [mean + half, mean - half].map((variance) => camera.scale * Math.sqrt(CHI_95 * Math.max(variance, 0)));
    pen.beginPath();
    // Pixels go down.
    pen.ellipse(px, py, long, short, -0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
    pen.stroke();
    pen.beginPath();
    pen.arc(px, py, 2 * ratio, 0, 2 * Math.PI);
    pen.fill();
  }
}

/** What is seen, and each hit in size and colour by how it fits. @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio */
function drawScan(pen, camera, { scan, status }, ratio) {
  if (status?.pose) {
    pen.fillStyle = theme().robot;
    pen.globalAlpha = 0.1;
    pen.beginPath();
    pen.moveTo(...camera.pixel(status.pose[0], status.pose[1]));
    for (let k = 0; k + 3 <= scan.length; k += 3) pen.lineTo(...camera.pixel(scan[k], scan[k + 1]));
    pen.fill();
    pen.globalAlpha = 1;
  }
  const sizes = [3.4, 3.6, 2.6, 5].map((size) => Math.round(size * ratio));
  theme().fits.forEach((colour, fit) => {
    pen.fillStyle = colour;
    const side = sizes[fit];
    for (let k = 0; k + 3 <= scan.length; k += 3) {
      if (scan[k + 2] !== fit) continue;
      const [px, py] = camera.pixel(scan[k], scan[k + 1]);
      pen.fillRect(Math.round(px - side / 2), Math.round(py - side / 2), side, side);
    }
  });
}

/** @param {Pen} pen @param {Camera} camera @param {Robot} robot @param {number} ratio @param {boolean} isNamed */
function drawRobot(pen, camera, { status, name, path, pathLength }, ratio, isNamed) {
  const last = 4 * (pathLength - 1);
  const known = status?.pose ?? (pathLength > 0 ? [path[last], path[last + 1], 0] : null);
  if (!status || !known) return;
  const [px, py] = camera.pixel(known[0], known[1]);
  const colours = theme();
  const isBad = status.mood === "bad" || !status.pose;
  drawUncertainty(pen, camera, status, [px, py], ratio);
  pen.save();
  pen.translate(px, py);
  pen.rotate(-known[2]);
  pen.fillStyle = colours.robot;
  pen.strokeStyle = colours.ground;
  pen.lineWidth = 2 * ratio;
  pen.globalAlpha = isBad ? 0.45 : 1;
  const size = Math.max(9 * ratio, Math.min(0.35 * camera.scale, 26 * ratio));
  pen.beginPath();
  pen.moveTo(size, 0);
  pen.lineTo(-0.75 * size, 0.7 * size);
  pen.lineTo(-0.35 * size, 0);
  pen.lineTo(-0.75 * size, -0.7 * size);
  pen.closePath();
  pen.fill();
  pen.stroke();
  pen.restore();
  if (isBad) label(pen, "?", px, py - 22 * ratio, ratio);
  if (isNamed) label(pen, name, px, py + 30 * ratio, ratio);
}

/**
 * Two standard deviations; and along which axis the place is a guess.
 * @param {Pen} pen
 * @param {Camera} camera
 * @param {import("./state.js").Status} status
 * @param {[number, number]} at
 * @param {number} ratio
 */
function drawUncertainty(pen, camera, { covariance: [xx, xy, yy], undetermined }, [px, py], ratio) {
  const turn = 0.5 * Math.atan2(2 * xy, xx - yy);
  const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  const axes = [mean + half, mean - half].map((variance) => 2 * Math.sqrt(Math.max(variance, 0)) * camera.scale);
  pen.strokeStyle = theme().robot;
  pen.lineWidth = 1.5 * ratio;
  if (Number.isFinite(axes[0]) && axes[0] < 4 * camera.width) {
    pen.beginPath();
    pen.ellipse(px, py, axes[0], axes[1], -turn, 0, 2 * Math.PI);
    pen.stroke();
  }
  if (!undetermined) return;
  const [dx, dy] = [undetermined[0] * 46 * ratio, -undetermined[1] * 46 * ratio];
  pen.strokeStyle = theme().doubt;
  pen.lineWidth = 3 * ratio;
  pen.beginPath();
  for (const side of [-1, 1]) {
    const [ex, ey] = [px + side * dx, py + side * dy];
    pen.moveTo(px + 0.4 * side * dx, py + 0.4 * side * dy);
    pen.lineTo(ex, ey);
    pen.lineTo(ex - 0.2 * side * dx - 0.15 * dy, ey - 0.2 * side * dy + 0.15 * dx);
    pen.moveTo(ex, ey);
    pen.lineTo(ex - 0.2 * side * dx + 0.15 * dy, ey - 0.2 * side * dy - 0.15 * dx);
  }
  pen.stroke();
}

/** @param {Pen} pen @param {Camera} camera @param {number} ratio @param {number} margin below */
function drawScale(pen, camera, ratio, margin) {
  const wanted = (90 * ratio) / camera.scale;
  const power = 10 ** Math.floor(Math.log10(wanted));
  const metres = [5, 2, 1].map((step) => step * power).find((step) => step <= wanted) ?? power;
  const [left, bottom] = [14 * ratio, camera.height - (14 + margin) * ratio];
  pen.strokeStyle = theme().ink;
  pen.lineWidth = 2 * ratio;
  pen.beginPath();
  pen.moveTo(left, bottom - 5 * ratio);
  pen.lineTo(left, bottom);
  pen.lineTo(left + metres * camera.scale, bottom);
  pen.lineTo(left + metres * camera.scale, bottom - 5 * ratio);
  pen.stroke();
  label(pen, `${metres >= 1 ? metres : metres.toPrecision(1)} m`, left + (metres * camera.scale) / 2, bottom - 10 * ratio, ratio);
}

/** @param {Pen} pen @param {string} text @param {number} px @param {number} py @param {number} ratio */
function label(pen, text, px, py, ratio) {
  pen.font = `600 ${13 * ratio}px system-ui, sans-serif`;
  pen.textAlign = "center";
  pen.lineWidth = 4 * ratio;
  pen.lineJoin = "round";
  pen.strokeStyle = theme().ground;
  pen.strokeText(text, px, py);
  pen.fillStyle = theme().ink;
  pen.fillText(text, px, py);
}
