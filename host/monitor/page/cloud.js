// @ts-check
// The 3D map: points, turned by a finger. Painted pixel by pixel, with depth: it needs no graphics card.

import { theme } from "./colours.js";

export class CloudView {
  constructor() {
    this.azimuth = 0.8;
    this.elevation = 0.6;
    this.zoom = 1;
    /** @type {Float32Array | null} */
    this.depth = null;
  }

  /**
   * @param {number} dx pixels
   * @param {number} dy pixels
   */
  turn(dx, dy) {
    this.azimuth -= dx * 0.008;
    this.elevation = Math.min(1.55, Math.max(-0.2, this.elevation + dy * 0.008));
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {number} width pixels of the device
   * @param {number} height
   * @param {Float32Array} points x, y, z
   */
  draw(pen, width, height, points) {
    const picture = pen.getImageData(0, 0, width, height);
    const { centre, radius, low, high } = measure(points);
    const scale = (0.42 * Math.min(width, height) * this.zoom) / radius;
    const [sa, ca] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [se, ce] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    if (this.depth?.length !== width * height) this.depth = new Float32Array(width * height);
    const depth = this.depth.fill(-Infinity);
    const dot = Math.max(1, Math.round(devicePixelRatio * Math.min(2, this.zoom)));
    const ramp = colours();
    for (let k = 0; k < points.length; k += 3) {
      const [x, y, z] = [points[k] - centre[0], points[k + 1] - centre[1], points[k + 2] - centre[2]];
      const [right, ahead] = [-sa * x + ca * y, ca * x + sa * y];
      const near = ahead * ce + z * se;
      const px = Math.round(width / 2 + scale * right);
      const py = Math.round(height / 2 - scale * (z * ce - ahead * se));
      const shade = Math.round((255 * (points[k + 2] - low)) / Math.max(high - low, 0.1));
      const [red, green, blue] = ramp[Math.min(255, Math.max(0, shade))];
      for (let row = py; row < py + dot; row++) {
        for (let column = px; column < px + dot; column++) {
          if (column < 0 || row < 0 || column >= width || row >= height) continue;
          const at = row * width + column;
          if (depth[at] >= near) continue;
          depth[at] = near;
          picture.data.set([red, green, blue, 255], 4 * at);
        }
      }
    }
    pen.putImageData(picture, 0, 0);
  }
}

/** @param {Float32Array} points */
function measure(points) {
  const least = [Infinity, Infinity, Infinity];
  const most = [-Infinity, -Infinity, -Infinity];
  for (let k = 0; k < points.length; k++) {
    least[k % 3] = Math.min(least[k % 3], points[k]);
    most[k % 3] = Math.max(most[k % 3], points[k]);
  }
  const centre = least.map((value, axis) => (value + most[axis]) / 2);
  const radius = Math.max(1, Math.hypot(...most.map((value, axis) => value - least[axis])) / 2);
  return { centre, radius, low: least[2], high: most[2] };
}

/** @returns {import("./colours.js").Rgb[]} from low to high */
function colours() {
  const stops = theme().time;
  return Array.from({ length: 256 }, (_, k) => {
    const at = (k / 255) * (stops.length - 1);
    const i = Math.min(Math.floor(at), stops.length - 2);
    const mix = (/** @type {0 | 1 | 2} */ c) => stops[i][c] + (at - i) * (stops[i + 1][c] - stops[i][c]);
    return [mix(0), mix(1), mix(2)];
  });
}
